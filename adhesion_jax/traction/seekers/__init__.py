"""Seekers of the best slip by name, those of a kind in a file."""

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

#: Those that may be named.
SEEKERS: Mapping[str, Seeker] = {
    "true-optimum": TrueOptimum(),
    "constant-slip": ConstantSlip(),
    "gradient-uyulan2018": PrintedGradient(),
    "gradient": RepairedGradient(),
    "offset-curve": OffsetCurve(),
    "robust-curve": RobustCurve(OffsetCurve()),
    "perturb-and-observe": PerturbAndObserve(),
    "sliding-extremum": SlidingExtremum(),
}
