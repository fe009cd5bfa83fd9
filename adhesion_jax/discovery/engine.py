"""From a campaign to findings: what the law lacks, how sure that is, and what it is worth."""

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np
from threadpoolctl import threadpool_limits

from adhesion_jax.curves import BASES, CURVES
from adhesion_jax.data.runs import RunSet
from adhesion_jax.discovery.findings.summary import summarise
from adhesion_jax.discovery.model.bases import bic, first_fits, fits_alone
from adhesion_jax.discovery.model.fitting import (
    Fitted,
    Setting,
    fit_model,
    nearly_fitted,
    own_noise,
    precise,
    squares,
)
from adhesion_jax.discovery.model.noise import white_noise
from adhesion_jax.discovery.model.problem import Problem, label_of, prepare
from adhesion_jax.discovery.model.slip import felt_in_adhesion, noise_of_slip, roughness
from adhesion_jax.discovery.search.catalogue import Entry, library_of
from adhesion_jax.discovery.search.judgement import doubtful, of_curve, of_levels, undecided, vetoed
from adhesion_jax.discovery.search.refinement import refined
from adhesion_jax.discovery.search.scans import torsion
from adhesion_jax.discovery.search.screening import compile_changes
from adhesion_jax.discovery.search.second_opinion import second_opinion
from adhesion_jax.discovery.search.selection import look_again, search
from adhesion_jax.discovery.search.state import Selection, parts_of, refreshed, settled
from adhesion_jax.discovery.types import Doubt, Findings, Opinion
from adhesion_jax.effects.conditions import calendar_of
from adhesion_jax.effects.wave import Wave
from adhesion_jax.errors import InputError
from adhesion_jax.records import Record

#: Share of the runs that no effect is selected on: it must raise their likelihood too.
_HELD_OUT = 0.25

#: How often is searched anew without what the held-out runs reject.
_SEARCHES = 3

#: Effects under which the sum of squared errors is more than so many times larger are none.
_WORSE = 1.01

#: A base curve whose BIC with the effects is larger by more than this is given up.
_BEHIND = 100.0

#: Where the levels of runs scatter by more than this beyond what was found, it is searched again
#: with every point alike. That must lower the sum of squared errors of runs held out to this share.
_WIDE, _FAR_BETTER = 0.1, 0.8

#: A campaign of more points is thinned: they would say no more of effects, only take longer.
_POINTS = 8_000


def _silent(_words: str, _share: float) -> None:
    """Where nobody looks."""


def _onwards(progress: Callable[[str, float], None]) -> Callable[[str, float], None]:
    """The same, told the largest share so far where a search begins again."""
    reached = 0.0

    def onwards(words: str, share: float) -> None:
        nonlocal reached
        reached = max(reached, share)
        progress(words, reached)

    return onwards


# The matrices are small: threads of the linear algebra, or of trees, wait more than they work.
@threadpool_limits.wrap(limits=1)
def discover(
    runs: RunSet,
    test: RunSet | None = None,
    base: str = "auto",
    seed: int = 0,
    progress: Callable[[str, float], None] = _silent,
    source: str = "",
    citation: str = "",
    slip_noise: float | None = None,
) -> Findings:
    """What effects the runs show that an adhesion curve alone does not.

    `base` names a curve, or auto for the choice by BIC. `test` is never used for fitting.
    `slip_noise` is the standard deviation of the noise of the wheel speed in m/s where it is known,
    else it is estimated.
    `progress` is told what is done, and which share of the whole that is.
    """
    began = time.perf_counter()
    progress = _onwards(progress)
    bases = _bases(runs, base)
    whole = with_run_order(runs)
    warnings = list(runs.warnings)
    thinned, thinning = _thinned(whole)
    warnings += thinning
    problem = prepare(thinned, calendar_of(thinned), runs.blocks)
    held_out = _held_out(problem, seed)
    progress("fitting the base curves", 0.05)
    alone, fits = _started(problem, held_out, bases)
    exact = fits
    noise = None
    rough = roughness(thinned, min(exact.values(), key=bic), slip_noise)
    if rough is not None:
        corrected = prepare(thinned, problem.calendar, runs.blocks, rough.effect)
        _, expected = _started(corrected, held_out, bases)
        noise = noise_of_slip(rough, exact, expected)
        if noise is not None or slip_noise is not None:
            fits = expected
    entries = library_of(min(fits.values(), key=bic).setting.problem)
    state, rejected = _searched(settled(fits, (), ()), entries, held_out, seed, progress)
    if noise is None and float(state.setting.noise.run_scatter) > _WIDE:
        evenly = settled(_evenly(alone), (), ())
        other, also = _searched(evenly, entries, held_out, seed, progress)
        if _missed(other, held_out) < _FAR_BETTER * _missed(state, held_out):
            state, rejected = other, also
    warnings += rejected
    doubts: Sequence[Doubt] = ()
    if base == "auto" and bases != ("level",):
        state, doubts = doubtful(state)
        doubts = (*doubts, *of_curve(state))
    # A wave in an imperfect form leaves lines in the spectrum of time.
    waves = any(isinstance(part, Wave) for part in parts_of(state.accepted))
    line = None if waves else torsion(state.fitted)
    progress("fitting all runs", 0.85)
    final = refined(_on_all_runs(state), seed)
    opinion = opinion_of(final, seed)
    if opinion is not None and opinion.columns:
        again, _ = vetoed(look_again(state, opinion.columns, seed), held_out, seed)
        if parts_of(again.accepted) != parts_of(state.accepted):
            final = refined(_on_all_runs(again), seed)
            opinion = opinion_of(final, seed)
    final = _precise(final)
    doubts = (*doubts, *undecided(final), *of_levels(final, seed))
    plain = _by_least_squares(problem, alone)
    if noise is None and not final.accepted and slip_noise is None:
        # Without an effect the law after is the law before, and only the noise is told better.
        final = final._replace(fits={plain.base: _with_noise_left(plain.fitted)}, base=plain.base)
    if final.accepted:
        same = final.setting.problem.slip_noise is None
        bare = plain if same else _by_least_squares(final.setting.problem, alone)
        if squares(final.fitted) > _WORSE * squares(bare.fitted):
            names = " and ".join(effect.name for effect in final.accepted)
            warnings.append(
                f"{names} would explain how neighbouring points differ, but not lower the error of "
                "adhesion; this is not counted as an effect."
            )
            line = None
            final = bare._replace(ranking=final.ranking, thresholds=final.thresholds)
    progress("measuring the errors", 0.92)
    return summarise(
        runs=runs,
        record=whole,
        test=None if test is None else with_run_order(test),
        test_rows=None if test is None else test.rows,
        plain=plain,
        slip_noise=noise,
        final=final,
        line=line,
        warnings=warnings,
        doubts=doubts,
        opinion=opinion,
        seed=seed,
        source=source,
        citation=citation,
        began=began,
    )


