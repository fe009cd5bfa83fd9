"""From measured runs to findings: which effects the law lacks, and how far they lower its error."""

import time
from collections.abc import Callable, Container, Sequence
from hashlib import blake2b

import numpy as np
import scipy.stats

from adhesion_jax import runtime
from adhesion_jax.curves import BASES, CURVES
from adhesion_jax.data.condensing import alike, block_means, condensed, hidden_shares
from adhesion_jax.data.reading import POINTS
from adhesion_jax.data.runs import Rows, RunSet, cut_alike, in_blocks, with_run_time
from adhesion_jax.discovery.findings.summary import law_of, smoothing_of, summarise
from adhesion_jax.discovery.model.bases import best_alone
from adhesion_jax.discovery.model.course import (
    Course,
    as_measured,
    followed,
    noticeable,
    size_in_words,
    smoothed,
)
from adhesion_jax.discovery.model.echoes import echoes
from adhesion_jax.discovery.model.fitting import Setting, under
from adhesion_jax.discovery.model.noise import slip_noise_of
from adhesion_jax.discovery.model.prediction import gain, gain_of
from adhesion_jax.discovery.model.problem import Problem, prepare
from adhesion_jax.discovery.model.rows import predicted
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import Entry, library_of
from adhesion_jax.discovery.search.screening import least_p
from adhesion_jax.discovery.search.second_opinion import import_trees, known_of, second_opinion
from adhesion_jax.discovery.search.selection import nominated, search
from adhesion_jax.discovery.search.state import MOST_FORMS, Selection
from adhesion_jax.discovery.types import Findings, Opinion
from adhesion_jax.effects.conditions import calendar_of
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed

#: The slip counts as one value if it varies by less than this share of its size.
_ONE_SLIP = 1e-6

#: Shares of what jumps in the slip from row to row that are tried as noise of it.
_SHARES = (0.25, 0.5, 1.0)

#: Residuals of neighbouring rows are alike if their rank correlation has a smaller p than this.
_ALIKE = 0.05


def _never_falling(progress: Callable[[str, float], None]) -> Callable[[str, float], None]:
    """A `progress` whose share never falls: where a search begins again the largest one is kept."""
    reached = 0.0

    def never_falling(words: str, share: float) -> None:
        nonlocal reached
        reached = max(reached, share)
        progress(words, reached)

    return never_falling


@runtime.as_in_commands
def discover(
    runs: RunSet,
    test: RunSet | None = None,
    base: str | Sequence[str] = "auto",
    seed: int = 0,
    progress: Callable[[str, float], None] = runtime.silent,
    source: str = "",
    citation: str = "",
    slip_noise: float | None = None,
    correct: bool = False,
) -> Findings:
    """The effects that an adhesion curve lacks in the measured runs, with all that is reported.

    `base` names curves, or "auto" for those that do not fall with the speed, of which the one that
    fits best is taken. `test` is predicted, and never used for fitting. `seed` draws the runs that
    are held out and all resampling. `progress` is called with words and with the share of the whole
    that is done. `source` and `citation` are passed on to the findings. `slip_noise` is the
    standard deviation of the noise of the wheel speed in m/s if it is known; otherwise the noise of
    the slip is estimated. With `correct` the test runs are also predicted by the law with the trees
    of the second opinion on top, if these predict anything.

    Raises InputError for a base curve that is not known, or that needs a column the runs lack, for
    test runs that are training runs, and for a correction without test runs.
    """
    began, runs = time.perf_counter(), with_run_time(in_blocks(runs))
    if correct and test is None:
        raise InputError("--correct is of the predictions of test data; name them by --test.")
    if test is not None:
        refuse_training_runs(runs, test)
        test = with_run_time(test) if "run_time_s" in runs.whole.conditions else test
    import_trees()
    progress = _never_falling(progress)
    asked = (base,) if isinstance(base, str) else tuple(base)
    bases = _bases(runs, asked)
    blocks, measured = condensed(runs), as_measured(runs, slip_noise)
    progress("fitting the base curves", 0.02)
    noise = measured.noise if blocks is runs else slip_noise_of(blocks, slip_noise)
    plain = _without_effects(runs, blocks, noise.spread, bases)
    same = echoes(plain.fitted)
    unsmoothed, tests = plain, None
    course, blocks, plain = _on_course(measured, blocks, plain, bases)
    if course.runs is not runs:
        runs = course.runs
        if test is not None:
            share = course.noise.sigma / measured.noise.sigma
            tests = test, smoothed(as_measured(test, slip_noise), share).runs
            test = tests[1]
    problem = plain.setting.problem
    entries = [entry for entry in library_of(problem) if not same.keys() & {*entry.covariates}]
    final = search(plain, entries, seed, progress)
    falling = _falling(runs) if "auto" in asked and len(bases) > 1 else ()
    plain, final = _plainer(plain, final, falling, entries, seed, progress)
    progress("asking for a second opinion", 0.85)
    final, opinion = _with_opinion(final, entries, seed, same)
    warnings = [*runs.warnings, *_condensing_words(runs, blocks), *_test_words(runs, test)]
    warnings += [*same.values(), *_few_runs(problem), *_full_words(final)]
    warnings += _smoothing_words(course)
    if correct and (opinion is None or opinion.correction is None):
        warnings.append(f"No correction by boosted trees was made: {_without_trees(final)}")
    progress("measuring the errors", 0.95)
    found = summarise(course, blocks, plain, final, opinion, test, warnings, correct, seed, same)
    if course.runs is not measured.runs:
        found = found._replace(smoothing=smoothing_of(unsmoothed, plain, course, tests, seed))
    seconds = time.perf_counter() - began
    return found._replace(source=source, citation=citation, seconds=seconds)


