"""Lines of several columns that stand still within runs, tested as one."""

from itertools import combinations

import numpy as np

from adhesion_jax.discovery.model.fitting import refitted
from adhesion_jax.discovery.model.prediction import gain
from adhesion_jax.discovery.model.problem import Problem
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import Entry, column_entries, constant_within_runs
from adhesion_jax.discovery.search.probes import Null, directions_of
from adhesion_jax.discovery.search.screening import adjusted, orthonormal, signed
from adhesion_jax.discovery.search.state import (
    Selection,
    all_but,
    as_effect,
    parts_of,
    settled,
)
from adhesion_jax.discovery.search.trials import is_worth
from adhesion_jax.discovery.types import Candidate
from adhesion_jax.effects import Covariate

#: Numbers of columns that are tested as one.
_SIZES = (2, 3)


def together(state: Selection, null: Null, number: int, seed: int) -> Selection:
    """The state of round `number` with the lines of the two or three columns that explain most.

    In a designed campaign each column alone is hidden by what the others do to the levels of the
    runs. The lines are effects of their own, but their p is that of all of them together, adjusted
    for every choice of columns. Without a significant one it is the state itself.
    """
    problem = state.setting.problem
    lines = _lines(problem, {name for effect in state.accepted for name in effect.covariates})
    testable, flat = directions_of(null, [line.starts[0] for line in lines])
    places = np.flatnonzero(testable)
    chosen = [some for size in _SIZES for some in combinations(places.tolist(), size)]
    if not chosen:
        return state
    z, largest = signed(null, [orthonormal(flat[:, list(some)]) for some in chosen], seed)
    best = int(np.argmax(z))
    p = adjusted(float(z[best]), largest, problem.runs)
    if p > rules.SCAN_SIGNIFICANT:
        return state
    some = [lines[place] for place in chosen[best]]
    new = [as_effect(line, (line.name,), line.starts[0], p, 0.0) for line in some]
    more = settled(state, [*state.accepted, *new])
    less = refitted(more.fitted, parts_of(state.accepted))
    if not is_worth(less, more.fitted, generic=True):
        return state
    first = len(state.accepted)
    gains, worth = [], []
    for place in range(first, len(more.accepted)):
        without = refitted(more.fitted, parts_of(all_but(more.accepted, place)))
        gains.append(gain(without, more.fitted))
        worth.append(is_worth(without, more.fitted, generic=True))
    accepted, rows = [*state.accepted], []
    for effect, gained, own in zip(more.accepted[first:], gains, worth, strict=True):
        # Beside a line that explains much, any other makes a pair that is significant; of lines
        # that stand for each other none is worth it alone.
        kept = own or not any(worth)
        if kept:
            accepted.append(effect._replace(gain=gained.total))
        name = f"{effect.name} (linear, beside others)"
        said = "accepted" if kept else "explains less"
        rows.append(Candidate(number, name, float(z[best]), p, gained.total, gained.error, said))
    return settled(more, accepted)._replace(ranking=(*more.ranking, *rows))


def _lines(problem: Problem, taken: set[str]) -> list[Entry]:
    """The line of each column of numbers that stands still within runs, those `taken` apart."""
    return [
        line
        for column in problem.columns
        if constant_within_runs(column, problem)
        for line in column_entries(Covariate, column, problem)[:1]
        if not {*line.covariates} & {*taken, *problem.named}
    ]
