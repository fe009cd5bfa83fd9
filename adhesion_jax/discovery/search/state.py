"""What has been accepted so far: effects, and the base curves below them with their noise."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from adhesion_jax.discovery.model.bases import bic, refits
from adhesion_jax.discovery.model.fitting import Fitted, Setting, likeliest
from adhesion_jax.discovery.types import Candidate
from adhesion_jax.effects import Effect


class Accepted(NamedTuple):
    """An effect of the model: what it is called, and what it consists of."""

    name: str
    members: tuple[str, ...]  # of its class, itself first
    family: str
    generic: bool
    covariates: tuple[str, ...]
    parts: tuple[Effect, ...]  # the effect, then what refines its form
    p: float
    gain: float  # of the log likelihood of runs left out, over all runs


class Selection(NamedTuple):
    """Where the search has come to."""

    fits: Mapping[str, Fitted]  # every base curve with the effects accepted
    base: str
    accepted: tuple[Accepted, ...]
    ranking: tuple[Candidate, ...]
    thresholds: tuple[float, ...] = ()  # by round, the z needed for acceptance

    @property
    def fitted(self) -> Fitted:
        return self.fits[self.base]

    @property
    def setting(self) -> Setting:
        """The campaign, and the noise that the model leaves."""
        return self.fitted.setting


def parts_of(accepted: Sequence[Accepted]) -> tuple[Effect, ...]:
    """All effects of a model."""
    return tuple(part for effect in accepted for part in effect.parts)


def settled(
    fits: Mapping[str, Fitted], accepted: Sequence[Accepted], ranking: Sequence[Candidate]
) -> Selection:
    """Base curve and noise chosen anew for the effects there are."""
    fits = refits(fits, parts_of(accepted))
    base = min(fits, key=lambda name: bic(fits[name]))
    return Selection(fits, base, refreshed(accepted, fits[base].effects), tuple(ranking))


def without(state: Selection, rest: Sequence[Accepted]) -> Selection:
    """The state with only some of its effects."""
    less = settled(state.fits, rest, state.ranking)
    return less._replace(thresholds=state.thresholds)


def refreshed(accepted: Sequence[Accepted], effects: Sequence[Effect]) -> tuple[Accepted, ...]:
    """The parts with the parameters of a fit, whose effects are in another order."""
    old = parts_of(accepted)
    order = sorted(range(len(old)), key=lambda place: old[place].ORDER)
    new = dict(zip(order, effects, strict=True))
    found, place = [], 0
    for effect in accepted:
        count = len(effect.parts)
        found.append(effect._replace(parts=tuple(new[at] for at in range(place, place + count))))
        place += count
    return tuple(found)


def refitted(state: Selection, effects: Sequence[Effect]) -> Fitted:
    """The base curve with other effects."""
    return likeliest(state.setting, state.base, state.fitted.base_values.tolist(), effects)
