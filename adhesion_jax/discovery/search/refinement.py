"""The form of an effect that was found, refined until the residual is flat against its columns."""

import dataclasses
from collections.abc import Sequence

from adhesion_jax.discovery.model.fitting import gain, in_order, least_gain
from adhesion_jax.discovery.model.problem import Problem, label_of
from adhesion_jax.discovery.search.catalogue import Entry, column_entries, entry_of
from adhesion_jax.discovery.search.screening import SIGNIFICANT, screen
from adhesion_jax.discovery.search.state import Accepted, Selection, settled
from adhesion_jax.discovery.search.trials import Trial, tried
from adhesion_jax.effects import (
    Covariate,
    Effect,
    Interaction,
    Periodic,
    Spline,
    Threshold,
    kind_of,
)
from adhesion_jax.effects.falling_friction import FallingFriction
from adhesion_jax.effects.rail_joint import RailJoint
from adhesion_jax.effects.shape import ACTS_ON
from adhesion_jax.effects.slip_bias import SlipBias

#: How many parts an effect may have, and how many are refitted to choose the next.
_MOST_PARTS, _TRIED = 4, 3

#: A part must lower the expected loss by this share of half the number of points.
_LEAST_GAIN = 0.001

#: The harmonics of a wave that are looked for beside those that its own form has.
_HARMONICS = range(2, 8)


def refined(state: Selection, seed: int) -> Selection:
    """Every effect with the parts that its own columns still ask for.

    A part is added where the residual is not flat against the columns of the effect (score test,
    p adjusted over all forms of them) and the prediction of runs left out gets better. What is
    found here belongs to the effect: it is no claim of its own.
    """
    start = state
    for place in range(len(state.accepted)):
        while len(state.accepted[place].parts) < _MOST_PARTS:
            better = _with_a_part_more(state, place, seed)
            if better is None:
                break
            state = better
    if state is start:
        return state
    # The other curves, which have waited for the form to stand.
    whole = settled(state.fits, state.accepted, state.ranking)
    return whole._replace(thresholds=state.thresholds)


def _with_a_part_more(state: Selection, place: int, seed: int) -> Selection | None:
    effect = state.accepted[place]
    entries = forms_of(effect, state.setting.problem)
    if not entries:
        return None
    scores = [score for score in screen(state.fitted, entries, seed) if score.p <= SIGNIFICANT]
    trials = tried(state.fitted, scores[:_TRIED])
    if not trials:
        return None
    chosen = min(trials, key=lambda trial: trial.loss)
    gained = gain(state.fitted, chosen.fitted)
    if gained.total <= max(gained.error, least_gain(state.fitted, _LEAST_GAIN)):
        return None
    return with_part(state, place, chosen)


def with_part(state: Selection, place: int, chosen: Trial) -> Selection:
    """The trial's start as one more part of an effect that is there."""
    # The part is the last of the fit, whichever effect it belongs to: by what became of each.
    order = in_order((*chosen.score.seen_in.effects, chosen.score.start))
    fitted = dict(zip(map(id, order), chosen.fitted.effects, strict=True))
    accepted = [
        effect._replace(parts=tuple(fitted[id(part)] for part in effect.parts))
        for effect in state.accepted
    ]
    mended = accepted[place]
    accepted[place] = mended._replace(parts=(*mended.parts, fitted[id(chosen.score.start)]))
    fits = {**state.fits, state.base: chosen.fitted}
    return state._replace(fits=fits, accepted=tuple(accepted))


def fitted_start(chosen: Trial) -> Effect:
    """What a trial has added, with the parameters of its fit."""
    start = chosen.score.start
    order = in_order((*chosen.score.seen_in.effects, start))
    return chosen.fitted.effects[next(at for at, one in enumerate(order) if one is start)]


def forms_of(effect: Accepted, problem: Problem) -> list[Entry]:
    """Every form of the columns of an effect that it does not have yet."""
    columns = [
        column
        for column in problem.columns
        if label_of(column, problem.measured) in effect.covariates
    ]
    of_slip_velocity = effect.family == FallingFriction.FAMILY
    if of_slip_velocity:
        columns = [column for column in problem.columns if column == "slip_velocity_mps"]
    entries = [
        entry
        for kind in (Covariate, Spline, Threshold)
        for column in columns
        for entry in column_entries(kind, column, problem)
    ]
    if len(columns) == 2:
        flat = {name: problem.flat[name] for name in columns}
        entries += [
            entry_of(effect.name, [dataclasses.replace(start, acts_on=acts_on)], problem)
            for start in Interaction.starts(flat)
            for acts_on in ACTS_ON
        ]
    if of_slip_velocity and "vehicle_speed_mps" not in problem.varying:
        # At one speed all is a function of the slip, an offset of which is a matter of form too.
        starts = SlipBias.starts({})
        entries.append(entry_of(kind_of(starts[0]), starts, problem))
    for start in _harmonics(effect.parts, problem):
        entries.append(entry_of(f"periodic:{start.column}", [start], problem))
    there = {_form(part) for part in effect.parts}
    return [entry for entry in entries if entry.starts and _form(entry.starts[0]) not in there]


def _harmonics(parts: Sequence[Effect], problem: Problem) -> list[Periodic]:
    first = parts[0]
    if isinstance(first, RailJoint) and "position_m" in problem.columns:
        column, frequency, own = "position_m", 1 / float(first.length), 2
    elif isinstance(first, Periodic):
        column, frequency, own = first.column, float(first.frequency), 1
    else:
        return []
    known = [float(part.frequency) for part in parts[1:] if isinstance(part, Periodic)]
    return [
        Periodic(0.01, 0.01, number * frequency, column=column)
        for number in _HARMONICS
        if number > own and all(abs(one / frequency - number) > 0.2 for one in known)
    ]


def _form(effect: Effect) -> tuple[object, ...]:
    """What tells one part from another: its kind, its columns, what it acts on."""
    words = [
        getattr(effect, field.name)
        for field in dataclasses.fields(effect)
        if field.name not in effect.PARAMETERS
    ]
    frequency = round(float(effect.frequency), 9) if isinstance(effect, Periodic) else 0.0
    return (type(effect), *words, frequency)
