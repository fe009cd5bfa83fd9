"""The effects of a finished search as they are reported: names, intervals, formulas, sentences.

Physics is a veto: a cause that its own parameters contradict is not named, but its column.
"""

from collections.abc import Mapping
from itertools import combinations

import numpy as np

from adhesion_jax.data.columns import unit_of
from adhesion_jax.discovery.model.course import Course, size_in_words
from adhesion_jax.discovery.model.fitting import (
    Fitted,
    covariance,
    felt,
    quantile,
    refitted,
    solve,
    strengths_of,
)
from adhesion_jax.discovery.model.packing import effect_places
from adhesion_jax.discovery.model.prediction import held_out_loss
from adhesion_jax.discovery.model.problem import Problem
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.scans import Torsion
from adhesion_jax.discovery.search.state import Accepted, Place, Selection, parts_of, slots_of
from adhesion_jax.discovery.types import Errors, FoundEffect, Interval
from adhesion_jax.effects import Cause, Effect, Labels, ShapeTerm, family_of, in_words, kind_of
from adhesion_jax.effects.labels import NO_LABEL
from adhesion_jax.wording import capital, listed, number

#: Columns that tell of no surroundings: beside others a structure is not named after them.
_OF_THE_RUN = ("slip_ratio", "time_s")

#: A parameter of which the data tell nothing, as the power of a load that they lack, has an
#: interval that is wider than the range that is searched by more than this.
_UNTOLD = 100.0


def intervals(state: Selection) -> Mapping[Place, Mapping[str, Interval]]:
    """95 % intervals of the parameters of every part, by parameter name."""
    return _intervals(state, state.fitted)


