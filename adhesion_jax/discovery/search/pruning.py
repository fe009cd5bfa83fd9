"""Backward elimination: what later effects and refinements have made needless goes."""

from collections.abc import Iterator

from adhesion_jax.discovery.model.fitting import Fitted, likeliest, loss_without
from adhesion_jax.discovery.model.problem import Problem
from adhesion_jax.discovery.search.catalogue import entry_of
from adhesion_jax.discovery.search.state import (
    Accepted,
    Selection,
    parts_of,
    refitted,
    refreshed,
    without,
)
from adhesion_jax.discovery.search.trials import is_worth
from adhesion_jax.effects import EFFECTS, kind_of

#: A part is not tried to be left out where the half deviance rises by more, to second order.
_PLAINLY_NEEDED = 50.0


def pruned(state: Selection) -> Selection:
    """The state without what no longer lowers the expected loss surely, the earliest first."""
    while True:
        for rest in _smaller(state):
            kept = {id(part) for part in parts_of(rest)}
            gone = [part for part in state.fitted.effects if id(part) not in kept]
            if loss_without(state.fitted, gone) > _PLAINLY_NEEDED:
                continue
            less = refitted(state, parts_of(rest))
            if is_worth(less, state.fitted):
                continue
            smaller = without(state, rest)
            whole = _from(smaller.fitted, state)
            state = smaller if whole is state else whole
            break
        else:
            return state


def _from(less: Fitted, state: Selection) -> Selection:
    """The model refitted from where a part of it alone fits better, if it then does so too."""
    if less.total >= state.fitted.total:
        return state
    values, effects = less.base_values.tolist(), parts_of(state.accepted)
    again = likeliest(less.setting, less.base, values, effects)
    if again.total >= less.total:
        return state
    accepted = refreshed(state.accepted, again.effects)
    return state._replace(fits={**state.fits, less.base: again}, base=less.base, accepted=accepted)


def _smaller(state: Selection) -> Iterator[tuple[Accepted, ...]]:
    """The accepted without one of them but the last, or without a part of one but its last."""
    for effect in state.accepted[:-1]:
        # A plain form of the same columns explains what a cause does, but it is none.
        if not effect.generic and any(
            other.generic and {*effect.covariates} & {*other.covariates} for other in state.accepted
        ):
            continue
        yield tuple(other for other in state.accepted if other is not effect)
    for effect in state.accepted:
        if len(effect.parts) < 2:
            continue
        for less in _with_a_part_less(effect, state.setting.problem):
            yield tuple(less if other is effect else other for other in state.accepted)


def _with_a_part_less(effect: Accepted, problem: Problem) -> Iterator[Accepted]:
    """Where the part goes that named the effect, the last takes its place, if it is a cause."""
    _, *between, last = effect.parts
    for part in between:
        yield effect._replace(parts=tuple(other for other in effect.parts if other is not part))
    name = kind_of(last)
    if name in EFFECTS:
        entry = entry_of(name, (last,), problem)
        yield effect._replace(
            name=name,
            members=(name, *effect.members),
            family=entry.family,
            generic=False,
            covariates=entry.covariates,
            parts=(last, *between),
        )
