"""Physics as a veto: a cause that its own parameters contradict is not named, but its column."""

from collections.abc import Mapping

import numpy as np

from adhesion_jax.discovery.model.fitting import Fitted, covariance, quantile, solve, strengths_of
from adhesion_jax.discovery.model.packing import effect_places
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.state import Accepted, Place, Selection, slots_of
from adhesion_jax.discovery.types import Interval
from adhesion_jax.effects import Cause, family_of
from adhesion_jax.wording import listed, number

#: Columns that tell of no surroundings: beside others a structure is not named after them.
_OF_THE_RUN = ("slip_ratio", "time_s")


def intervals(state: Selection) -> Mapping[Place, Mapping[str, Interval]]:
    """95 % intervals of the parameters of every part, by parameter name."""
    return _intervals(state, state.fitted)


def _intervals(state: Selection, fitted: Fitted) -> Mapping[Place, Mapping[str, Interval]]:
    """The intervals of those parameters that are free in `fitted`, a fit of the state."""
    error = np.sqrt(np.maximum(np.diag(covariance(fitted)), 0.0)) * quantile(fitted)
    at = {place: number for number, place in enumerate(fitted.places)}
    slots = slots_of(state.accepted)
    found = {}
    for slot, (part, effect) in enumerate(zip(slots, fitted.effects, strict=True)):
        found[part] = {
            name: Interval(value, value - error[at[place]], value + error[at[place]])
            for name, place in effect_places(slot, effect).items()
            if place in at
            for value in (float(getattr(effect, name)),)
        }
    return found


def vetoed(state: Selection) -> tuple[Selection, tuple[str, ...]]:
    """The state with the causes that are contradicted named after their columns, and sentences.

    Their terms stay in the law: that there is a structure is sure, but not what it is.
    """
    whole = intervals(state)
    accepted, sentences = [], []
    for place, effect in enumerate(state.accepted):
        slot = slots_of(state.accepted).index((place, 0))
        found = _intervals(state, _shaped_as_fitted(state.fitted, slot))[place, 0]
        why = contradiction(effect, found, _held_back(state.fitted, slot))
        named = _after_its_columns(effect) if why else effect
        accepted.append(named)
        if why:
            sentences.append(
                f"{effect.name} is not named as a cause, although its formula is in the law: {why}."
            )
        elif isinstance(effect.parts[0], Cause):
            sentences += [
                f"The interval of {name} of {effect.name} holds 0 only because the data do not "
                "tell it apart from the other parameters of this effect: for those as fitted it "
                f"is {number(low)} to {number(high)}."
                for name, (_, low, high) in found.items()
                if low * high > 0 and whole[place, 0][name].low <= 0 <= whole[place, 0][name].high
            ]
    return state._replace(accepted=tuple(accepted)), tuple(sentences)


def _shaped_as_fitted(fitted: Fitted, slot: int) -> Fitted:
    """The fit with those parameters of an effect held that are no strengths of it.

    Where an effect does nothing it has no shape. Whether it does something is therefore a question
    about its strength for the shape that it has (Davies 1987, Biometrika 74, 33-43).
    """
    own = effect_places(slot, fitted.effects[slot]).values()
    held = {*own} - {*strengths_of(fitted, [slot])}
    free = [at for at, place in enumerate(fitted.places) if place not in held]
    return fitted._replace(
        places=tuple(fitted.places[at] for at in free),
        gradient=fitted.gradient[:, free],
        hessian=fitted.hessian[:, free][:, :, free],
    )


def _held_back(fitted: Fitted, slot: int) -> float:
    """What an effect would gain if its strengths were free of their ranges, to second order."""
    at = [fitted.places.index(place) for place in strengths_of(fitted, [slot])]
    pull = fitted.gradient.sum(0)[at]
    spread = solve(fitted.hessian.sum(0), np.eye(len(fitted.places)))[np.ix_(at, at)]
    return 0.5 * float(pull @ spread @ pull)


def contradiction(effect: Accepted, found: Mapping[str, Interval], held_back: float) -> str:
    """What contradicts the cause that an effect is named after, as a clause; empty: nothing.

    `found` are the strengths of its first part, which are 0 where it does nothing. The end of a
    range contradicts only if what it holds back is much beside what the effect gains. With a form
    that refines it, the strength alone does not say how strong the effect is.
    """
    first = effect.parts[0]
    if not isinstance(first, Cause):
        return ""
    ranges = first.FACTS.parameters
    strengths = {name: found[name] for name in first.FACTS.strengths}
    much = held_back > rules.CLASS_SHARE * effect.gain
    for name, (value, *_) in strengths.items():
        if first.FACTS.one_sided and value < 0:
            return f"its {name} is {number(value)}, and it would have to be above 0"
        if much and not ranges[name].lower < value < ranges[name].upper:
            return f"its {name} stands at {number(value)}, an end of the range that it can have"
    alone = len(effect.parts) == 1 and len(strengths) > 0
    if alone and all(one.low <= 0 <= one.high for one in strengths.values()):
        return f"the interval of its {listed([*strengths])} holds 0, where it does nothing"
    return ""


def _after_its_columns(effect: Accepted) -> Accepted:
    columns = [name for name in effect.covariates if name not in _OF_THE_RUN]
    columns = columns or [*effect.covariates]
    name = ("product:" if len(columns) > 1 else "covariate:") + "*".join(columns)
    # A cause of the same kind is contradicted as well.
    others = (
        one
        for one in effect.members
        if one not in (name, effect.name) and (":" in one or family_of(one) != effect.family)
    )
    return effect._replace(name=name, members=(name, *others), generic=True)
