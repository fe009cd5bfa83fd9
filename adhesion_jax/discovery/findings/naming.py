"""Physics as a veto: a cause that its own parameters contradict is not named, but its column."""

from collections.abc import Mapping

import numpy as np

from adhesion_jax.discovery.model.fitting import covariance, quantile
from adhesion_jax.discovery.model.program import effect_places
from adhesion_jax.discovery.search.state import Accepted, Place, Selection, slots_of
from adhesion_jax.discovery.types import Interval
from adhesion_jax.effects import Cause, family_of
from adhesion_jax.wording import listed, number

#: Columns that tell of no surroundings: beside others a structure is not named after them.
_OF_THE_RUN = ("slip_ratio", "time_s")


def intervals(state: Selection) -> Mapping[Place, Mapping[str, Interval]]:
    """95 % intervals of the parameters of every part, by parameter name."""
    error = np.sqrt(np.maximum(np.diag(covariance(state.fitted)), 0.0)) * quantile(state.fitted)
    at = {place: number for number, place in enumerate(state.fitted.places)}
    slots = slots_of(state.accepted)
    found = {}
    for slot, (part, effect) in enumerate(zip(slots, state.fitted.effects, strict=True)):
        found[part] = {
            name: Interval(value, value - error[at[place]], value + error[at[place]])
            for name, place in effect_places(slot, effect).items()
            for value in (float(getattr(effect, name)),)
        }
    return found


def vetoed(state: Selection) -> tuple[Selection, tuple[str, ...]]:
    """The state with the causes that are contradicted named after their columns, and sentences.

    Their terms stay in the law: that there is a structure is sure, but not what it is.
    """
    found = intervals(state)
    accepted, sentences = [], []
    for place, effect in enumerate(state.accepted):
        why = contradiction(effect, found[place, 0])
        named = _after_its_columns(effect) if why else effect
        accepted.append(named)
        if why:
            sentences.append(
                f"{effect.name} is not named as a cause, although its formula is in the law: {why}."
            )
    return state._replace(accepted=tuple(accepted)), tuple(sentences)


def contradiction(effect: Accepted, found: Mapping[str, Interval]) -> str:
    """What contradicts the cause that an effect is named after, as a clause; empty: nothing.

    `found` are the parameters of its first part. Looked at are its strengths, which are 0 where it
    does nothing: shapes have ends that mean something, as a threshold so wide that it is a line.
    With a form that refines it, the strength alone does not say how strong the effect is. Nor does
    a strength whose interval covers its whole range: the data know it beside the shape alone, as
    that of a hysteresis, of which they know k over the rate where it is small.
    """
    first = effect.parts[0]
    if not isinstance(first, Cause):
        return ""
    ranges = first.FACTS.parameters
    strengths = {}
    for name in first.FACTS.strengths:
        value, low, high = found[name]
        if first.FACTS.one_sided and value < 0:
            return f"its {name} is {number(value)}, and it would have to be above 0"
        if low <= ranges[name].lower and ranges[name].upper <= high:
            continue
        if not ranges[name].lower < value < ranges[name].upper:
            return f"its {name} stands at {number(value)}, an end of the range that it can have"
        strengths[name] = found[name]
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
