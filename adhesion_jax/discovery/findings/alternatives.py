"""Which causes act alike in the data, and which measurement would separate them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from adhesion_jax.discovery.model.fitting import refitted
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import Entry
from adhesion_jax.discovery.search.probes import directions_of, null_of
from adhesion_jax.discovery.search.state import Selection, all_but, parts_of
from adhesion_jax.discovery.types import Proposal
from adhesion_jax.effects import in_words, kind_of
from adhesion_jax.wording import capital, listed

#: Columns that every run goes through, which are no conditions of a measurement.
_OF_EVERY_RUN = {"slip_ratio", "slip_velocity_mps", "time_s", "run_time_s"}


class Likeness(NamedTuple):
    """How closely an entry resembles an accepted effect, the other parameters being free."""

    effect: str
    entry: Entry
    cosine: float


def likenesses(state: Selection, entries: Sequence[Entry]) -> tuple[Likeness, ...]:
    """The cosine between the probe of each entry and that of each accepted effect, largest first.

    The Jacobian of the base curve and the other effects is projected out of both; of the starts of
    an entry the one of largest cosine counts. Plain columns of the effect's own family are left
    out, because they are no other cause.
    """
    found = []
    for number, effect in enumerate(state.accepted):
        rest = all_but(state.accepted, number)
        less = refitted(state.fitted, parts_of(rest))
        others = [
            entry
            for entry in entries
            if entry.name not in (effect.name, kind_of(effect.parts[0]))
            and entry.name not in {one.name for one in rest}
            and not (entry.generic and entry.family == effect.family)
        ]
        probes = [effect.parts[0], *(start for entry in others for start in entry.starts)]
        testable, directions = directions_of(null_of(less), probes)
        cosines = np.abs(directions[:, 1:].T @ directions[:, 0]) * testable[1:]
        ends = np.cumsum([len(entry.starts) for entry in others], dtype=int)
        for entry, own in zip(others, np.split(cosines, ends)[:-1], strict=True):
            found.append(Likeness(effect.name, entry, min(float(own.max()), 1.0)))
    return tuple(sorted(found, key=lambda likeness: -likeness.cosine))


def confounded(state: Selection, alike: Sequence[Likeness]) -> tuple[str, ...]:
    """Sentences on causes that the data cannot tell apart, and on those that act nearly alike."""
    sentences = [
        f"The data cannot tell {in_words(effect.name)} from "
        f"{listed([in_words(name) for name in effect.members[1:]], 'or')}: with either "
        "the prediction of runs left out is as good."
        for effect in state.accepted
        if len(effect.members) > 1
    ]
    named: set[tuple[str, str]] = set()
    for effect, entry, cosine in alike:
        if cosine < rules.ALIKE_COSINE or (effect, entry.name) in named:
            continue
        named.add((effect, entry.name))
        sentences.append(
            f"{capital(in_words(effect))} and {in_words(entry.name)} act nearly alike in these "
            f"data (cosine {cosine:.2f} once the base curve is fitted); what is known beyond the "
            "data must decide."
        )
    return tuple(sentences)


def proposals(state: Selection, alike: Sequence[Likeness]) -> tuple[Proposal, ...]:
    """For each effect the measurements that would separate it from the causes most like it.

    The separation of two causes in standard errors is z sqrt(1 - c^2), with z that of the effect
    and c their cosine. The sentence gives it for these data; the power of the proposal is that for
    as many runs in which the columns of the two vary independently, c = 0.
    """
    found = []
    for effect in state.accepted:
        rivals = [
            one
            for one in alike
            if one.effect == effect.name
            and not one.entry.generic
            and one.cosine >= rules.PROPOSED_COSINE
            # A form of a column and a cause of it alone are one cause under two names.
            and not (effect.generic and {*effect.covariates} == {*one.entry.covariates})
        ]
        z = float(np.sqrt(2 * max(effect.gain, 0.0)))
        for rival in rivals:
            apart = z * np.sqrt(max(1 - rival.cosine**2, 0.0))
            now = f" These data separate the two by {apart:.1f} standard errors."
            found.append(
                Proposal(
                    (effect.name, rival.entry.name),
                    _design({*effect.covariates}, {*rival.entry.covariates})
                    # That would contradict the class, which follows from runs left out.
                    + now * (rival.entry.name not in effect.members),
                    z,
                )
            )
    return tuple(found)


def _design(one: set[str], other: set[str]) -> str:
    """Runs that separate what rests on some columns from what rests on others."""
    own, others = one - other - _OF_EVERY_RUN, other - one - _OF_EVERY_RUN
    columns = sorted(own) + sorted(others)
    if not columns:
        return (
            "No column beside the slip and the time tells them apart: measure as many runs with "
            "steps of the slip, up and down, at different speeds."
        )
    if own and others:
        vary = "vary independently of each other"
    elif len(columns) > 1:
        vary = "vary over their whole ranges at every slip, early and late"
    else:
        vary = "varies over its whole range at every slip, early and late"
    return f"Measure as many runs in which {listed(columns)} {vary}."
