"""The findings of a finished search: effects with intervals, errors, and cautions."""

import time
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Float

from adhesion_jax.curves import BASES
from adhesion_jax.data.columns import COLUMNS
from adhesion_jax.data.runs import RunSet
from adhesion_jax.discovery.findings.alternatives import confounded, likenesses, proposals
from adhesion_jax.discovery.findings.cautions import absent, extrapolated, noise_words, untested
from adhesion_jax.discovery.findings.dependence import dependences
from adhesion_jax.discovery.findings.errors_by_run import errors
from adhesion_jax.discovery.model.fitting import Fitted, covariance, nearly_fitted
from adhesion_jax.discovery.model.noise import Noise
from adhesion_jax.discovery.model.prediction import held_out_loss
from adhesion_jax.discovery.model.program import base_curve, base_places, effect_places
from adhesion_jax.discovery.model.slip import NoisySlip
from adhesion_jax.discovery.search.catalogue import library_of
from adhesion_jax.discovery.search.scans import Torsion
from adhesion_jax.discovery.search.state import Accepted, Place, Selection, parts_of, slots_of
from adhesion_jax.discovery.types import (
    Doubt,
    Errors,
    Findings,
    FoundEffect,
    Interval,
    Opinion,
)
from adhesion_jax.effects import Cause, Effect, ShapeTerm, kind_of
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.programs import kept
from adhesion_jax.records import Record

#: Parameters of the noise that are reported.
_NOISE = ("sigma", "autocorrelation", "run_scatter")

#: Conditions that are not clipped to the range of the training data when a law is evaluated.
_UNBOUNDED = ("time_s", "slip_ratio", "mode", "wheel_angle_rad")


def summarise(
    *,
    runs: RunSet,
    record: Record,
    test: Record | None,
    test_rows: np.ndarray | None,
    plain: Selection,
    final: Selection,
    slip_noise: NoisySlip | None,
    line: Torsion | None,
    warnings: Sequence[str],
    doubts: Sequence[Doubt],
    opinion: Opinion | None,
    seed: int,
    source: str,
    citation: str,
    began: float,
) -> Findings:
    """The findings of two states fitted to all runs: without (`plain`) and with effects (`final`).

    `record` holds the runs as they were fitted, `test_rows` the row of each test point in its file,
    and `began` the time at which the search began, by `time.perf_counter`.
    """
    law, bare = law_of(final), law_of(plain)
    before, after = predicted(bare, record), predicted(law, record)
    train = _errors(record, before, after, seed)
    validation = _validation(record, before, after, plain, final, seed)
    tested = predictions = None
    if test is not None and test_rows is not None:
        test_before, test_after = predicted(bare, test), predicted(law, test)
        tested = _errors(test, test_before, test_after, seed)
        predictions = _predictions(test_rows, test_before, test_after)
    noise = final.setting.noise
    level = float(np.mean(np.asarray(record.adhesion)[np.asarray(record.mask)] ** 2))
    floor = float(np.sqrt(noise.sigma**2 + noise.run_scatter**2 * level))
    entries = library_of(final.setting.problem)
    alike = likenesses(final, entries)
    found = [*_slip_noise(slip_noise), *_found(final, validation), *_torsion(line, validation)]
    return Findings(
        source,
        final.base,
        _base_parameters(plain, final),
        law,
        floor,
        _noise(final),
        train,
        validation,
        tested,
        tuple(effect for effect in found if ":" not in effect.name),
        tuple(effect for effect in found if ":" in effect.name),
        final.ranking,
        confounded(final, alike),
        untested(final.setting.problem, runs),
        proposals(final, alike),
        dependences(final, seed),
        (
            *warnings,
            *noise_words(final),
            *extrapolated(final, law, None if test is None else test),
            absent(runs),
        ),
        _points(runs, record, before, after),
        predictions,
        time.perf_counter() - began,
        final.thresholds,
        runs.slip,
        citation,
        tuple(doubts),
        opinion,
        None if runs.blocks else _levels(runs, record, before, after, final.setting.noise),
    )


def law_of(state: Selection) -> CorrectedLaw:
    """The law of a state, with the ranges of its columns in the training data."""
    problem = state.setting.problem
    ranges = {
        name: (float(values.min()), float(values.max()))
        for name, values in problem.flat.items()
        if name not in _UNBOUNDED
    }
    inside = problem.points > 0
    needed = {name for effect in state.fitted.effects for name in effect.NEEDS}
    for name in needed & problem.constant - {*_UNBOUNDED}:
        value = float(np.asarray(problem.data.conditions[name])[inside][0])
        ranges[name] = (value, value)
    curve = base_curve(state.base, state.fitted.base_values)
    noisy = () if problem.slip_noise is None else (problem.slip_noise,)
    effects = (*noisy, *state.fitted.effects)
    return CorrectedLaw(curve, effects, ranges, problem.calendar)


