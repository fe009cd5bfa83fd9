"""Streams in which every sample is followed, on a rail that changes or does not."""

import dataclasses

import numpy as np

from adhesion_jax.errors import InputError
from adhesion_jax.options import Rail, Then, Told, Truth
from adhesion_jax.scenarios.base import Scenario
from adhesion_jax.scenarios.change import Change
from adhesion_jax.scenarios.course import REPORT, Followed
from adhesion_jax.scenarios.excitation import Excitation, RandomSlips
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rail_process import RailProcess, of_many, steady
from adhesion_jax.scenarios.rails import as_unknown, changed, form_of, told_of

#: Number of reports between two checkpoints.
_SPACING = 5


def stream(
    rail: Rail = "dry",
    then: Then | None = None,
    truth: Truth = "kiencke",
    told: Told = "kiencke",
    change: Change = Change(),
    slips: Excitation = RandomSlips(),
    noise: Noise = Noise(),
) -> Scenario:
    """1000 samples at random slips on one rail (dry), or on another from the middle on.

    InputError if the samples do not divide into blocks and two equal halves.
    """
    points = slips.points
    if points % (2 * REPORT) or points < 10 * REPORT:
        raise InputError(
            f"--points {points} does not go with a stream; "
            f"it takes a multiple of {2 * REPORT}, at least {10 * REPORT}."
        )
    form, half = form_of(truth), points // 2
    names = [
        steady(form.rails, name, option=option).names[0]
        for option, name in (("rail", rail), ("then", then or rail))
    ]
    known = dataclasses.replace(told_of(told, truth, rail), by_sample=True)
    curves = [
        as_unknown(changed(truth, name, float(level), float(stretch)), known)
        for name, level, stretch in zip(np.repeat(names, half), *change.course(points), strict=True)
    ]
    at_once = change.recovery and change.fall
    of_half = (names[0], f"{names[1]}, recovering" if at_once else names[1])
    process = RailProcess(
        tuple(np.repeat(of_half, half // REPORT).tolist()),
        of_many(curves, (-1,)),
        form.conditions,
        drifts=bool(change.fall or change.shift or change.wave),
    )
    return Scenario(process, slips, noise, Followed(points, _SPACING, steady=True), known)


def qian2024_switch(slips: RandomSlips = RandomSlips(), noise: Noise = Noise()) -> Scenario:
    """1000 samples at random slips, from dry to common rail at sample 500 (Qian 2024, Fig. 4-6)."""
    return stream("dry", "common", slips=slips, noise=noise)
