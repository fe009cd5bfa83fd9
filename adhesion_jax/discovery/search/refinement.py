"""What becomes of accepted effects: their form is refined, and what is unnecessary is left out."""

import dataclasses
from collections.abc import Iterator, Sequence

from adhesion_jax.discovery.model.fitting import refitted
from adhesion_jax.discovery.model.prediction import gain
from adhesion_jax.discovery.model.problem import Problem, label_of
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import Entry, column_entries, entry_of, forms_of_column
from adhesion_jax.discovery.search.probes import null_of
from adhesion_jax.discovery.search.screening import screen
from adhesion_jax.discovery.search.state import (
    Accepted,
    Selection,
    all_but,
    parts_of,
    settled,
    slots_of,
    with_constants,
    with_parts,
)
from adhesion_jax.discovery.search.trials import Trial, is_worth, new_slot, tried
from adhesion_jax.effects import (
    EFFECTS,
    Constant,
    Effect,
    Interaction,
    Periodic,
    Threshold,
    kind_of,
)
from adhesion_jax.effects.shape import ACTS_ON
from adhesion_jax.effects.signals import SlipBias
from adhesion_jax.effects.slip_velocity import FallingFriction
from adhesion_jax.effects.wave import RailJoint

#: Numbers of the harmonics of a wave that are tried, beside those that its own form has.
_HARMONICS = range(2, 8)


def refined(state: Selection, seed: int) -> Selection:
    """Every effect with the further parts that the residual asks for against its own columns.

    A part is added if it is significant (score test, p adjusted over all forms of these columns)
    and improves the prediction of runs left out. It belongs to the effect and is no claim of its
    own. If none is added the state is returned unchanged.
    """
    slots = slots_of(state.accepted)
    parts = len(slots)
    for number in range(len(state.accepted)):
        while len(state.accepted[number].parts) < rules.MOST_PARTS and not state.full:
            chosen = _part_more(state, number, seed)
            if chosen is None:
                break
            fitted, slot = chosen.fitted, new_slot(chosen)
            part = (number, len(state.accepted[number].parts))
            slots = [*slots[:slot], part, *slots[slot:]]
            accepted = with_parts(state.accepted, slots, fitted.effects)
            state = state._replace(fitted=fitted, accepted=accepted)
    return state if len(slots) == parts else settled(state, state.accepted)


def _part_more(state: Selection, number: int, seed: int) -> Trial | None:
    """The best further part of the effect of that number; None if none gains enough."""
    entries = forms_of(state.accepted[number], state.setting.problem)
    if not entries:
        return None
    scores = [
        score
        for score in screen([([null_of(state.fitted)], entries)], seed)
        if score.p <= rules.SIGNIFICANT
    ]
    trials = tried(state.fitted, scores[: rules.TRIED_FORMS])
    if not trials:
        return None
    chosen = min(trials, key=lambda trial: trial.loss)
    gained = gain(state.fitted, chosen.fitted)
    return chosen if gained.total > gained.error else None


def forms_of(effect: Accepted, problem: Problem) -> list[Entry]:
    """Every form of the columns of an effect that is not yet one of its parts."""
    columns = [
        column
        for column in problem.columns
        if label_of(column, problem.measured) in effect.covariates
    ]
    of_slip_velocity = effect.family == FallingFriction.FACTS.family
    if of_slip_velocity:
        columns = [column for column in problem.columns if column == "slip_velocity_mps"]
    entries = [entry for column in columns for entry in forms_of_column(column, problem)]
    entries += [
        entry
        for column in columns
        if column not in problem.named
        for entry in column_entries(Threshold, column, problem)
    ]
    if len(columns) == 2:
        flat = {name: problem.flat[name] for name in columns}
        entries += [
            entry_of(effect.name, [dataclasses.replace(start, acts_on=acts_on)], problem)
            for start in Interaction.starts(flat)
            for acts_on in ACTS_ON
        ]
    if of_slip_velocity and "vehicle_speed_mps" not in problem.flat:
        # At a constant speed the effect is a function of slip alone; an offset of the slip may then
        # be what its form lacks.
        starts = SlipBias.starts({})
        entries.append(entry_of(kind_of(starts[0]), starts, problem))
    for start in _harmonics(effect.parts, problem):
        entries.append(entry_of(f"periodic:{start.column}", [start], problem))
    there = {form_of(part) for part in effect.parts}
    return [entry for entry in entries if entry.starts and form_of(entry.starts[0]) not in there]