def _with_opinion(
    state: Selection, entries: Sequence[Entry], seed: int, without: Container[str]
) -> tuple[Selection, Opinion | None]:
    """The state with effects of the columns that boosted trees name, and what they still predict.

    They do not know the columns `without`.
    """
    opinion = opinion_of(state, seed, without)
    for _ in range(rules.MOST_ROUNDS):
        if opinion is None or not opinion.columns:
            break
        more = nominated(state, entries, opinion, seed)
        if more is state:
            break
        state, opinion = more, opinion_of(more, seed, without)
    return state, opinion


def refuse_training_runs(runs: RunSet, test: RunSet) -> None:
    """InputError if a run of the test data is one of the training data, point for point."""
    known, judged = _contents(runs), cut_alike(runs, test)
    same = [known[content] for content in _contents(judged) if content in known]
    if same:
        count = len(judged.names)
        what = "block" if judged.blocks else "run"
        raise InputError(
            f"{len(same)} of the {count} {what}s of the test data "
            f"{'is' if len(same) == 1 else 'are'} in the training data as well (the first is "
            f"{same[0]}), and an error on what was fitted to says nothing of new runs; give other "
            "runs as test data, or none."
        )


def _contents(runs: RunSet) -> dict[bytes, str]:
    """What each run of some length holds, in a number of fixed length, and the name of the run."""
    found = {}
    for name, start, length in zip(runs.names, runs.starts, runs.lengths, strict=True):
        rows = slice(start, start + length)
        content = np.concatenate([runs.whole.slip[rows], runs.whole.adhesion[rows]])
        if length >= POINTS:  # a few rounded numbers may be equal by chance
            found[blake2b(content.data).digest()] = name
    return found


def _without_effects(
    runs: RunSet, blocks: RunSet, spread: np.ndarray, bases: tuple[str, ...]
) -> Selection:
    """The best curve alone; `spread` [points] is the noise of the slip.

    It is fitted a second time to blocks of rows, as if the slip stood still in each.
    """
    problem = _problem(blocks)
    spreads = np.zeros(problem.points.shape)
    spreads[problem.points > 0] = spread
    plain = Selection(best_alone(problem, spreads, bases))
    if blocks is not runs:
        problem = _problem(blocks._replace(whole=_straightened(plain, runs, blocks)))
        plain = Selection(best_alone(problem, spreads, (plain.base,)))
    return plain


