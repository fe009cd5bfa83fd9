"""The axle of a CRH2A of Fang et al. 2018, Energies 11: traction, then braking, roads by speed."""

import jax.numpy as jnp

from adhesion_jax.traction.controllers import Controller
from adhesion_jax.traction.controllers.torque_feedback import RateFeedback, SlopeFeedback
from adhesion_jax.traction.driver import Driver
from adhesion_jax.traction.observers.full_dimension import FullDimension
from adhesion_jax.traction.rails import BySpeed, stacked
from adhesion_jax.traction.surface import RailSurface, with_peak
from adhesion_jax.traction.systems.base import Case, System, papers

_KMH = 1 / 3.6

#: b/a of the roads: that of the other papers, as Fang et al. print no formula.
_RATIO = 2.2222

#: The gain K2 in N m at which Eq. 9 settles at the peak (Eq. 18).
CRITICAL = 20345.0


def road(largest: float, slip_kmh: float) -> RailSurface:
    """A road whose largest adhesion lies at a slip velocity in km/h."""
    return with_peak(largest, slip_kmh * _KMH, _RATIO)


#: Best slips (Fig. 6) and the slips at which the wheel ran (Fig. 12) on roads of the paper, km/h.
PRINTED_BEST_SLIP_KMH = {"1": 6.5, "3": 4.0}
PRINTED_SLIP_KMH = {"2": 5.3, "3": 3.5}

#: What lies where: road 2 between 55 and 85 km/h, road 3 to 110 km/h; in braking road 2 between
#: 105 and 70 km/h, and road 1 elsewhere.
SEGMENTS = ("1", "2", "3", "1 above", "1 braking", "2 braking", "1 below")


def roads(second_kmh: float = 5.5) -> BySpeed:
    """The roads of Fig. 6; the best slip of road 2 is not printed."""
    first, second, third = road(0.2, 6.5), road(0.07, second_kmh), road(0.0593, 4.0)
    return BySpeed(
        stacked([first, second, third, first, first, second, first]),
        jnp.array([55.0, 85.0, 110.0]) * _KMH,
        jnp.array([105.0, 70.0]) * _KMH,
    )


def _slope(gain: float) -> Controller:
    """Eq. 9 with K1 as printed; gamma, P(0), beta(0) and the filter are assumed."""
    return SlopeFeedback(adhesion_gain=gain)


def _rate(rate_gain: float, gain: float, engaged_kmh: float = 30.0) -> Controller:
    return RateFeedback(rate_gain=rate_gain, adhesion_gain=gain, engaged=engaged_kmh * _KMH)


_METHODS = (
    ("Eq. 9, K2 7000", _slope(7000.0), 5.5),
    ("Eq. 9, K2 18000", _slope(18000.0), 5.5),
    ("Eq. 9, K2 18000, best slip 6.4 km/h on road 2", _slope(18000.0), 6.4),
    ("Eq. 9, critical K2", _slope(CRITICAL), 5.5),
    ("Eq. 9, 1.02 of critical K2", _slope(1.02 * CRITICAL), 5.5),
    ("Eq. 9, 1.1 of critical K2", _slope(1.1 * CRITICAL), 5.5),
    ("Eq. 8 from rest, K1 19000, K2 18000", _rate(19000.0, 18000.0, 0.0), 5.5),
    ("Eq. 8, K1 1000, K2 18000", _rate(1000.0, 18000.0), 5.5),
    ("Eq. 8, K1 19000, K2 18000", _rate(19000.0, 18000.0), 5.5),
    ("Eq. 8, K1 19000, critical K2", _rate(19000.0, CRITICAL), 5.5),
    ("Eq. 8, K1 19000, 1.05 of critical K2", _rate(19000.0, 1.05 * CRITICAL), 5.5),
)


def _cases(_: float) -> list[Case]:
    track, observer = "0 to 130 to 25 km/h", FullDimension(-30.0)
    return [
        Case(track, name, SEGMENTS, roads(second_kmh), observer, None, controller, 1e-3)
        for name, controller, second_kmh in _METHODS
    ]


SYSTEM = System(
    **papers("fang2018"),
    plant="fang2018",
    step=2e-4,
    duration=300.0,
    train_speed=0.0,
    driver=Driver(traction=1590.0, until=130 * _KMH, braking=1590.0, down_to=25 * _KMH),
    cases=_cases,
)