def _harmonics(parts: Sequence[Effect], problem: Problem) -> list[Periodic]:
    """The harmonics of an effect that is a wave, without those that it has; else none."""
    first = parts[0]
    if isinstance(first, RailJoint) and "position_m" in problem.columns:
        column, frequency, own = "position_m", 1 / float(first.length), 2
    elif isinstance(first, Periodic):
        column, frequency, own = first.column, float(first.frequency), 1
    else:
        return []
    known = [part.frequency for part in parts[1:] if isinstance(part, Periodic)]
    there = {round(float(one) / frequency) for one in known}
    return [
        Periodic(0.01, 0.01, number * frequency, column=column)
        for number in _HARMONICS
        if number > own and number not in there
    ]


def form_of(effect: Effect) -> tuple[object, ...]:
    """The kind of a part, its columns, what it acts on and its frequency: equal for equal forms."""
    words = [
        getattr(effect, field.name)
        for field in dataclasses.fields(effect)
        if field.name not in effect.FACTS.parameters
    ]
    frequency = round(float(effect.frequency), 9) if isinstance(effect, Periodic) else 0.0
    return (type(effect), *words, frequency)


def pruned(state: Selection) -> Selection:
    """The state without effects and parts that do not lower the expected loss any more.

    The earliest is tried first, and after each removal all are tried again.
    """
    while True:
        for rest in map(with_constants, _smaller(state)):
            less = refitted(state.fitted, parts_of(rest))
            if is_worth(less, state.fitted):
                continue
            state = settled(state, rest)
            break
        else:
            return state


def _smaller(state: Selection) -> Iterator[tuple[Accepted, ...]]:
    """The accepted effects without those parts that may be left out together.

    First all parts of an effect, for each effect but the last; then one part of an effect, for each
    part but the last of the last effect: what mended the form of an earlier effect may have stood
    for an effect that was found since.
    """
    accepted = state.accepted
    for number, effect in enumerate(accepted[:-1]):
        # A plain form of the same columns explains the same, but names no cause.
        if not effect.generic and any(
            other.generic and {*effect.covariates} & {*other.covariates} for other in accepted
        ):
            continue
        yield all_but(accepted, number)
    for number, effect in enumerate(accepted):
        newest = number == len(accepted) - 1
        for less in _with_a_part_less(effect, newest, state.setting.problem):
            yield (*accepted[:number], less, *accepted[number + 1 :])


def _with_a_part_less(effect: Accepted, newest: bool, problem: Problem) -> Iterator[Accepted]:
    """The effect without a part, for each part but the last of the newest effect.

    Without the first part, which names the effect, the last one takes its place, if it is a cause.
    A constant goes with the last of the forms that it stands beside.
    """
    parts = tuple(part for part in effect.parts if not isinstance(part, Constant))
    if len(parts) < 2:
        return
    for part in range(1, len(parts) - newest):
        yield effect._replace(parts=(*parts[:part], *parts[part + 1 :]))
    last = parts[-1]
    name = kind_of(last)
    if name in EFFECTS:
        entry = entry_of(name, (last,), problem)
        yield effect._replace(
            name=name,
            members=(name, *effect.members),
            family=entry.family,
            generic=False,
            covariates=entry.covariates,
            parts=(last, *parts[1:-1]),
        )
