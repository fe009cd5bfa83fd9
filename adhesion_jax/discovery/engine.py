"""From measured runs to findings: which effects the law lacks, and how far they lower its error."""

import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from adhesion_jax import runtime
from adhesion_jax.curves import BASES, CURVES
from adhesion_jax.data.condensing import condensed, hidden_shares
from adhesion_jax.data.runs import RunSet
from adhesion_jax.discovery.findings.summary import ranges_of, summarise
from adhesion_jax.discovery.model.bases import bic, first_fits, fits_alone
from adhesion_jax.discovery.model.fitting import (
    Fitted,
    Setting,
    fit_model,
    nearly_fitted,
    precise,
    squares,
    with_noise_left,
)
from adhesion_jax.discovery.model.noise import shared_part, white_noise
from adhesion_jax.discovery.model.problem import Problem, corrected, label_of, prepare
from adhesion_jax.discovery.model.rows import bends
from adhesion_jax.discovery.model.slip import noise_of_slip, roughness, with_slip_errors
from adhesion_jax.discovery.model.training_runs import refuse_training_runs
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.all_rows import on_rows, sure_on_rows, with_noise_of_rows
from adhesion_jax.discovery.search.catalogue import Entry, library_of
from adhesion_jax.discovery.search.judgement import (
    confirmed,
    curve_doubts,
    doubtful,
    level_doubts,
    undecided,
)
from adhesion_jax.discovery.search.probes import compile_changes
from adhesion_jax.discovery.search.refinement import refined
from adhesion_jax.discovery.search.scans import torsion
from adhesion_jax.discovery.search.second_opinion import import_trees, second_opinion
from adhesion_jax.discovery.search.selection import search, search_columns
from adhesion_jax.discovery.search.state import Selection, parts_of, refreshed, settled
from adhesion_jax.discovery.types import Doubt, Findings, Opinion
from adhesion_jax.effects.conditions import calendar_of
from adhesion_jax.effects.wave import Wave
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed

#: The slip counts as one value if it varies by less than this share of its size.
_ONE_SLIP = 1e-6

#: Number of turns in which a base curve is fitted to blocks of rows, and what its bend makes of the
#: slip that moves within a block is taken from their mean adhesion.
_TURNS_OF_BLOCKS = 3

#: Standard deviation of the noise of the first fits, relative to the adhesion.
_FIRST_SIGMA = 0.1


def _never_falling(progress: Callable[[str, float], None]) -> Callable[[str, float], None]:
    """A `progress` whose share never falls: where a search begins again the largest one is kept."""
    reached = 0.0

    def never_falling(words: str, share: float) -> None:
        nonlocal reached
        reached = max(reached, share)
        progress(words, reached)

    return never_falling


