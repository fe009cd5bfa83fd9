"""One growing sequence of points on one rail; each estimate uses all points so far."""

from adhesion_jax.errors import InputError
from adhesion_jax.options import Rail
from adhesion_jax.scenarios.base import Scenario
from adhesion_jax.scenarios.course import Growing
from adhesion_jax.scenarios.excitation import RandomSlips, Sweep
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rail_process import steady
from adhesion_jax.scenarios.rails import HE2018, KIENCKE_RAILS, QIAN2024, RAILS

_PREFIXES = 20

#: Numbers of samples after which Qian et al. 2024 reads its figures.
_CHECKPOINTS = (30, 230, 250)


def he2018_1(
    rail: Rail = "dry", sweep: Sweep = Sweep(slip_max=0.5), noise: Noise = Noise()
) -> Scenario:
    """500 points, slip 0 to 0.5, on one rail (dry), estimated at 20 lengths (He Exp. 1)."""
    lengths = tuple(round(sweep.points * (j + 1) / _PREFIXES) for j in range(_PREFIXES))
    if lengths[0] < 5:
        raise InputError(
            f"--points {sweep.points} is too few for --scenario he2018-1; "
            "the first of its 20 lengths needs 5 points, so at least 100."
        )
    return Scenario(steady(RAILS, rail, _PREFIXES), sweep, noise, Growing(lengths), HE2018)


def qian2024(
    rail: Rail = "dry",
    slips: RandomSlips = RandomSlips(points=_CHECKPOINTS[-1]),
    noise: Noise = Noise(),
) -> Scenario:
    """250 samples on one rail (dry), slip uniform on 0 to 0.2, Kiencke with a0 known."""
    if slips.points < _CHECKPOINTS[0]:
        raise InputError(
            f"--points {slips.points} is too few for --scenario qian2024; "
            f"its first estimate is taken after {_CHECKPOINTS[0]} points."
        )
    lengths = (*(k for k in _CHECKPOINTS if k < slips.points), slips.points)
    rails = steady(KIENCKE_RAILS, rail, len(lengths))
    return Scenario(rails, slips, noise, Growing(lengths), QIAN2024)
