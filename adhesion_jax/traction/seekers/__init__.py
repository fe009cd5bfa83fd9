"""Seekers of the best slip by name: one method a file."""

from collections.abc import Mapping

from adhesion_jax.traction.seekers.base import Seeker
from adhesion_jax.traction.seekers.climbing import (
    PerturbAndObserve,
    PrintedGradient,
    RepairedGradient,
    SlidingExtremum,
)
from adhesion_jax.traction.seekers.given import ConstantSlip, TrueOptimum
from adhesion_jax.traction.seekers.offset_curve import OffsetCurve
from adhesion_jax.traction.seekers.robust_curve import RobustCurve

_OFFSET_CURVE = OffsetCurve(price=1.0, memory=0.6, threshold=0.007, dither=0.06, start=0.1)

#: Those that may be named, with settings.
SEEKERS: Mapping[str, Seeker] = {
    "true-optimum": TrueOptimum(),
    "constant-slip": ConstantSlip(slip=0.1),
    "gradient-uyulan2018": PrintedGradient(
        gamma=0.65, threshold=1e-4, switch=10.0, start=1.20986, gain=400.0, limit=1.0
    ),
    "gradient": RepairedGradient(
        gamma=0.05, memory=0.3, limit=20.0, start=0.05, lowest=0.005, highest=2.0
    ),
    "offset-curve": _OFFSET_CURVE,
    "robust-curve": RobustCurve(_OFFSET_CURVE),
    "perturb-and-observe": PerturbAndObserve(
        step=0.006, window=0.05, start=0.1, lowest=0.01, highest=0.6
    ),
    "sliding-extremum": SlidingExtremum(
        speed=0.4, rise=0.5, width=0.08, start=0.01, lowest=0.005, highest=0.6, tracker=60.0
    ),
}