def _intervals(state: Selection, fitted: Fitted) -> Mapping[Place, Mapping[str, Interval]]:
    """The intervals of the parameters that are free in `fitted`, a fit of the state, and told."""
    error = np.sqrt(np.maximum(np.diag(covariance(fitted)), 0.0)) * quantile(fitted)
    has_influence = felt(fitted)
    at = {place: number for number, place in enumerate(fitted.places) if has_influence[number]}
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
                f"{capital(in_words(effect.name))} is not named as a cause, although its formula "
                f"is in the law: {why}."
            )
        elif isinstance(effect.parts[0], Cause):
            sentences += [
                f"The interval of {name} of {in_words(effect.name)} holds 0 only because the data "
                "do not tell it apart from the other parameters of this effect: for those as "
                f"fitted it is {number(low)} to {number(high)}."
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
    held = {*own} - {*strengths_of(fitted, slot)}
    free = [at for at, place in enumerate(fitted.places) if place not in held]
    return fitted._replace(
        places=tuple(fitted.places[at] for at in free),
        gradient=fitted.gradient[:, free],
        hessian=fitted.hessian[:, free][:, :, free],
    )


def _held_back(fitted: Fitted, slot: int) -> float:
    """What an effect would gain if its strengths were free of their ranges, to second order."""
    at = [fitted.places.index(place) for place in strengths_of(fitted, slot)]
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
    strengths = {name: found[name] for name in first.FACTS.strengths if name in found}
    much = held_back > rules.MUCH_HELD_BACK * effect.gain
    for name, (value, *_) in strengths.items():
        if first.FACTS.one_sided and value < 0:
            return f"its {name} is {number(value)}, and it would have to be above 0"
        if much and not ranges[name].lower < value < ranges[name].upper:
            return f"its {name} stands at {number(value)}, an end of the range that it can have"
    levels = {"the reference": Interval(0.0, 0.0, 0.0), **strengths}
    for (before, low), (name, high) in combinations(levels.items(), 2):
        if first.FACTS.rising and high.high < low.low:
            return f"its {name} is {number(high.value)}, and it would have to be above {before}"
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


def found_effects(state: Selection, validation: Errors) -> list[FoundEffect]:
    """The effects with their intervals, and the error with each added to those before it."""
    told = intervals(state)
    whole = float(held_out_loss(state.fitted).sum())
    found = []
    for rank, effect in enumerate(state.accepted):
        some = refitted(state.fitted, parts_of(state.accepted[: rank + 1]))
        ratio = float(held_out_loss(some).sum()) / max(whole, 1e-300)
        parameters, units, at_bound = {}, {}, []
        for place, part in enumerate(effect.parts):
            prefix = "" if place == 0 else f"{_called(part)} "
            for name, described in part.FACTS.parameters.items():
                if name not in told[rank, place] or _no_label(part, name):
                    continue
                interval = told[rank, place][name]
                if interval.high - interval.low > _UNTOLD * (described.upper - described.lower):
                    continue
                said = prefix + _of_label(part, name, state.setting.problem)
                if not described.lower < interval.value < described.upper:
                    at_bound.append(said)
                    interval = Interval(interval.value, np.nan, np.nan)
                parameters[said] = interval
                column = getattr(part, "column", "") or next(iter(effect.covariates), "")
                units[said] = described.unit.replace("column", unit_of(column))
        formula = _formula(effect.parts[0])
        found.append(
            FoundEffect(
                effect.name,
                effect.members,
                effect.covariates,
                formula,
                parameters,
                units,
                effect.p,
                validation.after.value * float(np.sqrt(ratio)),
                _sentence(effect),
                _acts_on(effect.parts[0]),
                tuple(at_bound),
                effect.by_trees,
                tuple(_acts_on(part) for part in effect.parts[1:]),
            )
        )
    return found


def _no_label(part: Effect, name: str) -> bool:
    """Whether a strength is that of a label that the data lack."""
    return isinstance(part, Labels) and getattr(part, f"label{name[1:]}") == NO_LABEL


def _of_label(part: Effect, name: str, problem: Problem) -> str:
    """A strength with the label that it is of."""
    if not isinstance(part, Labels):
        return name
    return f"k of {problem.name_of(part.column, getattr(part, f'label{name[1:]}'))}"


#: The curve mu(l) changed by a function g of columns, by the part of the curve that g acts on.
_BENT = {
    "level": "mu exp(g)",
    "slip": "mu(l exp(g))",
    "fall": "mu_max - (mu_max - mu) exp(g) beyond the peak",
    "offset": "mu + g",
    "shift": "mu(l + g)",
}


def _acts_on(part: Effect) -> str:
    return part.acts_on if isinstance(part, ShapeTerm) else "level"


def _called(part: Effect) -> str:
    """What a part that refines an effect is called; there may be one of its kind on each place."""
    place = _acts_on(part)
    return kind_of(part) if place == "level" else f"{kind_of(part)} on the {place}"


def _formula(part: Effect) -> str:
    return (
        f"{_BENT[part.acts_on]}, {part.FACTS.formula}"
        if isinstance(part, ShapeTerm)
        else part.FACTS.formula
    )


def _sentence(effect: Accepted) -> str:
    """What the effect does, in words."""
    first = effect.parts[0]
    said = first.FACTS.sentence if isinstance(first, Cause) else ""
    if effect.generic or not said:
        said = f"Structure against {' and '.join(effect.covariates)}; no physical cause is claimed."
    more = [_called(part) for part in effect.parts[1:]]
    return f"{said} Its form is refined by {listed(more)}." if more else said


def slip_noise_found(course: Course, validation: Errors) -> list[FoundEffect]:
    """The noise of the slip, if it is given or adhesion follows the course of the slip better."""
    noise, nothing = course.noise, float("nan")
    p = nothing if noise.given else course.p
    if not (noise.sigma and (noise.given or p <= rules.SCAN_SIGNIFICANT)):
        return []
    what = size_in_words(noise)
    sentence = (
        f"The slip signal is stated to have noise of {what}; it is not smoothed."
        if course.runs is course.measured
        else f"The slip signal has noise of {what}, and adhesion follows its course better: it is "
        "smoothed in time."
    )
    return [
        FoundEffect(
            "slip_noise",
            ("slip_noise",),
            ("slip_ratio",),
            "mu(l - error of l)",
            {"sigma": Interval(noise.sigma, nothing, nothing)},
            {"sigma": "m/s" if noise.of_wheel_speed else "1"},
            p,
            validation.after.value,
            sentence,
        )
    ]


def torsion_found(line: Torsion | None, validation: Errors) -> list[FoundEffect]:
    if line is None:
        return []
    nothing = float("nan")
    return [
        FoundEffect(
            "torsion",
            ("torsion",),
            ("time_s",),
            "mu + a sin(2 pi f t + phase of the run)",
            {
                "frequency": Interval(line.frequency, nothing, nothing),
                "amplitude": Interval(line.amplitude, nothing, nothing),
            },
            {"frequency": "Hz", "amplitude": "1"},
            line.p,
            validation.after.value,
            "An oscillation whose phase differs from run to run: it is part of the noise, and no "
            "prediction can know it.",
        )
    ]
