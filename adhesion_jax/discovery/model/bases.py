"""The base curve below the effects: its fits from several starts, and the choice among curves."""

from collections.abc import Mapping, Sequence

import numpy as np

from adhesion_jax.curves import BASES
from adhesion_jax.discovery.model.fitting import (
    Fitted,
    Setting,
    likeliest,
    nearly_fitted,
    precise,
    side_by_side,
    with_own_noise,
)
from adhesion_jax.effects import Effect


def fits_alone(setting: Setting, bases: Sequence[str]) -> dict[str, Fitted]:
    """Each curve alone under a given noise, from the best of its starts."""
    fits = starts_under(setting, bases)
    return {
        base: min((one for one in fits if one.base == base), key=lambda fitted: fitted.total)
        for base in bases
    }


def first_fits(alone: Mapping[str, Fitted]) -> dict[str, Fitted]:
    """The same curves, each refitted with a noise of its own."""
    own = side_by_side(with_own_noise, list(alone.values()))
    return dict(zip(alone, side_by_side(precise, own), strict=True))


def starts_under(setting: Setting, bases: Sequence[str]) -> list[Fitted]:
    """Each curve alone under a given noise, from each of its starts."""
    top = _top(setting)
    starts = [(base, start) for base in bases for start in BASES[base].starts(top)]
    return side_by_side(lambda one: nearly_fitted(setting, *one, ()), starts)


def middle_start_under(setting: Setting, base: str, effects: Sequence[Effect]) -> Fitted:
    """A curve with effects under a given noise, from the middle one of the curve's starts only."""
    starts = BASES[base].starts(_top(setting))
    return nearly_fitted(setting, base, starts[len(starts) // 2], effects)


def _top(setting: Setting) -> float:
    """The 98 % quantile of adhesion, which stands for its maximum."""
    inside = setting.problem.points > 0
    return float(np.quantile(np.abs(setting.problem.data.adhesion[inside]), 0.98))


def refits(fits: Mapping[str, Fitted], effects: Sequence[Effect]) -> dict[str, Fitted]:
    """Each curve refitted with the effects, from the parameters that it has."""

    def refit(fitted: Fitted) -> Fitted:
        return likeliest(fitted.setting, fitted.base, fitted.base_values.tolist(), effects)

    return dict(zip(fits, side_by_side(refit, list(fits.values())), strict=True))


def bic(fitted: Fitted) -> float:
    """-2 ln L + p ln N for N points and p fitted parameters of curve and effects. Schwarz 1978."""
    points = int((np.asarray(fitted.setting.noise.weight) > 0).sum())
    return 2 * fitted.total + len(fitted.places) * float(np.log(points))
