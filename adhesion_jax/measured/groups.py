"""Groups of rows: what tells them apart, and what each says by itself."""

import operator
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import jax
import numpy as np
import pandas as pd

from adhesion_jax.curves import CURVES
from adhesion_jax.data import Measured
from adhesion_jax.data.columns import GROUP
from adhesion_jax.data.understanding import no_column
from adhesion_jax.errors import InputError
from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.inference.rows import Rows
from adhesion_jax.inference.start import share_of
from adhesion_jax.measured.answer import NOT_KNOWN, Answer, Estimate, Fits, answered, fit_curves
from adhesion_jax.measured.comparison import MOST_GROUPS, Comparison, compared, split_that_predicts
from adhesion_jax.measured.vetoes import Judgement, judged, standing
from adhesion_jax.records import Record

#: The word for the best of all splits.
AUTO = "auto"

#: The most axles of which each is told by itself beside all of them.
MOST_AXLES = 8

#: Most groups that are fitted each by itself, and the fewest rows of one.
_MOST_FITTED, _FEWEST_ROWS = 8, 30


class Group(NamedTuple):
    """What the rows of one group say by themselves."""

    answer: Answer
    judgement: Judgement

    @property
    def mu_max(self) -> Estimate:
        """NaN with a veto; at least this where no peak is seen."""
        return standing(self.answer, self.judgement)[0]

    @property
    def slip_opt(self) -> Estimate:
        return standing(self.answer, self.judgement)[1]

    @property
    def status(self) -> str:
        """In words: why there is no answer, or no peak; empty where there is one."""
        return " ".join(self.judgement.vetoes) or self.judgement.why


class Split(NamedTuple):
    """The groups of rows that were compared, if any, and what was found of others."""

    comparison: Comparison | None
    groups: Mapping[str, Group]  # the peak of each by itself, where there are a few
    in_vain: Sequence[str] | None  # columns that were looked at, of which none predicts
    mixed: Comparison | None  # the levels by a column that nobody named and that predicts them


def asked_of(points: Measured, by: str | None) -> str | None:
    """What rows are compared by: where nothing is said, the axles, where there are a few."""
    if by is None and "axle" in points.table and 1 < points.table["axle"].nunique() <= MOST_AXLES:
        return "axle"
    return by


def split(
    points: Measured,
    by: str | None,
    labels: pd.Series | None,
    found: Fits,
    record: Record,
    run: np.ndarray,
    slip_noise: float | None,
    step_s: float | None,
) -> Split:
    """The groups by a column, whose `labels` these are, or by AUTO, the column that predicts best.

    `run` is the run of each row, and `step_s` the usual time between rows.
    """
    best, rows = found.curves[found.best], found.rows
    order = np.argsort(run, kind="stable")
    splits = {name: column.iloc[order] for name, column in candidates(points).items()}
    likeliest = split_that_predicts(best, rows, splits) if labels is None or by == "axle" else None
    in_vain = [*splits] if by == AUTO and likeliest is None else None
    if by == AUTO:
        by = likeliest
        labels = None if by is None else labels_of(points, by, run)
    mixed = None
    if likeliest is not None and likeliest != by:
        mixed = compared(best, rows, splits[likeliest], likeliest)
    if labels is None or by is None:
        return Split(None, {}, in_vain, mixed)
    comparison = compared(best, rows, labels.iloc[order], by)
    velocity = points.slip == "slip_velocity_mps"
    groups = each_by_itself(labels, found.curves, record, run, velocity, slip_noise, step_s)
    # What each group says by itself, NaN where it says nothing.
    own = [groups.get(str(name)) for name in comparison.table[by]]
    many, few = f"more than {_MOST_FITTED} groups", f"fewer than {_FEWEST_ROWS} rows"
    why = f"{many if len(own) > _MOST_FITTED else few}: not fitted by itself"
    none = (*NOT_KNOWN, np.nan, why)
    told = [none if one is None else (*one.mu_max, one.slip_opt.value, one.status) for one in own]
    names = [f"own_{name}" for name in ("mu_max", "mu_max_lo", "mu_max_hi", "slip_opt", "status")]
    table = comparison.table.join(pd.DataFrame(told, comparison.table.index, names))
    return Split(comparison._replace(table=table), groups, in_vain, mixed)


