"""Streams in which every sample is followed, on a rail that changes."""

import dataclasses

import numpy as np

from adhesion_jax.errors import InputError
from adhesion_jax.options import Rail
from adhesion_jax.scenarios.base import Scenario
from adhesion_jax.scenarios.course import REPORT, Followed
from adhesion_jax.scenarios.excitation import RandomSlips
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rail_process import RailProcess, of_many, steady
from adhesion_jax.scenarios.rails import KIENCKE_RAILS, QIAN2024, RAILS, peak_matched, peak_of

#: Number of reports between two checkpoints.
_SPACING = 5

#: A stream is followed at every sample.
_KNOWN = dataclasses.replace(QIAN2024, by_sample=True)

#: Share of the adhesion that is lost from 20 to 100 % relative humidity.
_LOST_TO_HUMIDITY = 0.17


def _followed(name: str, rail: RailProcess, slips: RandomSlips, noise: Noise) -> Scenario:
    """InputError if the samples do not divide into blocks and two equal halves."""
    if slips.points % (2 * REPORT) or slips.points < 10 * REPORT:
        raise InputError(
            f"--points {slips.points} does not go with --scenario {name}; "
            f"it takes a multiple of {2 * REPORT}, at least {10 * REPORT}."
        )
    return Scenario(rail, slips, noise, Followed(slips.points, _SPACING, steady=True), _KNOWN)


def qian2024_switch(slips: RandomSlips = RandomSlips(), noise: Noise = Noise()) -> Scenario:
    """1000 samples at random slips, from dry to common rail at sample 500 (Qian 2024, Fig. 4-6)."""
    half = slips.points // 2
    names = ("dry",) * half + ("common",) * half
    curves = of_many([KIENCKE_RAILS[name] for name in names], (-1,))
    rails = RailProcess(names[REPORT - 1 :: REPORT], curves)
    return _followed("qian2024-switch", rails, slips, noise)


def drift(
    rail: Rail = "dry", slips: RandomSlips = RandomSlips(), noise: Noise = Noise()
) -> Scenario:
    """1000 samples while humidity rises from 20 to 100 %, which takes 17 % of the adhesion.

    The peak sinks in proportion to humidity at a constant slip; the initial slope, which is
    elastic, stays.
    """
    names = steady(RAILS, rail, slips.points // REPORT).names
    peak_slip, peak = peak_of(RAILS[rail])
    left = 1 - _LOST_TO_HUMIDITY * np.arange(slips.points) / (slips.points - 1)
    curves = of_many([peak_matched(peak_slip, float(share * peak)) for share in left], (-1,))
    return _followed("drift", RailProcess(names, curves, drifts=True), slips, noise)