def _searched(
    state: Selection,
    entries: Sequence[Entry],
    held_out: np.ndarray,
    seed: int,
    progress: Callable[[str, float], None],
) -> tuple[Selection, list[str]]:
    """What the search finds and the runs held out confirm, and why they rejected the rest."""
    words: dict[str, str] = {}
    for _ in range(_SEARCHES):
        state = search(state, entries, seed, progress)
        progress("judging what was found", 0.75)
        state, rejected = vetoed(state, held_out, seed)
        words |= rejected
        if not rejected:
            break
        # What was rejected may have stood in the way of its like.
        entries = tuple(entry for entry in entries if entry.name not in rejected)
    return state, list(words.values())


def _evenly(alone: Mapping[str, Fitted]) -> Mapping[str, Fitted]:
    """Fits of a problem in which every point counts alike.

    Where what is missing moves the levels of runs, a noise in which these are as good as free
    follows what happens within the runs. There a cause may look like another, because its column
    is noisy or it acts in two ways, and then it would miss the levels and give way to lesser ones.
    """

    def even(fitted: Fitted) -> Fitted:
        problem = fitted.setting.problem._replace(even=True)
        return fitted._replace(setting=fitted.setting._replace(problem=problem))

    return {name: even(fitted) for name, fitted in alone.items()}


def _missed(state: Selection, held_out: np.ndarray) -> float:
    """The sum of squared errors of the runs held out."""
    problem = state.setting.problem
    error = (state.fitted.adhesion - np.asarray(problem.data.adhesion)) * problem.points
    return float((error[held_out] ** 2).sum())


def _bases(runs: RunSet, base: str) -> tuple[str, ...]:
    sizes = np.abs(np.asarray(runs.record.slip)[np.asarray(runs.record.mask)])
    if np.ptp(sizes) < 1e-6 * max(float(sizes.max()), 1e-300):
        return ("level",)
    known = runs.record.conditions
    if base == "auto":
        return tuple(
            name
            for name, curve in BASES.items()
            if curve.AUTOMATIC and all(need in known for need in curve.NEEDS)
        )
    if base not in CURVES:
        raise InputError(f"--base {base} is not known; name one of {', '.join(CURVES)}, or auto.")
    missing = [name for name in CURVES[base].NEEDS if name not in known]
    if missing:
        raise InputError(
            f"--base {base} needs the column {' and '.join(missing)}; add it or name another curve."
        )
    return (base,)


def with_run_order(runs: RunSet) -> Record:
    """The record with the order of its runs as a condition: by their numbers, if they are some."""
    try:
        order = np.array([float(name) for name in runs.names])
    except ValueError:
        order = np.arange(len(runs.names), dtype=float)
    shape = runs.record.slip.shape
    column = jnp.broadcast_to(jnp.asarray(order)[:, None], shape)
    return runs.record._replace(conditions={**runs.record.conditions, "run_order": column})


