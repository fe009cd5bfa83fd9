"""What has been accepted so far: effects, the base curve below them, and the noise they leave."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from adhesion_jax.discovery.bases import bic, refits
from adhesion_jax.discovery.effects import Effect
from adhesion_jax.discovery.findings import Candidate
from adhesion_jax.discovery.fitting import Fitted, Setting, fit_model, squares
from adhesion_jax.discovery.noise import Moments, estimate_noise, misfit_noise, moments

#: Under the right noise the sum of squares of a fit is at most so much larger.
_MISSED = 1.1


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

    setting: Setting
    fits: Mapping[str, Fitted]  # every base curve with the effects accepted
    base: str
    accepted: tuple[Accepted, ...]
    ranking: tuple[Candidate, ...]
    thresholds: tuple[float, ...] = ()  # by round, the z needed for acceptance

    @property
    def fitted(self) -> Fitted:
        return self.fits[self.base]


def parts_of(accepted: Sequence[Accepted]) -> tuple[Effect, ...]:
    """All effects of a model."""
    return tuple(part for effect in accepted for part in effect.parts)


def settled(
    setting: Setting,
    fits: Mapping[str, Fitted],
    accepted: Sequence[Accepted],
    ranking: Sequence[Candidate],
) -> Selection:
    """Base curve and noise chosen anew for the effects there are."""
    effects = parts_of(accepted)
    fits = refits(setting, fits, effects)
    base = min(fits, key=lambda name: bic(fits[name]))
    fitted = fits[base]
    setting = with_noise(setting, fitted)
    fits = refits(setting, fits, fitted.effects)
    base = min(fits, key=lambda name: bic(fits[name]))
    parts = _refreshed(accepted, fits[base].effects)
    return Selection(setting, fits, base, parts, tuple(ranking))


def without(state: Selection, rest: Sequence[Accepted]) -> Selection:
    """The state with only some of its effects."""
    less = settled(state.setting, state.fits, rest, state.ranking)
    return less._replace(thresholds=state.thresholds)


def with_noise(setting: Setting, fitted: Fitted) -> Setting:
    """The noise that a fit leaves, unless a fit under that noise misses the data by more."""
    problem = setting.problem
    residual = np.asarray(problem.data.adhesion) - fitted.adhesion
    left = (np.asarray(setting.noise.weight), residual, fitted.adhesion, problem.blocks)
    new = Setting(problem, estimate_noise(*left), fitted.adhesion)
    again = fit_model(new, fitted.base, fitted.base_values.tolist(), fitted.effects)
    if squares(new, again) < _MISSED * squares(setting, fitted):
        return new
    return Setting(problem, misfit_noise(*left), fitted.adhesion)


def residual_moments(state: Selection) -> Moments:
    """What the residual of the model looks like, be it noise or not."""
    setting = state.setting
    residual = np.asarray(setting.problem.data.adhesion) - state.fitted.adhesion
    weight = np.asarray(setting.noise.weight)
    return moments(weight, residual, state.fitted.adhesion, setting.problem.blocks)


def _refreshed(accepted: Sequence[Accepted], effects: Sequence[Effect]) -> tuple[Accepted, ...]:
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
