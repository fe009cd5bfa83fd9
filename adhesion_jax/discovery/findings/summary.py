"""The findings of a finished search: effects with intervals, errors, and cautions."""

import dataclasses
from collections.abc import Container, Sequence

import numpy as np
import pandas as pd

from adhesion_jax.curves import BASES
from adhesion_jax.data.condensing import block_means
from adhesion_jax.data.runs import RunSet, cut_alike
from adhesion_jax.discovery.findings.alternatives import confounded, likenesses, proposals
from adhesion_jax.discovery.findings.cautions import (
    absent,
    ahead_words,
    beyond_points,
    extrapolated,
    noise_words,
    outlying,
    shape_words,
    untested,
)
from adhesion_jax.discovery.findings.dependence import dependences
from adhesion_jax.discovery.findings.errors_by_run import (
    by_run,
    errors,
    errors_of,
    left_out,
    squares,
    validation_of,
)
from adhesion_jax.discovery.findings.found import (
    found_effects,
    slip_noise_found,
    torsion_found,
    vetoed,
)
from adhesion_jax.discovery.model.course import Course
from adhesion_jax.discovery.model.fitting import covariance
from adhesion_jax.discovery.model.noise import left_by, noise_of
from adhesion_jax.discovery.model.packing import base_curve, base_places
from adhesion_jax.discovery.model.problem import Problem
from adhesion_jax.discovery.model.rows import Ranges, columns_of, predicted
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import library_of
from adhesion_jax.discovery.search.scans import torsion
from adhesion_jax.discovery.search.screening import least_p
from adhesion_jax.discovery.search.second_opinion import features_of, known_of, predicted_by_trees
from adhesion_jax.discovery.search.selection import undecided
from adhesion_jax.discovery.search.state import Accepted, Selection, parts_of
from adhesion_jax.discovery.types import Errors, Findings, Opinion
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.effects.wave import Wave
from adhesion_jax.inference.noise import RunNoise

#: What is reported of the noise.
_NOISE = ("sigma", "autocorrelation", "run_scatter", "slow_level")

#: Conditions that are not clipped to the range of the training data when a law is evaluated.
_UNBOUNDED = ("time_s", "slip_ratio", "mode", "wheel_angle_rad")


def summarise(
    course: Course,
    blocks: RunSet,
    plain: Selection,
    searched: Selection,
    opinion: Opinion | None,
    test: RunSet | None,
    warnings: Sequence[str],
    correct: bool,
    seed: int,
    same: Container[str],
) -> Findings:
    """The findings of a search, but for the names of its data and the time that it took.

    `course` has all rows, `blocks` are the blocks of them that the states without effects (`plain`)
    and with them were `searched` in: the rows, if they are few. Columns that are the `same` as slip
    or adhesion are no knowledge of trees.
    """
    runs = course.runs
    final, unnamed = vetoed(searched)
    problem = final.setting.problem
    ranges = ranges_of(problem, runs)
    law, bare = law_of(final, ranges), law_of(plain, ranges)
    before, after = predicted(bare, runs), predicted(law, runs)
    validation = validation_of(runs, before, after, plain.fitted, final.fitted, seed)
    trees = opinion if correct else None
    tested, with_trees, predictions = _on_test(runs, test, bare, law, trees, problem, seed)
    refuted = _refuted(final.accepted, validation, tested)
    beside: Errors | None = None
    ahead: list[str] = []
    if predictions is not None:
        if refuted:
            predictions = predictions.assign(corrected=predictions["base"])
        elif test is not None:
            beside, ahead = _beside_trees(runs, test, predictions, final, same, seed)
        predictions = predictions.sort_values("row", ignore_index=True)
    left = left_by(runs, law, after, final.setting.share, course.left)
    noise = noise_of(left)
    outside = extrapolated(final, law, runs, test)
    alike = likenesses(final, library_of(problem))
    effects = found_effects(final, validation)
    # A wave along the track whose form is inexact leaves lines in the spectrum over time.
    waves = any(isinstance(part, Wave) for part in parts_of(searched.accepted))
    line = torsion_found(None if waves else torsion(searched.fitted), validation)
    found = [*slip_noise_found(course, validation), *effects, *line]
    words = (*shape_words(final), *warnings, *noise_words(final, noise))
    far = tuple(sentence for _, sentence in outside)
    levels = None if runs.blocks else _levels(runs, before, after, noise)
    much_outside = (words for share, words in outside if share > rules.MUCH_OUTSIDE)
    foremost = *refuted, *beyond_points(final), *much_outside, *ahead
    return Findings(
        source="",
        base=final.base,
        base_parameters=_base_parameters(plain, final),
        law=dataclasses.replace(bare if refuted else law, slip=runs.slip),
        law_before=bare,
        # What runs left out were predicted to is no error that no law can reach.
        noise_floor=min(_noise_floor(runs, noise), validation.after.value),
        noise={name: float(getattr(noise, name)) for name in _NOISE},
        train=errors_of(runs, before, after, seed),
        validation=validation,
        test=tested,
        effects=tuple(effect for effect in found if ":" not in effect.name),
        unexplained=tuple(effect for effect in found if ":" in effect.name),
        ranking=final.ranking,
        confounded=confounded(final, alike),
        untested=untested(problem, runs),
        proposals=proposals(final, alike),
        dependences=dependences(final, seed),
        warnings=(*refuted, *unnamed, *ahead, *words, *far, absent(runs)),
        points=_points(runs, blocks, before, after),
        predictions=predictions,
        seconds=0.0,
        thresholds=final.thresholds,
        slip=runs.slip,
        doubts=undecided(searched),
        opinion=opinion,
        levels=levels,
        named=runs.named,
        foremost=(*foremost, *outlying(levels)),
        least_p=least_p(problem.runs),
        with_trees=with_trees,
        beside_trees=beside,
    )


