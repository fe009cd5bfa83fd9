"""A wheel whose slip velocity moves up and down across the peak, for the slope of the curve."""

import dataclasses

from adhesion_jax.errors import InputError
from adhesion_jax.options import Rail
from adhesion_jax.scenarios.base import Scenario
from adhesion_jax.scenarios.course import REPORT, Followed
from adhesion_jax.scenarios.excitation import VEHICLE_SPEED, Wave
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rail_process import steady
from adhesion_jax.scenarios.rails import HE2018, RAILS, peak_of

#: Number of reports between two checkpoints.
_SPACING = 10

#: The largest slip of the stream over the slip of the peak.
_BEYOND = 1.6

_KNOWN = dataclasses.replace(HE2018, by_sample=True, asked=("slope",))


def fang2018_slope(rail: Rail = "dry", wave: Wave = Wave(), noise: Noise = Noise()) -> Scenario:
    """1800 samples while slip velocity moves across the peak and back, for d mu/d v_s.

    The quantity sought is d mu/d v_s in s/m at the present slip velocity. It is close to zero
    beyond the peak, so that a relative error of it means little. It has no bound: it differs from
    sample to sample, and no curve that joins them is known.
    """
    if wave.points % REPORT or wave.points < REPORT * _SPACING:
        raise InputError(
            f"--points {wave.points} does not go with --scenario fang2018-slope; "
            f"it takes a multiple of {REPORT}, at least {REPORT * _SPACING}."
        )
    rails = steady(RAILS, rail, wave.points // REPORT)
    rails = dataclasses.replace(rails, conditions={"vehicle_speed_mps": VEHICLE_SPEED})
    if wave.slip_max is None:
        wave = dataclasses.replace(wave, slip_max=_BEYOND * peak_of(RAILS[rail])[0])
    course = Followed(wave.points, _SPACING, steady=False)
    return Scenario(rails, wave, noise, course, _KNOWN)
