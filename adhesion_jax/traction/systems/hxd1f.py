"""The HXD1F of "Optimal Utilization of Adhesion Force ...", J. Adv. Transport. 2019, 6270515."""

from adhesion_jax.traction.controllers import CONTROLLERS
from adhesion_jax.traction.controllers.sliding_mode import SlidingMode
from adhesion_jax.traction.driver import Driver
from adhesion_jax.traction.observers import OBSERVERS
from adhesion_jax.traction.observers.full_dimension import FullDimension
from adhesion_jax.traction.rails import by_time
from adhesion_jax.traction.seekers import SEEKERS
from adhesion_jax.traction.sensors import SpeedNoise
from adhesion_jax.traction.systems.base import Case, System, exponential

#: Peaks of .36, .20 and .10 (assumed) at .20 and .08 (printed) and .05 m/s (assumed).
SURFACES = {
    "dry": exponential(3.2666, 7.2592, 1.2580),
    "wet": exponential(8.1666, 18.1479, 0.6989),
    "snow": exponential(13.0665, 29.0366, 0.3494),
}

#: The best slips that the text of section 5 prints, m/s.
PRINTED_BEST_SLIP = {"dry": 0.2, "wet": 0.08}

#: When each begins, s.
STARTS = (0.0, 5.0, 10.0)

_TERMINAL = OBSERVERS["terminal-sliding"]
_EXTREMUM, _TRUE = SEEKERS["sliding-extremum"], SEEKERS["true-optimum"]
_BARRIER, _SLIDING = CONTROLLERS["barrier"], CONTROLLERS["sliding-mode"]
_THIN_LAYER = SlidingMode(gain=1500.0, layer=0.02, least=-0.3)

#: The name of the paper's own method.
SMES = "SMES, NTSMO, ABLF"

_METHODS = (
    (SMES, _TERMINAL, _EXTREMUM, _BARRIER, 0.0),
    ("the same, speed held 1 ms", _TERMINAL, _EXTREMUM, _BARRIER, 1e-3),
    ("SMES, full dimension -233, ABLF", FullDimension(-233.0), _EXTREMUM, _BARRIER, 0.0),
    ("DAC", _TERMINAL, None, CONTROLLERS["differential-acceleration"], 0.0),
    ("SMES, NTSMO, sliding mode", _TERMINAL, _EXTREMUM, _SLIDING, 0.0),
    ("SMES, NTSMO, layer of .02 m/s", _TERMINAL, _EXTREMUM, _THIN_LAYER, 0.0),
    ("SMES, NTSMO, layer of .05 m/s", _TERMINAL, _EXTREMUM, CONTROLLERS["sliding-mode-layer"], 0.0),
    ("SMES, NTSMO, PI", _TERMINAL, _EXTREMUM, CONTROLLERS["linearised-pi"], 0.0),
    ("true optimum, NTSMO, ABLF", _TERMINAL, _TRUE, _BARRIER, 0.0),
    ("true optimum, full dimension -150, ABLF", FullDimension(-150.0), _TRUE, _BARRIER, 0.0),
)


def _cases(step: float) -> list[Case]:
    rails = by_time([*SURFACES.values()], STARTS, step)
    return [Case("dry, wet, snow", name, (*SURFACES,), rails, *parts) for name, *parts in _METHODS]


SYSTEM = System(
    title="Extremum seeking with a sliding mode and a barrier controller, HXD1F 2019",
    source="Optimal Utilization of Adhesion Force for Heavy-Haul Electric Locomotive Based on "
    "Extremum Seeking with Sliding Mode and Asymmetric Barrier Lyapunov Function, "
    "J. Adv. Transport. 2019, 6270515",
    plant="hxd1f",
    step=1e-4,
    control_period=1e-3,
    duration=15.0,
    train_speed=5.0,
    slip=0.0,
    slope=0.0,
    driver=Driver(traction=13e3),
    noise=SpeedNoise(motor=0.02, train=5e-3),
    cases=_cases,
    repairs=(
        "The equations of the paper are reconstructed from its text: observer, seeker and "
        "controller have the published forms of the methods that it names.",
    ),
    assumptions=(
        "The largest adhesion of all three surfaces and the best slip on snow; the best slip of "
        ".20 m/s on the dry and of .08 m/s on the wet rail are printed.",
        "All gains of observer, seeker and controllers, and all settings of the differential "
        "acceleration control.",
        "The ratio b/a of the curves, 2.2222, is that of Uyulan et al. 2018.",
        "The speed is not sampled; one method has a speed that is held for 1 ms.",
        "The train of 10,000 t starts at 5 m/s. The power of an axle is an eighth of the 9600 kW "
        "that are printed.",
    ),
)