def smoothing_of(
    measured: Selection,
    smooth: Selection,
    course: Course,
    tests: tuple[RunSet, RunSet] | None,
    seed: int,
) -> Errors:
    """The errors of the best curves alone with the slip as measured and smoothed (`Findings`).

    `tests` are the test runs with either slip.
    """

    def of(state: Selection, runs: RunSet, test: RunSet | None) -> np.ndarray:
        law = law_of(state, ranges_of(state.setting.problem, runs))
        if test is None:
            return left_out(runs, predicted(law, runs), state.fitted)
        return squares(cut_alike(course.runs, test), predicted(law, test))

    raw, settled = tests or (None, None)
    before, after = of(measured, course.measured, raw), of(smooth, course.runs, settled)
    lengths = (cut_alike(course.runs, raw) if raw else course.runs).lengths
    return errors(before, after, lengths, seed)


def _on_test(
    runs: RunSet,
    test: RunSet | None,
    bare: CorrectedLaw,
    law: CorrectedLaw,
    opinion: Opinion | None,
    problem: Problem,
    seed: int,
) -> tuple[Errors | None, Errors | None, pd.DataFrame | None]:
    """Errors of the law on a test set, and of the trees on top of it; the predictions of its rows.

    The predictions have one line for each row that is used of the test files, by run, with what was
    measured there. The errors are those of the runs of the test set, and those of blocks of its
    only run where blocks take the place of runs in training too.
    """
    if test is None:
        return None, None, None
    before, after = predicted(bare, test), predicted(law, test)
    parts = cut_alike(runs, test)
    columns, with_trees = {"base": before, "corrected": after}, None
    if opinion is not None and opinion.correction is not None:
        known = columns_of(problem.columns, problem.calendar, test)
        more = opinion.correction(features_of(problem, test.whole.slip, known))
        columns["with_trees"] = after + np.sign(test.whole.slip) * more
        with_trees = errors_of(parts, before, columns["with_trees"], seed)
    measured = {
        "row": test.places,
        "run": pd.Categorical.from_codes(test.run, pd.Index(test.names, dtype="str")),
        **{name: rows for name, rows in test.whole.conditions.items() if name == "time_s"},
        "slip": test.whole.slip,
        "adhesion": test.whole.adhesion,
    }
    table = pd.DataFrame({**measured, **columns})
    return (
        errors_of(parts, before, after, seed),
        with_trees,
        table,
    )


def _beside_trees(
    runs: RunSet,
    test: RunSet,
    predictions: pd.DataFrame,
    final: Selection,
    same: Container[str],
    seed: int,
) -> tuple[Errors | None, list[str]]:
    """The errors on a test set of the law with trees on top, and a sentence where these are better.

    `predictions` are those of the test rows by the curve alone and by the law. What the trees
    predict may be chance, and then they are worse than the law.
    """
    problem, parts = final.setting.problem, cut_alike(runs, test)
    if min(problem.runs, parts.lengths.size) < rules.FEWEST_RUNS:
        return None, []
    columns = columns_of(problem.columns, problem.calendar, test)
    there = features_of(problem, test.whole.slip, columns)
    more = predicted_by_trees(*known_of(final, same), there)
    before, after = (predictions[name].to_numpy() for name in ("base", "corrected"))
    with_trees = after + np.sign(test.whole.slip) * more
    removed = errors_of(parts, after, with_trees, seed).removed
    return errors_of(parts, before, with_trees, seed), ahead_words(removed)


