"""The HXD1F of "Optimal Utilization of Adhesion Force ...", J. Adv. Transport. 2019, 6270515."""

from adhesion_jax.traction.controllers import CONTROLLERS
from adhesion_jax.traction.controllers.linearised import SlidingMode
from adhesion_jax.traction.driver import Driver
from adhesion_jax.traction.observers import OBSERVERS
from adhesion_jax.traction.observers.full_dimension import FullDimension
from adhesion_jax.traction.rails import by_time
from adhesion_jax.traction.seekers import SEEKERS
from adhesion_jax.traction.surface import exponential
from adhesion_jax.traction.systems.base import Case, System, papers

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
_THIN_LAYER = SlidingMode(layer=0.02)

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
    **papers("hxd1f"),
    plant="hxd1f",
    step=1e-4,
    duration=15.0,
    train_speed=5.0,
    driver=Driver(traction=13e3),
    cases=_cases,
)
