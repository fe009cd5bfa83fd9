"""The scenarios of the benchmark, each composed of a rail, an excitation, noise and a course."""

import dataclasses

import numpy as np

from adhesion_jax.errors import InputError
from adhesion_jax.options import BlockCount, Rail, Then, Told, Truth
from adhesion_jax.scenarios.base import Scenario
from adhesion_jax.scenarios.course import REPORT, Apart, Followed, Growing
from adhesion_jax.scenarios.excitation import VEHICLE_SPEED, Excitation, RandomSlips, Sweep, Wave
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rail_process import Change, RailProcess, of_many, steady
from adhesion_jax.scenarios.rails import (
    HE2018,
    KIENCKE_RAILS,
    QIAN2024,
    RAILS,
    as_unknown,
    changed,
    form_of,
    peak_of,
    told_of,
)

#: Number of lengths at which the sequence of He et al. 2018, Exp. 1, is estimated.
_PREFIXES = 20

#: Numbers of samples after which Qian et al. 2024 reads its figures.
_CHECKPOINTS = (30, 230, 250)

#: Number of reports between two checkpoints of a stream, and of the wave of `fang2018_slope`.
_SPACING, _SPACING_OF_WAVE = 5, 10

#: The largest slip of that wave over the slip of the peak.
_BEYOND = 1.6


def single(
    rail: Rail = "dry",
    truth: Truth = "burckhardt",
    told: Told = "burckhardt",
    sweep: Sweep = Sweep(),
    noise: Noise = Noise(),
) -> Scenario:
    """One block of 500 points, slip 0 to 0.2, on one rail (dry).

    Where another form of curve is assumed than the rail has, the parameters of the assumed curve
    have no true values; the quantities of the peak have. Their bound is that of a method that
    assumes the true curve with its free parameters unknown, and holds for estimates without bias.
    The estimate of a curve with fewer parameters may come below it if its bias happens to be small.
    """
    form = form_of(truth)
    process = steady(form.rails, rail)
    known = told_of(told, truth, rail)
    curve = as_unknown(process.curve, known)
    process = dataclasses.replace(process, curve=curve, conditions=form.conditions)
    return Scenario(process, sweep, noise, Apart(sweep.points), known)


def he2018_blocks(
    blocks: BlockCount = 12, sweep: Sweep = Sweep(), noise: Noise = Noise()
) -> Scenario:
    """Blocks of 500 points, slip 0 to 0.2, dry, common and wet rail in turn (He Exp. 2 and 3)."""
    if blocks < 6:
        raise InputError(
            f"--blocks {blocks} is too few for --scenario he2018-blocks; "
            "each of its three rails needs two blocks, so at least 6."
        )
    order = tuple(RAILS)
    names = tuple(order[3 * block // blocks] for block in range(blocks))
    rails = RailProcess(names, of_many([RAILS[name] for name in names], (-1, 1)))
    return Scenario(rails, sweep, noise, Apart(sweep.points, blocks), HE2018)


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


def fang2018_slope(rail: Rail = "dry", wave: Wave = Wave(), noise: Noise = Noise()) -> Scenario:
    """1800 samples while slip velocity moves across the peak and back, for d mu/d v_s.

    The quantity sought is d mu/d v_s in s/m at the present slip velocity. It is close to zero
    beyond the peak, so that a relative error of it means little. It has no bound: it differs from
    sample to sample, and no curve that joins them is known.
    """
    if wave.points % REPORT or wave.points < REPORT * _SPACING_OF_WAVE:
        raise InputError(
            f"--points {wave.points} does not go with --scenario fang2018-slope; "
            f"it takes a multiple of {REPORT}, at least {REPORT * _SPACING_OF_WAVE}."
        )
    rails = steady(RAILS, rail, wave.points // REPORT)
    rails = dataclasses.replace(rails, conditions={"vehicle_speed_mps": VEHICLE_SPEED})
    if wave.slip_max is None:
        wave = dataclasses.replace(wave, slip_max=_BEYOND * peak_of(RAILS[rail])[0])
    known = dataclasses.replace(HE2018, by_sample=True, asked=("slope",))
    course = Followed(wave.points, _SPACING_OF_WAVE, steady=False)
    return Scenario(rails, wave, noise, course, known)