def _thinned(record: Record) -> tuple[Record, list[str]]:
    points = int(np.asarray(record.mask).sum())
    every = -(-points // _POINTS)
    if every == 1:
        return record, []
    return jax.tree.map(lambda column: column[:, ::every], record), [
        f"Of {points} points every {every}. was used to find effects, and all to measure errors; "
        "effects that act within a few samples may be missed."
    ]


def _held_out(problem: Problem, seed: int) -> np.ndarray:
    """Which runs are held out, drawn at random, [runs]."""
    runs = problem.points.shape[0]
    chosen = np.random.default_rng([seed, 7]).permutation(runs)[: round(_HELD_OUT * runs)]
    return np.isin(np.arange(runs), chosen)


def opinion_of(state: Selection, seed: int) -> Opinion | None:
    """What boosted trees see in the residual of a law; of blocks of one run nothing is asked."""
    problem = state.setting.problem
    if problem.blocks:
        return None
    inside = np.asarray(state.setting.noise.weight) > 0
    slip = np.asarray(problem.data.slip)[inside]
    columns = np.asarray(problem.data.columns)
    features = {
        label_of(name, problem.measured): columns[place][inside]
        for place, name in enumerate(problem.columns)
    }
    own = {"slip_ratio": np.abs(slip), "mode": np.sign(slip)}
    residual = (np.asarray(problem.data.adhesion) - state.fitted.adhesion)[inside] * np.sign(slip)
    runs = np.nonzero(inside)[0]
    return second_opinion({**features, **own}, residual, runs, tuple(own), seed)


def _started(
    problem: Problem, held_out: np.ndarray, bases: Sequence[str]
) -> tuple[Mapping[str, Fitted], Mapping[str, Fitted]]:
    """Every base curve alone on the runs that are not held out: every point alike, and each curve
    with its own noise.
    """
    weight = np.where(held_out[:, None], 0.0, problem.points)
    adhesion = np.asarray(problem.data.adhesion)
    sigma = 0.1 * float(np.sqrt(np.mean(adhesion[weight > 0] ** 2)))
    white = Setting(problem, white_noise(weight, max(sigma, 1e-12)), adhesion)
    if problem.slip_noise is not None:
        plain = [name for name in bases if not BASES[name].NEEDS]
        white = felt_in_adhesion(problem, white.noise, plain or bases)
    with ThreadPoolExecutor(1) as pool:
        # Compiling the two programs is most of a first search: let them be compiled side by side.
        compiled = pool.submit(compile_changes, white, bases[0])
        alone = fits_alone(white, bases)
        fits = first_fits(alone)
        compiled.result()
    return alone, fits


def _by_least_squares(problem: Problem, alone: Mapping[str, Fitted]) -> Selection:
    """The best curve without effects, every point alike, from where each was so on fewer runs.

    Where something is missing, noise is no noise, and a fit that allows for it may miss the data.
    """
    adhesion = np.asarray(problem.data.adhesion)
    white = Setting(problem, white_noise(problem.points, float(np.std(adhesion))), adhesion)
    fits = {
        name: nearly_fitted(white, name, fitted.base_values.tolist(), ())
        for name, fitted in alone.items()
    }
    # Under one noise for all the likelihood is that of the noise of the best.
    sigma = np.sqrt(min(map(squares, fits.values())) / problem.points.sum())
    best = white._replace(noise=white_noise(problem.points, max(float(sigma), 1e-12)))
    fits = {
        name: fit_model(best, name, fitted.base_values.tolist(), ())
        for name, fitted in fits.items()
    }
    return Selection(fits, min(fits, key=lambda name: bic(fits[name])), (), ())


def _with_noise_left(fitted: Fitted) -> Fitted:
    """The same law with the noise that it leaves, whichever it was fitted under."""
    problem = fitted.setting.problem._replace(even=False)
    uneven = fitted._replace(setting=fitted.setting._replace(problem=problem))
    return fitted._replace(setting=own_noise(uneven))


def _precise(state: Selection) -> Selection:
    """The chosen curve with its effects, fitted until nothing moves."""
    fitted = precise(state.fitted)
    if fitted.setting.problem.even:
        fitted = _with_noise_left(fitted)
    accepted = refreshed(state.accepted, fitted.effects)
    return state._replace(fits={**state.fits, fitted.base: fitted}, accepted=accepted)


def _on_all_runs(state: Selection) -> Selection:
    """The same effects, fitted to all runs."""

    def whole(fitted: Fitted) -> Fitted:
        setting = fitted.setting
        noise = setting.noise._replace(weight=setting.problem.points)
        return fitted._replace(setting=setting._replace(noise=noise))

    # A third more runs do not make a curve the best that is far behind on these.
    least = bic(state.fitted) + _BEHIND
    fits = {name: whole(fitted) for name, fitted in state.fits.items() if bic(fitted) <= least}
    final = settled(fits, state.accepted, state.ranking)
    return final._replace(thresholds=state.thresholds)
