"""Entries of the library that rest on two columns at once."""

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from adhesion_jax.discovery.model.problem import Problem, label_of
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import Entry, entry_of
from adhesion_jax.effects import Surface
from adhesion_jax.effects.shape import ACTS_ON

#: A column that is a function of the slip: its effects bend the curve whatever part they act on.
_OF_SLIP = "slip_velocity_mps"


def surfaces(
    problem: Problem, columns: Iterable[str], beside: Sequence[str] = ()
) -> tuple[Entry, ...]:
    """A smooth surface over every pair of the columns, or of one of them and one of `beside`.

    Columns are given by their labels; unknown ones are skipped, and so are pairs of columns that
    are nearly proportional. There is an entry for each part of the curve that the surface may act
    on: with the slip velocity, only the level.
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
            if one == other or _same(problem, one, other):
                continue
            pair = {name: problem.flat[name] for name in sorted((one, other))}
            name = "product:" + "*".join(label_of(one, problem.measured) for one in pair)
            entries += [
                entry_of(name, [dataclasses.replace(start, acts_on=acts_on)], problem)
                for start in Surface.starts(pair)
                for acts_on in ACTS_ON
                if acts_on == "level" or _OF_SLIP not in pair
            ]
    return tuple(entries)


def _same(problem: Problem, one: str, other: str) -> bool:
    correlation = np.corrcoef(problem.flat[one], problem.flat[other])[0, 1]
    return bool(abs(correlation) > rules.SAME_COLUMN_CORRELATION)
