"""The curve below the effects: which family, and where its fit starts."""

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

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

#: The families that the automatic choice is between; the magic formula absorbs real effects.
FAMILIES = ("burckhardt", "kiencke", "polach-falling", "polach-scaled", "exponential")


def _starts(base: str, top: float) -> Sequence[Sequence[float]]:
    """Steep, middle and flat curves of about the largest adhesion of the data."""
    match base:
        case "burckhardt":
            return [(1.1 * top, steep, top) for steep in (25.0, 70.0, 250.0)]
        case "kiencke":
            # Peak at slip l: p2 = 1/l^2, p1 = 1/l, a0 = top (p1 + 2/l).
            return [(3 * top / at, 1 / at, at**-2) for at in (0.015, 0.05, 0.15)]
        case "polach-falling" | "polach-scaled":
            inner = product((0.5,), (40.0, 150.0), (0.3, 0.9))
            return [(1.4 * top, 0.5, b, stiff, k_s) for b, stiff, k_s in inner]
        case "exponential":
            return [(2.0, steep, 1.2 * top) for steep in (25.0, 70.0, 250.0)]
        case "polach":
            return [(1.1 * top, stiff) for stiff in (30.0, 100.0, 400.0)]
        case "magic-formula":
            return [(steep, 1.5, top, 0.0) for steep in (10.0, 40.0, 150.0)]
        case _:
            return [(top,)]


def fits_alone(setting: Setting, bases: Sequence[str]) -> dict[str, Fitted]:
    """Each curve alone under a given noise, from the best of its starts."""
    fits = [starts_under(setting, base) for base in bases]
    return {some[0].base: min(some, key=lambda fitted: fitted.total) for some in fits}


def first_fits(alone: Mapping[str, Fitted]) -> dict[str, Fitted]:
    """Each curve alone with its own noise."""
    own = side_by_side(with_own_noise, list(alone.values()))
    return dict(zip(alone, side_by_side(precise, own), strict=True))


def starts_under(setting: Setting, base: str) -> list[Fitted]:
    """A curve alone under a given noise, from each of its starts."""
    starts = _starts(base, _top(setting))
    return side_by_side(lambda start: nearly_fitted(setting, base, start, ()), list(starts))


def middle_start_under(setting: Setting, base: str, effects: Sequence[Effect]) -> Fitted:
    """A curve with effects under a given noise, from the middle one of the curve's starts."""
    starts = _starts(base, _top(setting))
    return nearly_fitted(setting, base, starts[len(starts) // 2], effects)


def _top(setting: Setting) -> float:
    """About the largest adhesion of the data."""
    inside = setting.problem.points > 0
    return float(np.quantile(np.abs(setting.problem.data.adhesion[inside]), 0.98))


def refits(fits: Mapping[str, Fitted], effects: Sequence[Effect]) -> dict[str, Fitted]:
    """Each curve with the same effects, from where it was."""

    def refit(fitted: Fitted) -> Fitted:
        return likeliest(fitted.setting, fitted.base, fitted.base_values.tolist(), effects)

    return dict(zip(fits, side_by_side(refit, list(fits.values())), strict=True))


def bic(fitted: Fitted) -> float:
    """-2 ln L + p ln N, N the points, p the parameters of curve and effects. Schwarz 1978."""
    points = int((np.asarray(fitted.setting.noise.weight) > 0).sum())
    return 2 * fitted.total + len(fitted.places) * float(np.log(points))
