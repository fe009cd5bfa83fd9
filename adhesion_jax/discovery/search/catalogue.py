"""The library of the search: the effects that the data can test, plain columns, and pairs."""

import dataclasses
from collections.abc import Container, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from adhesion_jax.discovery.model.problem import Problem, label_of
from adhesion_jax.discovery.search import rules
from adhesion_jax.effects import (
    EFFECTS,
    Columns,
    Covariate,
    Effect,
    Labels,
    Memory,
    Periodic,
    ShapeTerm,
    Spline,
    family_of,
)
from adhesion_jax.effects.one_column import turn_of
from adhesion_jax.effects.shape import ACTS_ON

#: A column of no more distinct values has no spline.
_FEW = 5

#: What each kind of term may act on, if not on every part of the curve.
_SITES: Mapping[type[ShapeTerm], Sequence[str]] = {
    Labels: ("level", "slip"),
    Memory: ("level", "slip"),
}

#: A column that is a function of the slip: its effects bend the curve whatever part they act on.
_OF_SLIP = "slip_velocity_mps"

#: Why what acts in time is not tested in other data.
NO_TIME = "acts within a run in time, and the data are no runs in time"

#: Share of the variance of a column within runs above which it may have a memory. By hand.
_MOVING = 0.05


class Entry(NamedTuple):
    """A candidate of the search: a cause or a plain column, in the forms that are screened."""

    name: str
    starts: tuple[Effect, ...]
    covariates: tuple[str, ...]
    generic: bool  # a plain column, without a physical cause
    family: str
    acts_on: str = "level"  # one of ACTS_ON


def library_of(problem: Problem) -> tuple[Entry, ...]:
    """Every effect that the data can test, then every column in every form."""
    entries = [
        entry_of(name, effect.starts(problem.flat), problem)
        for name, effect in EFFECTS.items()
        if not why_untested(name, problem)
    ]
    for column in problem.columns:
        entries += forms_of_column(column, problem)
    return tuple(entry for entry in entries if entry.starts)


def forms_of_column(column: str, problem: Problem) -> list[Entry]:
    """A line, a spline, labels, a direction, a memory: what the values of the column allow."""
    label = label_of(column, problem.measured)
    if label in problem.named:
        return column_entries(Labels, column, problem)
    entries = column_entries(Covariate, column, problem)
    values = np.unique(problem.flat[column]).size
    if values > _FEW:
        entries += column_entries(Spline, column, problem)
    if values > 2:  # two numbers are told apart by a line
        entries += column_entries(Labels, column, problem)
    turn = turn_of(label)
    # Hours of more than a day count on, as those of operation.
    if turn and np.ptp(problem.flat[column]) <= turn:
        start = Periodic(0.01, 0.01, 1 / turn, column=column)
        entries.append(entry_of(f"covariate:{label}", [start], problem))
    if problem.in_time and not constant_within_runs(column, problem):
        entries += column_entries(Memory, column, problem)
    return [entry for entry in entries if entry.starts]


def constant_within_runs(column: str, problem: Problem) -> bool:
    """Whether hardly any of the variance of the column is within runs."""
    values = np.asarray(problem.data.columns[problem.columns.index(column)])
    inside = problem.points > 0
    count = np.maximum(inside.sum(axis=1), 1)
    mean = (values * inside).sum(axis=1) / count
    within = (((values - mean[:, None]) ** 2) * inside).sum()
    return bool(within <= _MOVING * np.var(problem.flat[column]) * inside.sum())


def column_entries(kind: type[ShapeTerm], column: str, problem: Problem) -> list[Entry]:
    """The entries of a column by one kind of term, one for each part of the curve it may act on."""
    name = f"covariate:{label_of(column, problem.measured)}"
    return _term_entries(kind, name, {column: problem.flat[column]}, problem)


def _term_entries(
    kind: type[ShapeTerm], name: str, columns: Columns, problem: Problem
) -> list[Entry]:
    """An entry for each part of the curve that a term over some columns may act on."""
    starts = kind.starts(columns)
    return [
        entry_of(name, [dataclasses.replace(start, acts_on=acts_on) for start in starts], problem)
        for acts_on in _SITES.get(kind, ACTS_ON)
        if acts_on == "level" or _OF_SLIP not in columns
    ]


def pair_entries(
    kind: type[ShapeTerm], problem: Problem, columns: Iterable[str], beside: Sequence[str] = ()
) -> tuple[Entry, ...]:
    """A term of that kind over every pair of the columns, or of one of them and one of `beside`.

    Columns are given by their labels; unknown ones are skipped, and so are pairs of columns that
    are nearly proportional. There is an entry for each part of the curve that the term may act on:
    with the slip velocity, only the level.
    """
    places = {
        label_of(name, problem.measured): name
        for name in problem.columns
        if name not in problem.named
    }
    chosen = [places[label] for label in dict.fromkeys(columns) if label in places]
    others = [places[label] for label in dict.fromkeys(beside) if label in places] or chosen
    entries = []
    for at, one in enumerate(chosen):
        for other in others if beside else chosen[at + 1 :]:
            if one == other:
                continue
            correlation = np.corrcoef(problem.flat[one], problem.flat[other])[0, 1]
            if abs(correlation) > rules.SAME_COLUMN_CORRELATION:
                continue
            pair = {name: problem.flat[name] for name in sorted((one, other))}
            name = "product:" + "*".join(label_of(one, problem.measured) for one in pair)
            entries += _term_entries(kind, name, pair, problem)
    return tuple(entries)


def entry_of(name: str, starts: Sequence[Effect], problem: Problem) -> Entry:
    """The entry of that name and those starts, with the columns that it rests on and its family."""
    if ":" in name:
        covariates = tuple(name.split(":", 1)[1].split("*"))
    else:
        rests_on = EFFECTS[name].FACTS.rests_on
        covariates = tuple(dict.fromkeys(label_of(column, problem.measured) for column in rests_on))
    acts_on = getattr(starts[0], "acts_on", "level") if starts else "level"
    return Entry(name, tuple(starts), covariates, ":" in name, family_of(name), acts_on)


def why_untested(name: str, problem: Problem, left_out: Container[str] = ()) -> str:
    """Why the data cannot test the effect of that name; empty if they can.

    `left_out` are columns that the data have and that are not used.
    """
    effect = EFFECTS[name]
    if "time_s" in effect.FACTS.needs and not problem.in_time:
        return NO_TIME
    needs = [need for need in effect.FACTS.needs if need != "time_s"]
    if needs == ["mode"] and "mode" in problem.flat:
        return "the curve of braking is one of its own: where it surely differs the verdict says so"
    for need in needs:
        if need != "mode" and need not in problem.flat and need not in problem.constant:
            lacks = "left out" if need in left_out else "absent"
            return f"needs the column {need}, which is {lacks}"
    if not needs and "slip_ratio" in problem.constant:
        return "needs the slip to vary, which is constant"
    varies = not needs or any(need in problem.flat for need in needs)
    if not varies and "slip_ratio" not in effect.FACTS.rests_on:
        constant = next((need for need in needs if need in problem.constant), needs[0])
        return f"needs the column {constant} to vary, which is constant"
    return ""
