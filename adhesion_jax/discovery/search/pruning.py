"""Backward elimination of effects and parts that later ones have made unnecessary."""

from collections.abc import Iterator

from adhesion_jax.discovery.model.fitting import loss_without
from adhesion_jax.discovery.model.problem import Problem
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import entry_of
from adhesion_jax.discovery.search.state import (
    Accepted,
    Place,
    Selection,
    all_but,
    parts_of,
    refitted,
    settled,
    slots_of,
)
from adhesion_jax.discovery.search.trials import is_worth
from adhesion_jax.effects import EFFECTS, kind_of


def pruned(state: Selection) -> Selection:
    """The state without effects and parts that do not lower the expected loss any more.

    The earliest is tried first, and after each removal all are tried again.
    """
    while True:
        slots = slots_of(state.accepted)
        for gone, rest in _smaller(state):
            rise = loss_without(state.fitted, [slots.index(place) for place in gone])
            if rise > rules.PLAINLY_NEEDED:
                continue
            less = refitted(state, parts_of(rest))
            if is_worth(less, state.fitted):
                continue
            state = settled(state, rest)
            break
        else:
            return state


def _smaller(state: Selection) -> Iterator[tuple[list[Place], tuple[Accepted, ...]]]:
    """Parts that may be left out together, and the accepted effects without them.

    First all parts of an effect, for each effect but the last; then one part of an effect, for each
    part but its last.
    """
    accepted = state.accepted
    for number, effect in enumerate(accepted[:-1]):
        # A plain form of the same columns explains the same, but names no cause.
        if not effect.generic and any(
            other.generic and {*effect.covariates} & {*other.covariates} for other in accepted
        ):
            continue
        yield [(number, part) for part in range(len(effect.parts))], all_but(accepted, number)
    for number, effect in enumerate(accepted):
        if len(effect.parts) < 2:
            continue
        for part, less in _with_a_part_less(effect, state.setting.problem):
            yield [(number, part)], (*accepted[:number], less, *accepted[number + 1 :])


def _with_a_part_less(effect: Accepted, problem: Problem) -> Iterator[tuple[int, Accepted]]:
    """The number of a part, and the effect without it, for each part but the last.

    Without the first part, which names the effect, the last one takes its place, if it is a cause.
    """
    parts = effect.parts
    for part in range(1, len(parts) - 1):
        yield part, effect._replace(parts=(*parts[:part], *parts[part + 1 :]))
    last = parts[-1]
    name = kind_of(last)
    if name in EFFECTS:
        entry = entry_of(name, (last,), problem)
        less = effect._replace(
            name=name,
            members=(name, *effect.members),
            family=entry.family,
            generic=False,
            covariates=entry.covariates,
            parts=(last, *parts[1:-1]),
        )
        yield 0, less