def predicted(law: CorrectedLaw, record: Record) -> np.ndarray:
    """Adhesion of every point of every run, [runs, points]."""
    conditions = {name: jnp.asarray(values) for name, values in record.conditions.items()}
    return np.asarray(_of_runs(law, jnp.asarray(record.slip), conditions))


@kept()
def _of_runs(
    law: CorrectedLaw,
    slip: Float[Array, "runs points"],
    conditions: Mapping[str, Float[Array, "runs points"]],
) -> Float[Array, "runs points"]:
    return jax.vmap(law)(slip, conditions)


def _squares(record: Record, adhesion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sum of squared errors and number of points of each run."""
    mask = np.asarray(record.mask)
    error = np.where(mask, adhesion - np.asarray(record.adhesion), 0.0)
    return (error**2).sum(1), mask.sum(1)


def _errors(record: Record, before: np.ndarray, after: np.ndarray, seed: int) -> Errors:
    squares, points = _squares(record, before)
    return errors(squares, _squares(record, after)[0], points, seed)


def _validation(
    record: Record,
    before: np.ndarray,
    after: np.ndarray,
    plain: Selection,
    final: Selection,
    seed: int,
) -> Errors:
    """Errors of runs left out one by one: those of the fit times the growth of their loss."""
    squares, points = _squares(record, before)
    corrected = _squares(record, after)[0]
    return errors(squares * _growth(plain.fitted), corrected * _growth(final.fitted), points, seed)


def _growth(fitted: Fitted) -> np.ndarray:
    """The loss of each run when it is left out, over that of the fit to all runs, [runs]."""
    return np.where(fitted.loss > 0, held_out_loss(fitted) / np.maximum(fitted.loss, 1e-300), 1.0)


def _predictions(rows: np.ndarray, before: np.ndarray, after: np.ndarray) -> pd.DataFrame:
    """The predictions of the test file, one line for each of its rows, in its order."""
    inside = rows >= 0
    table = pd.DataFrame({"row": rows[inside], "base": before[inside], "corrected": after[inside]})
    return table.sort_values("row", ignore_index=True)


def _points(runs: RunSet, record: Record, before: np.ndarray, after: np.ndarray) -> pd.DataFrame:
    """The training points, one row a point."""
    inside = runs.rows >= 0
    names = np.array(runs.names, dtype=object)[:, None]
    columns = {
        "run": np.broadcast_to(names, runs.rows.shape)[inside],
        "slip": np.asarray(record.slip)[inside],
        "adhesion": np.asarray(record.adhesion)[inside],
        "before": before[inside],
        "after": after[inside],
    }
    more = {name: np.asarray(values)[inside] for name, values in runs.record.conditions.items()}
    return pd.DataFrame({**columns, **more})


def _levels(
    runs: RunSet, record: Record, before: np.ndarray, after: np.ndarray, noise: Noise
) -> pd.DataFrame:
    """The level of each run without and with the effects, relative to the prediction.

    It is the regression coefficient of the residual on the prediction. Its error is that of the
    noise within the run, (1 + r)/(1 - r) times the variance of independent points.
    """
    mask = np.asarray(record.mask)
    measured = np.asarray(record.adhesion)
    levels = [
        (np.where(mask, (measured - law) * law, 0.0).sum(1) / (law**2 * mask).sum(1))
        for law in (before, after)
    ]
    r = float(noise.autocorrelation)
    spread = float(noise.sigma) * np.sqrt((1 + r) / (1 - r))
    columns = {
        name: np.where(mask, np.asarray(values), 0.0).sum(1) / mask.sum(1)
        for name, values in record.conditions.items()
        if name != "run_order"
    }
    return pd.DataFrame(
        {
            "run": runs.names,
            "before": levels[0],
            "after": levels[1],
            "error": spread / np.sqrt((after**2 * mask).sum(1)),
            **columns,
        }
    )


def _base_parameters(plain: Selection, final: Selection) -> pd.DataFrame:
    """The parameters of the base curve, fitted without and with the effects."""
    rows: dict[str, dict[str, object]] = {}
    for state, when in ((plain, "before"), (final, "after")):
        curve = BASES[state.base]
        error = np.sqrt(np.maximum(np.diag(covariance(state.fitted)), 0.0))
        for place, name in zip(base_places(state.base), curve.free, strict=True):
            key = f"{state.base} {name}" if plain.base != final.base else name
            row = rows.setdefault(key, {"parameter": key, "unit": curve.PARAMETERS[name].unit})
            row[when] = float(state.fitted.values[place])
            row[f"{when}_se"] = float(error[place])
    columns = ["parameter", "unit", "before", "before_se", "after", "after_se"]
    return pd.DataFrame(list(rows.values())).reindex(columns=columns)


def _found(state: Selection, validation: Errors) -> list[FoundEffect]:
    """The effects with their intervals, and the error with each added to those before it."""
    intervals = _intervals(state)
    values = state.fitted.base_values.tolist()
    whole = float(held_out_loss(state.fitted).sum())
    found = []
    for number, effect in enumerate(state.accepted):
        first = parts_of(state.accepted[: number + 1])
        some = nearly_fitted(state.setting, state.base, values, first)
        ratio = float(held_out_loss(some).sum()) / max(whole, 1e-300)
        parameters, units = {}, {}
        for place, part in enumerate(effect.parts):
            prefix = "" if place == 0 else f"{kind_of(part)} "
            for name, described in part.PARAMETERS.items():
                if name in part.REFERENCES:
                    continue
                parameters[prefix + name] = intervals[number, place][name]
                column = effect.covariates[0] if effect.covariates else ""
                unit = COLUMNS[column].unit if column in COLUMNS else "unit of the column"
                units[prefix + name] = described.unit.replace("column", unit)
        formula = _formula(effect.parts[0])
        found.append(
            FoundEffect(
                effect.name,
                effect.members,
                effect.covariates,
                formula,
                parameters,
                units,
                effect.p,
                validation.after.value * float(np.sqrt(ratio)),
                _sentence(effect),
                acts_on(effect),
            )
        )
    return found


#: The curve mu(l) changed by a function g of columns, by the part of the curve that g acts on.
_BENT = {
    "level": "mu exp(g)",
    "slip": "mu(l exp(g))",
    "fall": "mu_max - (mu_max - mu) exp(g) beyond the peak",
}


def acts_on(effect: Accepted) -> str:
    """The part of the curve on which the effect acts: that of its first part, or the level."""
    first = effect.parts[0]
    return first.acts_on if isinstance(first, ShapeTerm) else "level"


def _formula(part: Effect) -> str:
    return f"{_BENT[part.acts_on]}, {part.FORMULA}" if isinstance(part, ShapeTerm) else part.FORMULA


def _sentence(effect: Accepted) -> str:
    """What the effect does, in words."""
    first = effect.parts[0]
    if not isinstance(first, Cause):
        return f"Structure against {' and '.join(effect.covariates)}; no physical cause is claimed."
    more = " and ".join(kind_of(part) for part in effect.parts[1:])
    refined = f" Its form is refined by {more}." if more else ""
    return f"{first.SENTENCE}{refined}"


def _intervals(state: Selection) -> Mapping[Place, Mapping[str, Interval]]:
    """95 % intervals of the parameters of every part, by parameter name."""
    error = np.sqrt(np.maximum(np.diag(covariance(state.fitted)), 0.0))
    at = {place: number for number, place in enumerate(state.fitted.places)}
    slots = slots_of(state.accepted)
    found = {}
    for slot, (part, effect) in enumerate(zip(slots, state.fitted.effects, strict=True)):
        found[part] = {
            name: Interval(value, value - 1.96 * error[at[place]], value + 1.96 * error[at[place]])
            for name, place in effect_places(slot, effect).items()
            for value in (float(getattr(effect, name)),)
        }
    return found


def _noise(state: Selection) -> Mapping[str, float]:
    noise = state.setting.noise
    return {name: float(getattr(noise, name)) for name in _NOISE}


def _slip_noise(noise: NoisySlip | None) -> list[FoundEffect]:
    if noise is None:
        return []
    kind = noise.effect
    what = (
        f"{kind.sigma:.2g} m/s of a wheel speed" if kind.falls_with else f"{kind.sigma:.2g} of slip"
    )
    sentence = (
        f"The slip signal has white noise of {what}: adhesion follows the slip expected from the "
        "neighbours in time, not the measured one. Points where the curve is steep count less."
    )
    return [
        FoundEffect(
            "slip_noise",
            ("slip_noise",),
            ("slip_ratio",),
            "mu(E[l])",
            {"sigma": noise.sigma, "roughness": Interval(float(kind.roughness), np.nan, np.nan)},
            {"sigma": "m/s" if kind.falls_with else "1", "roughness": "1/s^1.5"},
            noise.p,
            noise.rmse_after,
            sentence,
            "slip",
        )
    ]


def _torsion(line: Torsion | None, validation: Errors) -> list[FoundEffect]:
    if line is None:
        return []
    nothing = float("nan")
    return [
        FoundEffect(
            "torsion",
            ("torsion",),
            ("time_s",),
            "mu + a sin(2 pi f t + phase of the run)",
            {
                "frequency": Interval(line.frequency, nothing, nothing),
                "amplitude": Interval(line.amplitude, nothing, nothing),
            },
            {"frequency": "Hz", "amplitude": "1"},
            line.p,
            validation.after.value,
            "An oscillation whose phase differs from run to run: it is part of the noise, and no "
            "prediction can know it.",
        )
    ]