def _noise_floor(runs: RunSet, noise: RunNoise) -> float:
    """The rms error of a law that misses nothing: its noise, and the levels of runs."""
    level = float(runs.whole.adhesion @ runs.whole.adhesion) / runs.whole.adhesion.size
    slow = noise.run_scatter**2 + noise.slow_level**2
    return float(np.sqrt(noise.sigma**2 + slow * level))


def ranges_of(problem: Problem, runs: RunSet) -> Ranges:
    """The ranges of the columns in all rows; of those that follow from others, in the blocks."""
    measured = runs.whole.conditions
    whole = {name: measured.get(name, values) for name, values in problem.flat.items()}
    return {
        name: (float(values.min()), float(values.max()))
        for name, values in whole.items()
        if name not in _UNBOUNDED and name not in problem.named
    }


def law_of(state: Selection, ranges: Ranges) -> CorrectedLaw:
    """The law of a state, with the ranges of its columns in the training data."""
    problem = state.setting.problem
    ranges = dict(ranges)
    inside = problem.points > 0
    needed = {name for effect in state.fitted.effects for name in effect.FACTS.needs}
    for name in needed & problem.constant - {*_UNBOUNDED}:
        value = float(np.asarray(problem.data.conditions[name])[inside][0])
        ranges[name] = (value, value)
    curve = base_curve(state.base, state.fitted.base_values, problem.data.span)
    return CorrectedLaw(curve, state.fitted.effects, ranges, problem.calendar)


def _refuted(accepted: Sequence[Accepted], validation: Errors, test: Errors | None) -> list[str]:
    """What says that the law is worse than the curve alone: then the curve alone is saved.

    Worse on runs left out is a larger error, as they may decide for the plainer law; on the test
    data, which may not, it is one that is surely larger, which few runs cannot show.
    """
    if not accepted:
        return []
    left_out = validation.removed.value, validation, "on runs left out"
    many = test is not None and test.runs >= rules.FEWEST_RUNS
    unseen = [(test.removed.high, test, "on the test data")] if test and many else []
    for removed, one, where in (*unseen, left_out):
        if removed < 0:
            return [
                f"With the effects the error {where} is larger, {one.after.value:.3g} "
                f"instead of {one.before.value:.3g}: the law that is saved is the curve "
                "alone."
            ]
    return []


def _points(runs: RunSet, blocks: RunSet, before: np.ndarray, after: np.ndarray) -> pd.DataFrame:
    """The points of the search, one row a point: a training row, or the mean of a block of them."""
    whole = blocks.whole
    columns = {
        "run": np.repeat(np.array(blocks.names, dtype=object), blocks.lengths),
        "slip": whole.slip,
        "adhesion": whole.adhesion,
        "before": block_means(before, runs, blocks),
        "after": block_means(after, runs, blocks),
    }
    return pd.DataFrame({**columns, **whole.conditions})


def _levels(runs: RunSet, before: np.ndarray, after: np.ndarray, noise: RunNoise) -> pd.DataFrame:
    """The level of each run without and with the effects, relative to the prediction.

    It is the regression coefficient of the residual on the prediction. Its error is that of the
    noise within the run, (1 + r)/(1 - r) times the variance of independent points.
    """
    measured = runs.whole.adhesion

    def product(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return by_run(runs, lambda rows: float(one[rows] @ other[rows]))

    squares = [product(law, law) for law in (before, after)]
    levels = [
        product(measured, law) / size - 1
        for law, size in zip((before, after), squares, strict=True)
    ]
    r = float(noise.autocorrelation)
    spread = float(noise.sigma) * np.sqrt((1 + r) / (1 - r))
    columns = {}
    for name, values in runs.whole.conditions.items():
        mean = np.add.reduceat(values, runs.starts) / runs.lengths
        if name not in runs.named or np.array_equal(np.repeat(mean, runs.lengths), values):
            columns[name] = mean
    return pd.DataFrame(
        {
            "run": runs.names,
            "before": levels[0],
            "after": levels[1],
            "error": spread / np.sqrt(squares[1]),
            **columns,
        }
    )


def _base_parameters(plain: Selection, final: Selection) -> pd.DataFrame:
    """The parameters of the base curve, fitted without and with the effects."""
    rows: dict[str, dict[str, object]] = {}
    for state, when in ((plain, "before"), (final, "after")):
        curve = BASES[state.base]
        error = np.sqrt(np.maximum(np.diag(covariance(state.fitted)), 0.0))
        # The departure is told by its largest size, and has no parameters of its own.
        for place, name in zip(base_places(state.base), curve.free, strict=False):
            row = rows.setdefault(name, {"parameter": name, "unit": curve.PARAMETERS[name].unit})
            row[when] = float(state.fitted.values[place])
            row[f"{when}_se"] = float(error[place])
    columns = ["parameter", "unit", "before", "before_se", "after", "after_se"]
    return pd.DataFrame(list(rows.values())).reindex(columns=columns)