def _on_course(
    measured: Course, blocks: RunSet, plain: Selection, bases: tuple[str, ...]
) -> tuple[Course, RunSet, Selection]:
    """The slip smoothed in time, its blocks, and the best curve alone over it.

    If adhesion does not follow it better than the slip as measured they are those given: what
    jumps from row to row may be noise, and it may be the slip.
    """
    best, course, others = -np.inf, measured, blocks
    for share in (1.0,) if measured.noise.given else _SHARES:
        smooth = smoothed(measured, share)
        moved = alike(smooth.runs, blocks)
        if not noticeable(plain.fitted, moved.whole.slip - blocks.whole.slip):
            continue
        spread = block_means(smooth.left.spread, smooth.runs, moved)
        other = _without_effects(smooth.runs, moved, spread, (plain.base,))
        gained = gain_of(followed(plain.fitted, other.fitted))
        if gained.total > max(gained.error, best):
            p = min(len(_SHARES) * float(scipy.stats.norm.sf(gained.deviate)), 1.0)
            best, course, others = gained.total, smooth._replace(p=p), moved
    if course is measured:
        return measured, blocks, plain
    spread = block_means(course.left.spread, course.runs, others)
    return course, others, _without_effects(course.runs, others, spread, bases)


def _smoothing_words(course: Course) -> list[str]:
    """That the slip is not as it was measured."""
    if course.runs is course.measured:
        return []
    p = "" if course.noise.given else f" (p = {course.p:.2g})"
    return [
        f"The slip is smoothed in time: adhesion follows its course better{p} than the signal with "
        f"its noise of {size_in_words(course.noise)}. The law, its errors and the figures but that "
        "of slip events are those of the smoothed slip; from a noisy one the law predicts worse."
    ]


def _test_words(runs: RunSet, test: RunSet | None) -> list[str]:
    """What reading the test data said, and reading the others did not."""
    told = () if test is None else (words for words in test.warnings if words not in runs.warnings)
    return [f"In the test data: {words}" for words in told]


def _problem(blocks: RunSet) -> Problem:
    record = blocks.record
    return prepare(record, calendar_of(record), blocks.blocks, blocks.weights, blocks.named)


def _few_runs(problem: Problem) -> list[str]:
    """What so few runs cannot show."""
    runs = problem.runs
    least = least_p(runs)
    if least <= rules.SIGNIFICANT:
        return []
    return [
        f"There are {runs} runs. What acts alike in all of them cannot be told from chance, since "
        f"no p can be below {least:.2g}: no effect can be claimed. Eight runs or more could."
    ]


def _full_words(final: Selection) -> list[str]:
    """That the search ended before it had looked for all that may be there."""
    if not final.full:
        return []
    return [
        f"The law consists of {len(final.fitted.effects)} forms, and to a law of {MOST_FORMS} or "
        "more a search adds none: further columns may have an effect that was not looked for."
    ]


def _straightened(plain: Selection, runs: RunSet, blocks: RunSet) -> Rows:
    """The blocks with the adhesion that they would have if the slip stood still in each.

    Where the slip moves within a block the curve bends, so that the mean adhesion is not that of
    the mean slip: the difference is that of the fitted curve.
    """
    law = law_of(plain, {})
    bends = block_means(predicted(law, runs), runs, blocks) - predicted(law, blocks)
    return blocks.whole._replace(adhesion=blocks.whole.adhesion - bends)


def _bases(runs: RunSet, asked: Sequence[str]) -> tuple[str, ...]:
    """The names of the base curves to choose from; InputError if one cannot be used."""
    sizes = np.abs(runs.whole.slip)
    if np.ptp(sizes) < _ONE_SLIP * max(float(sizes.max()), 1e-300):
        return ("level",)
    for name in asked:
        if name not in (*CURVES, "auto"):
            known = ", ".join(CURVES)
            raise InputError(f"The curve {name} is not known; name some of {known}, or auto.")
        needed = () if name == "auto" else CURVES[name].NEEDS
        missing = [column for column in needed if column not in runs.whole.conditions]
        if missing:
            raise InputError(
                f"The curve {name} needs the column {' and '.join(missing)}; add it or name "
                "another curve."
            )
    # What falls with the speed may be an effect: `_falling` has the curves that would hide it.
    automatic = [name for name, curve in BASES.items() if curve.AUTOMATIC and not curve.NEEDS]
    chosen = [automatic if name == "auto" else [name] for name in asked]
    return tuple(dict.fromkeys(name for names in chosen for name in names))