def labels_of(points: Measured, by: str, run: np.ndarray) -> pd.Series:
    """The group of every row, as text."""
    table = points.table
    taken_as = dict(zip(points.understood["column"], points.understood["taken_as"], strict=True))
    name = by if by in table else taken_as.get(by, GROUP)
    if name not in table and by != "run":
        names = dict.fromkeys([*table.columns.astype(str), "run"])
        raise no_column(points.name, f"{by} to compare by", by, [*names])
    column = table[name] if name in table else pd.Series(run + 1, table.index)
    labels = column.astype(str)
    count = labels.nunique()
    if count == 1:
        raise InputError(
            f"{points.name} has one value of {by} in the rows that are used, {labels.iloc[0]}, and "
            "no groups to compare."
        )
    if count > MOST_GROUPS:
        raise InputError(
            f"{points.name} has {count} groups by {by}; at most {MOST_GROUPS} can be compared."
        )
    if count == len(labels):
        raise InputError(
            f"Every row of {points.name} has a {by} of its own, so that no scatter within a group "
            "tells whether groups differ; name a column that several rows share."
        )
    return labels


def candidates(points: Measured) -> Mapping[str, pd.Series]:
    """The columns of a few labels or levels by which rows may be split."""
    table = points.table
    known = {*table.select_dtypes("category"), *points.covariates} - {"run"}
    names = [str(name) for name in table if name in known]
    few = [name for name in names if 2 <= table[name].nunique() <= _MOST_FITTED]
    return {name: table[name].astype(str) for name in few}


def branches_of(fit: MeasuredFit, rows: Rows) -> Comparison | None:
    """Traction and braking compared, where both are measured beyond the noise about slip 0."""
    size, braking = np.abs(rows.slip), rows.slip < 0
    aside = size > np.maximum(0.05 * size.max(), 4 * fit.slip_spread)
    branches = braking, ~braking
    count = [int(np.sum(aside & branch)) for branch in branches]
    reach = [float(size.max(initial=0.0, where=branch)) for branch in branches]
    if min(count) < max(20, 0.02 * sum(count)) or min(reach) < 0.3 * max(reach):
        return None
    # Points about slip 0, where noise turns the sign, belong to the branch before and do not count.
    last = np.maximum.accumulate(np.where(aside, np.arange(size.size), 0))
    own = rows._replace(design=np.where(aside, rows.design, 1e-9))
    names = np.where(braking[last], "braking", "traction")
    return compared(fit, own, pd.Series(names), "branch")


def each_by_itself(
    labels: pd.Series,
    fits: Mapping[str, MeasuredFit],
    record: Record,
    run: np.ndarray,
    velocity: bool,
    slip_noise: float | None,
    step_s: float | None,
) -> Mapping[str, Group]:
    """What each of a few groups says, whose curves are fitted to its rows alone, and judged so.

    They begin at the curves of all rows. A run that spans a change is cut there, but not where rows
    of groups stand in turn. `step_s` is the usual time between rows.
    """
    names = list(dict.fromkeys(labels))
    if len(names) > _MOST_FITTED:
        return {}
    starts = {name: share_of(fit.curve) for name, fit in fits.items()}
    starts.setdefault("kiencke", share_of(CURVES["kiencke"]))
    curves = {name: fit.law.curve for name, fit in fits.items()}
    order = np.argsort(run, kind="stable")
    codes = labels.to_numpy()[order]
    groups = {}
    for name in names:
        place = np.flatnonzero(codes == name)
        if place.size < _FEWEST_ROWS:
            continue
        own, gap = order[place], np.diff(place)
        apart = np.append(True, (np.diff(run[own]) != 0) | (gap > 2 * np.median(gap)))
        part = jax.tree.map(operator.itemgetter(own), record)
        pieces = np.cumsum(apart) - 1
        found = fit_curves(curves, part, pieces, velocity, slip_noise, starts=starts)
        answer = answered(found.curves)
        branches = branches_of(found.curves[found.best], found.rows)
        judgement = judged(found.curves, answer, found.rows, step_s, branches)
        groups[str(name)] = Group(answer, judgement)
    return groups
