"""The rows a discovery reports, for a reader and for programs: errors, effects, candidates."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from adhesion_jax.discovery.types import Candidate, Findings, FoundEffect
from adhesion_jax.report.discovery.words import (
    axis,
    decision,
    error,
    errors_by_data,
    humanised,
    in_brackets,
    kind_of_run,
    percent,
)
from adhesion_jax.report.page import Table
from adhesion_jax.report.rendering import one_line
from adhesion_jax.wording import p_value, plus_minus


def errors_table(findings: Findings) -> Table:
    """Error before and after: training, cross-validation, test, and with trees on top."""
    kind = kind_of_run(findings)
    return Table(
        (f"{kind}s of", f"{kind}s", "error before", "error after", "squared error removed"),
        [
            (
                name,
                str(errors.runs),
                in_brackets(errors.before, error),
                in_brackets(errors.after, error),
                in_brackets(errors.removed, percent),
            )
            for name, errors in errors_by_data(findings).items()
        ],
        (f"{kind}s",),
    )


def effects_table(findings: Findings) -> Table:
    """One row for each parameter of an effect; a structure without a cause has one row in all."""
    rows: list[Sequence[str]] = []
    for effect, explained in _found(findings):
        parameters = [
            (f"{name} {in_brackets(interval)}", effect.units.get(name, ""))
            for name, interval in effect.parameters.items()
            if explained
        ] or [("non-parametric", "")]
        p = p_value(effect.p_adjusted, findings.least_p)
        facts = (title(effect, explained), p, error(effect.rmse_after))
        rows += [
            (*(facts if place == 0 else ("", "", "")), *parameter)
            for place, parameter in enumerate(parameters)
        ]
    return Table(("missing", "adjusted p", "error after", "parameters", "unit"), rows)


def title(effect: FoundEffect, explained: bool) -> str:
    return humanised(effect.name) if explained else one_line(axis(effect))


def parameters_table(effect: FoundEffect) -> Table:
    return Table(
        ("parameter", "value [95 % interval]", "unit"),
        [
            (name, in_brackets(interval), effect.units.get(name, ""))
            for name, interval in effect.parameters.items()
        ],
    )


def base_table(findings: Findings) -> Table:
    """The parameters of the base curve, before and after."""
    table = findings.base_parameters
    pairs = [
        [
            plus_minus(value, spread)
            + (" (held)" if np.isfinite(value) and not np.isfinite(spread) else "")
            for value, spread in zip(table[when], table[f"{when}_se"], strict=True)
        ]
        for when in ("before", "after")
    ]
    names, units = table["parameter"].astype(str), table["unit"].astype(str)
    return Table(
        ("parameter", "before ± standard error", "after ± standard error", "unit"),
        list(zip(names, *pairs, units, strict=True)),
    )


def ranking(findings: Findings) -> list[Candidate]:
    """The candidates round by round, the strongest first."""
    return sorted(findings.ranking, key=lambda row: (row.round, -np.nan_to_num(row.z, nan=-np.inf)))


def ranking_table(ranked: list[Candidate], least_p: float) -> Table:
    return Table(
        ("round", "candidate", "z", "adjusted p", "gain of log likelihood", "decision"),
        [
            (
                str(row.round + 1),
                humanised(row.name),
                f"{row.z:.2f}" if np.isfinite(row.z) else "",
                p_value(row.p_adjusted, least_p),
                plus_minus(row.gain, row.gain_se),
                decision(row.decision),
            )
            for row in ranked
        ],
        ("round", "z", "adjusted p", "gain of log likelihood"),
        folded=f"All {len(ranked)} candidates",
    )


#: Largest number of panels that can be read on a page.
_PANELS = 12


def residual_columns(findings: Findings) -> tuple[list[str], list[str]]:
    """Columns the residual is drawn against, those of the effects first, and all that vary."""
    points = findings.points
    rest = [name for name in points if name not in ("run", "adhesion", "before", "after")]
    # The slip stands in points under its own name as well as under that of its column.
    order = dict.fromkeys(
        "slip" if name == findings.slip else str(name)
        for name in (*_columns_of_effects(findings), "slip", *rest)
    )
    varying = [name for name in order if name in points and points[name].nunique() >= 2]
    return varying[:_PANELS], varying


def level_columns(findings: Findings) -> tuple[list[str], list[str]]:
    """Columns the levels of the runs are drawn against, as above, and all that differ by run."""
    levels = findings.levels
    if levels is None:
        return [], []
    rest = levels.select_dtypes("number").drop(
        columns=["run", "before", "after", "error"], errors="ignore"
    )
    order = dict.fromkeys(str(name) for name in (*_columns_of_effects(findings), *rest))
    # Means over runs of one constant differ by rounding.
    differing = [
        name
        for name in order
        if name in rest and np.ptp(levels[name]) > 1e-9 * np.abs(levels[name]).max()
    ]
    return differing[:_PANELS], differing


def shape_columns(findings: Findings) -> list[tuple[FoundEffect, str]]:
    """Effects that act on more than the level of the curve, with each column of theirs."""
    numeric = findings.points.select_dtypes("number")
    return [
        (effect, name)
        for effect, _ in _found(findings)
        if effect.acts_on != "level"
        for name in effect.covariates
        if name in numeric and name not in ("slip_ratio", "slip_velocity_mps", "time_s")
    ][:_PANELS]


def _columns_of_effects(findings: Findings) -> list[str]:
    return [name for effect, _ in _found(findings) for name in effect.covariates]


def _found(findings: Findings) -> list[tuple[FoundEffect, bool]]:
    """The effects that were found, then the structures, with whether a cause explains them."""
    every = (*findings.effects, *findings.unexplained)
    return [(effect, effect in findings.effects) for effect in every]


_EFFECT_COLUMNS = (
    *("effect", "explained", "acts_on", "parameter", "value", "lo", "hi", "unit"),
    *("p_adjusted", "rmse_after", "candidates", "columns", "sentence"),
)


def errors_frame(findings: Findings) -> pd.DataFrame:
    """A row for each kind of data: its runs, and the errors with the ends of their intervals."""
    rows: list[dict[str, object]] = []
    for kind, errors in errors_by_data(findings).items():
        row: dict[str, object] = {"data": kind, "runs": errors.runs}
        for name in ("before", "after", "removed"):
            interval = getattr(errors, name)
            row[name] = interval.value
            row[f"{name}_lo"], row[f"{name}_hi"] = interval.low, interval.high
        rows.append(row)
    return pd.DataFrame(rows)


def effects_frame(findings: Findings) -> pd.DataFrame:
    """A row for each parameter of an effect; of a structure without a cause one row in all."""
    rows: list[tuple[object, ...]] = []
    for effect, explained in _found(findings):
        known = [
            (name, *interval, effect.units.get(name, ""))
            for name, interval in effect.parameters.items()
            if explained
        ] or [("", np.nan, np.nan, np.nan, "")]
        first = (effect.name, explained, effect.acts_on)
        last = (
            *(effect.p_adjusted, effect.rmse_after),
            *(", ".join(effect.candidates), ", ".join(effect.covariates), effect.sentence),
        )
        rows += [(*first, *one, *last) for one in known]
    return pd.DataFrame(rows, columns=list(_EFFECT_COLUMNS))


def ranking_frame(findings: Findings) -> pd.DataFrame:
    """A row for each candidate, in the order of `ranking`; the columns are those of Candidate."""
    return pd.DataFrame(ranking(findings), columns=list(Candidate._fields))