# The matrices are small: several threads of the linear algebra, or of the trees, would be slower.
@threadpool_limits.wrap(limits=1)
def discover(
    runs: RunSet,
    test: RunSet | None = None,
    base: str = "auto",
    seed: int = 0,
    progress: Callable[[str, float], None] = runtime.silent,
    source: str = "",
    citation: str = "",
    slip_noise: float | None = None,
) -> Findings:
    """The effects that an adhesion curve lacks in the measured runs, with all that is reported.

    `base` names a curve, or is "auto" for a choice by BIC. `test` is predicted, and never used for
    fitting. `seed` draws the runs that are held out and all resampling. `progress` is called with
    words and with the share of the whole that is done. `source` and `citation` are passed on to
    the findings. `slip_noise` is the standard deviation of the noise of the wheel speed in m/s if
    it is known; otherwise the noise of the slip is estimated.

    Raises InputError for a base curve that is not known, or that needs a column the runs lack, and
    for test runs that are training runs.
    """
    began = time.perf_counter()
    if test is not None:
        refuse_training_runs(runs, test)
    import_trees()
    progress = _never_falling(progress)
    bases = _bases(runs, base)
    blocks = condensed(runs)
    warnings = [*runs.warnings, *_condensing_words(runs, blocks)]
    if test is not None:
        told = (words for words in test.warnings if words not in runs.warnings)
        warnings += [f"In the test data: {words}" for words in told]
    record = blocks.record
    problem = prepare(record, calendar_of(record), runs.blocks, worth=blocks.weights)
    held_out = _held_out(problem, seed)
    progress("fitting the base curves", 0.02)
    alone, fits = _started(problem, held_out, bases)
    for turn in range(_TURNS_OF_BLOCKS if blocks is not runs else 0):
        progress("fitting the base curves", 0.02 + 0.02 * turn)
        best = min(fits.values(), key=bic)
        adhesion = blocks.whole.adhesion - bends(best, runs, blocks)
        record = blocks._replace(whole=blocks.whole._replace(adhesion=adhesion)).record
        problem = prepare(
            record, problem.calendar, runs.blocks, worth=blocks.weights, shared=_shared(best)
        )
        alone, fits = _started(problem, held_out, bases)
    exact = fits
    noise = None
    rough = roughness(record, min(exact.values(), key=bic), slip_noise)
    if rough is not None:
        seen = corrected(problem, record, rough.effect)
        _, expected = _started(seen, held_out, bases)
        noise = noise_of_slip(rough, exact, expected)
        if noise is not None or slip_noise is not None:
            fits = expected
    entries = library_of(min(fits.values(), key=bic).setting.problem)
    state, rejected = _searched(settled(fits, (), ()), entries, held_out, seed, progress)
    if noise is None and float(state.setting.noise.run_scatter) > rules.WIDE_RUN_SCATTER:
        evenly = settled(_evenly(alone), (), ())
        other, also = _searched(evenly, entries, held_out, seed, progress)
        enough = rules.CLEARLY_FEWER_SQUARES * _held_out_squares(state, held_out)
        if _held_out_squares(other, held_out) < enough:
            state, rejected = other, also
    warnings += rejected
    doubts: Sequence[Doubt] = ()
    if base == "auto" and bases != ("level",):
        state, doubts = doubtful(state)
        doubts = (*doubts, *curve_doubts(state))
    # A wave along the track whose form is inexact leaves lines in the spectrum over time.
    waves = any(isinstance(part, Wave) for part in parts_of(state.accepted))
    line = None if waves else torsion(state.fitted)
    progress("fitting all runs", 0.85)
    final = refined(_on_all_runs(state), seed)
    opinion = opinion_of(final, seed)
    if opinion is not None and opinion.columns:
        again, _ = confirmed(search_columns(state, opinion.columns, seed), held_out, seed)
        if parts_of(again.accepted) != parts_of(state.accepted):
            final = refined(_on_all_runs(again), seed)
            opinion = opinion_of(final, seed)
    final = _precise(final)
    doubts = (*doubts, *undecided(final), *level_doubts(final, seed))
    plain = _by_least_squares(problem, alone)
    ranges = ranges_of(problem, runs)
    rows = None if blocks is runs else runs
    progress("fitting all rows", 0.9)
    plain, plain_rows = on_rows(plain, rows, ranges, white=True)
    final, final_rows, unsure = sure_on_rows(final, rows, ranges)
    warnings += unsure
    if final.accepted:
        same = final.setting.problem.slip_noise is None
        bare = plain if same else _by_least_squares(final.setting.problem, alone)
        if squares(final.fitted) > rules.MOST_SQUARES_TIMES * squares(bare.fitted):
            names = " and ".join(effect.name for effect in final.accepted)
            warnings.append(
                f"{names} would explain how neighbouring points differ, but not lower the error of "
                "adhesion; this is not counted as an effect."
            )
            line = None
            final = bare._replace(ranking=final.ranking, thresholds=final.thresholds)
            final, final_rows = on_rows(final, rows, ranges, white=True)
    elif final.setting.problem.slip_noise is None:
        # Without an effect the law after is the law before; only the noise is estimated better.
        left, final_rows = with_noise_of_rows(plain, plain_rows, rows, ranges)
        final = final._replace(fits=left.fits, base=left.base)
    progress("measuring the errors", 0.95)
    return summarise(
        runs=runs,
        blocks=blocks,
        test=test,
        plain=plain,
        slip_noise=noise,
        final=final,
        plain_rows=plain_rows,
        final_rows=final_rows,
        ranges=ranges,
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
    """The state with the effects that held-out runs confirm, and a sentence on each rejection."""
    words: dict[str, str] = {}
    for _ in range(rules.MOST_SEARCHES):
        state = search(state, entries, seed, progress)
        progress("judging what was found", 0.75)
        state, rejected = confirmed(state, held_out, seed)
        words |= rejected
        if not rejected:
            break
        # A rejected effect may have displaced a similar one: search again without it.
        entries = tuple(entry for entry in entries if entry.name not in rejected)
    return state, list(words.values())


def _evenly(alone: Mapping[str, Fitted]) -> Mapping[str, Fitted]:
    """The same fits, of a problem in which every point counts alike.

    If a missing effect moves the levels of the runs, the estimated run scatter is so large that the
    levels are nearly free, and only changes within the runs count. Within runs an effect may look
    like another one, because its column is noisy or it acts in two ways; the search would then
    accept lesser effects that do not explain the levels.
    """

    def even(fitted: Fitted) -> Fitted:
        problem = fitted.setting.problem._replace(even=True)
        return fitted._replace(setting=fitted.setting._replace(problem=problem))

    return {name: even(fitted) for name, fitted in alone.items()}


def _held_out_squares(state: Selection, held_out: np.ndarray) -> float:
    """Sum of squared errors of the held-out runs; `held_out` is a mask [runs]."""
    problem = state.setting.problem
    error = state.fitted.adhesion - np.asarray(problem.data.adhesion)
    return float((problem.points * error**2)[held_out].sum())


def _bases(runs: RunSet, base: str) -> tuple[str, ...]:
    """The names of the base curves to choose from; InputError if `base` cannot be used."""
    sizes = np.abs(runs.whole.slip)
    if np.ptp(sizes) < _ONE_SLIP * max(float(sizes.max()), 1e-300):
        return ("level",)
    known = runs.whole.conditions
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


def _condensing_words(runs: RunSet, blocks: RunSet) -> list[str]:
    """Sentences on the blocks of the search, and on the columns that vary within them."""
    if blocks is runs:
        return []
    rows, points = runs.whole.slip.size, blocks.whole.slip.size
    length = np.diff(blocks.places, append=rows)
    sentences = [
        f"Effects are searched for in {points:,} blocks of {length.min()} to {length.max()} "
        f"neighbouring rows, by their means; what is found is fitted to all {rows:,} rows and "
        "tested on them."
    ]
    hidden = {
        name: share
        for name, share in hidden_shares(runs, blocks).items()
        if share > rules.HIDDEN_SHARE
    }
    if hidden:
        told = listed([f"{name} ({100 * share:.0f} %)" for name, share in hidden.items()])
        sentences.append(
            f"Much of the variance of {told} is within these blocks: an effect of such a column "
            "that acts faster than a block lasts may be missed."
        )
    return sentences


def _held_out(problem: Problem, seed: int) -> np.ndarray:
    """A mask of the runs that are held out, drawn at random, [runs]."""
    runs = problem.points.shape[0]
    chosen = np.random.default_rng([seed, 7]).permutation(runs)[
        : round(rules.SHARE_HELD_OUT * runs)
    ]
    return np.isin(np.arange(runs), chosen)


def opinion_of(state: Selection, seed: int) -> Opinion | None:
    """What boosted trees predict of the residual of a law; None for blocks of one run."""
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
    """Every base curve alone, fitted to the runs that are not held out.

    Returns the fits in which every point counts alike, and those with a noise of each curve's own.
    """
    weight = np.where(held_out[:, None], 0.0, problem.points)
    adhesion = np.asarray(problem.data.adhesion)
    sigma = _FIRST_SIGMA * float(np.sqrt(np.mean(adhesion[weight > 0] ** 2)))
    white = Setting(problem, white_noise(weight, max(sigma, 1e-12)), adhesion)
    if problem.slip_noise is not None:
        plain = [name for name in bases if not BASES[name].NEEDS]
        white = with_slip_errors(problem, white.noise, plain or bases)
    # The threads of `runtime` have the precision of this one.
    with runtime.threads() as pool:
        # Most of the time of a first search is compiling: both programs are compiled side by side.
        compiled = pool.submit(compile_changes, white, bases[0])
        alone = fits_alone(white, bases)
        fits = first_fits(alone)
        compiled.result()
    return alone, fits


def _shared(fitted: Fitted) -> float:
    """The `shared` variance of blocks (`prepare`), by what a curve leaves in them."""
    problem = fitted.setting.problem
    inside = np.asarray(fitted.setting.noise.weight) > 0
    residual = (np.asarray(problem.data.adhesion) - fitted.adhesion)[inside]
    return shared_part(residual, problem.worth[inside])


def _by_least_squares(problem: Problem, alone: Mapping[str, Fitted]) -> Selection:
    """The best curve without effects by least squares over all runs; fits start from `alone`.

    If an effect is missing, the estimated noise contains it, and a fit under that noise may be far
    from the data.
    """
    adhesion = np.asarray(problem.data.adhesion)
    white = Setting(problem, white_noise(problem.points, float(np.std(adhesion))), adhesion)
    fits = {
        name: nearly_fitted(white, name, fitted.base_values.tolist(), ())
        for name, fitted in alone.items()
    }
    # The curves are compared under one noise, that of the best of them.
    sigma = np.sqrt(min(map(squares, fits.values())) / problem.points.sum())
    best = white._replace(noise=white_noise(problem.points, max(float(sigma), 1e-12)))
    fits = {
        name: fit_model(best, name, fitted.base_values.tolist(), ())
        for name, fitted in fits.items()
    }
    return Selection(fits, min(fits, key=lambda name: bic(fits[name])), (), ())


def _precise(state: Selection) -> Selection:
    """The state whose chosen curve with its effects is fitted to full precision."""
    fitted = precise(state.fitted)
    if fitted.setting.problem.even:
        fitted = with_noise_left(fitted)
    accepted = refreshed(state.accepted, fitted.effects)
    return state._replace(fits={**state.fits, fitted.base: fitted}, accepted=accepted)


def _on_all_runs(state: Selection) -> Selection:
    """The state refitted to all runs, those held out included."""

    def whole(fitted: Fitted) -> Fitted:
        setting = fitted.setting
        noise = setting.noise._replace(weight=setting.problem.points)
        return fitted._replace(setting=setting._replace(noise=noise))

    most = bic(state.fitted) + rules.HOPELESS_BIC
    fits = {name: whole(fitted) for name, fitted in state.fits.items() if bic(fitted) <= most}
    final = settled(fits, state.accepted, state.ranking)
    return final._replace(thresholds=state.thresholds)