def _falling(runs: RunSet) -> tuple[str, ...]:
    """The curves of an automatic choice that need a column, where the runs have it."""
    measured = {*runs.whole.conditions}
    return tuple(
        name
        for name, curve in BASES.items()
        if curve.AUTOMATIC and curve.NEEDS and measured.issuperset(curve.NEEDS)
    )


def _plainer(
    plain: Selection,
    final: Selection,
    falling: Sequence[str],
    entries: Sequence[Entry],
    seed: int,
    progress: Callable[[str, float], None],
) -> tuple[Selection, Selection]:
    """The states without and with effects: those given, or those of the best of the curves named.

    `falling` are curves that fall with the slip velocity, such as Polach's with falling friction.
    An effect of the slip velocity beside another curve and such a curve alone describe nearly the
    same. The cause is named only if its law predicts runs left out surely better, or as well with a
    smaller departure: otherwise the fall is a matter of the curve.
    """
    if not falling:
        return plain, final
    steep = Selection(best_alone(plain.setting.problem, plain.setting.spread, falling))
    gained = gain(plain.fitted, under(_like(plain, steep), steep.fitted))
    if gained.deviate <= rules.SURE_ERRORS_OF_COLUMN:
        return plain, final
    other = search(steep, entries, seed, progress)
    ahead = gain(under(_like(final, other), other.fitted), final.fitted)
    bends = [state.setting.problem.bend for state in (other, final)]
    if ahead.total > ahead.error or (abs(ahead.total) <= ahead.error and bends[0] > bends[1]):
        return plain, final
    return steep, other


def _like(state: Selection, bent: Selection) -> Setting:
    """The weights of a state, with the departure of another."""
    return state.setting._replace(problem=bent.setting.problem)


def _condensing_words(runs: RunSet, blocks: RunSet) -> list[str]:
    """Sentences on the blocks of the search, and on the columns that vary within them."""
    if blocks is runs:
        return []
    rows, points = runs.whole.slip.size, blocks.whole.slip.size
    length = np.diff(blocks.places, append=rows)
    sentences = [
        f"Effects are searched for, and the law is fitted, in {points:,} blocks of {length.min()} "
        f"to {length.max()} neighbouring rows, by their means; errors and noise are those of all "
        f"{rows:,} rows."
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


def of_independent_blocks(state: Selection) -> bool:
    """Whether blocks, where there are no runs, may take their place: neighbours are not alike.

    So it is of rows in any order, and not in a log, where errors vary slowly.
    """
    residual = state.fitted.error[state.setting.problem.points > 0]
    alike = scipy.stats.spearmanr(residual[:-1], residual[1:])
    return not state.setting.problem.blocks or bool(alike.pvalue > _ALIKE)


def _without_trees(state: Selection) -> str:
    """Why what a law leaves is not corrected by trees."""
    runs, needed = state.setting.problem.runs, rules.FEWEST_RUNS
    if runs < needed:
        return f"{needed} runs would show whether they predict anything, and there are {runs}."
    if not of_independent_blocks(state):
        return (
            "the rows are one run in which neighbouring errors are alike, so that rows left out "
            "would not show whether they predict anything."
        )
    return "it is not sure enough that they predict anything of what the law leaves."


def opinion_of(state: Selection, seed: int, without: Container[str] = ()) -> Opinion | None:
    """What boosted trees predict of the residual of a law; None for a log of one run.

    They do not know the columns `without`.
    """
    if not of_independent_blocks(state):
        return None
    runs = np.nonzero(state.setting.problem.points > 0)[0]
    return second_opinion(*known_of(state, without), runs, ("slip_ratio", "mode"), seed)
