"""The library of the search: the effects that the data can test, and plain columns."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

from adhesion_jax.discovery.model.problem import Problem, label_of
from adhesion_jax.effects import EFFECTS, Covariate, Effect, ShapeTerm, Spline, family_of
from adhesion_jax.effects.shape import ACTS_ON


class Entry(NamedTuple):
    """A candidate of the search: a cause or a plain column, in the forms that are screened."""

    name: str
    starts: tuple[Effect, ...]
    covariates: tuple[str, ...]
    generic: bool  # a plain column, without a physical cause
    family: str
    acts_on: str = "level"  # the part of the curve: its level, its slip scale ("slip"), its "fall"


def library_of(problem: Problem) -> tuple[Entry, ...]:
    """Every effect that the data can test, then every column by a line and by a spline."""
    entries = [
        entry_of(name, effect.starts(problem.flat), problem)
        for name, effect in EFFECTS.items()
        if effect.SCREENED and not why_untested(name, problem)
    ]
    for kind in (Covariate, Spline):
        for column in problem.columns:
            entries += column_entries(kind, column, problem)
    return tuple(entry for entry in entries if entry.starts)


def column_entries(kind: type[ShapeTerm], column: str, problem: Problem) -> list[Entry]:
    """The entries of a column by one kind of term, one for each part of the curve it may act on."""
    name = f"covariate:{label_of(column, problem.measured)}"
    starts = kind.starts({column: problem.flat[column]})
    return [
        entry_of(name, [dataclasses.replace(start, acts_on=acts_on) for start in starts], problem)
        for acts_on in ACTS_ON
        # A function of the slip bends the curve whatever part of the curve it acts on.
        if acts_on == "level" or column != "slip_velocity_mps"
    ]


def entry_of(name: str, starts: Sequence[Effect], problem: Problem) -> Entry:
    """The entry of that name and those starts, with the columns that it rests on and its family."""
    if ":" in name:
        covariates = tuple(name.split(":", 1)[1].split("*"))
    else:
        rests_on = EFFECTS[name].RESTS_ON
        covariates = tuple(dict.fromkeys(label_of(column, problem.measured) for column in rests_on))
    acts_on = getattr(starts[0], "acts_on", "level") if starts else "level"
    return Entry(name, tuple(starts), covariates, ":" in name, family_of(name), acts_on)


def why_untested(name: str, problem: Problem) -> str:
    """Why the data cannot test the effect of that name; empty if they can."""
    effect = EFFECTS[name]
    if "time_s" in effect.NEEDS and not problem.in_time:
        return "acts within a run in time, and the data are no runs in time"
    needs = [need for need in effect.NEEDS if need != "time_s"]
    for need in needs:
        if need != "mode" and need not in problem.varying and need not in problem.constant:
            return f"needs the column {need}, which is absent"
    if not needs and "slip_ratio" in problem.constant:
        return "needs the slip to vary, which is constant"
    varies = not needs or any(need in problem.varying for need in needs)
    if not varies and "slip_ratio" not in effect.RESTS_ON:
        constant = next((need for need in needs if need in problem.constant), needs[0])
        return f"needs the column {constant} to vary, which is constant"
    return ""
