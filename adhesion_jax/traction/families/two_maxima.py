"""Surfaces with two maxima of adhesion."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from adhesion_jax.curves import SLIP_LIMIT, Conditions, Law, Peak, Scalar, Signal
from adhesion_jax.curves.peak import find_peak
from adhesion_jax.traction.families.base import (
    Family,
    between,
    exponential,
    log_between,
    peaks,
    starts,
)
from adhesion_jax.traction.rails import ByTime
from adhesion_jax.traction.surface import RailSurface

#: Bounds of the slip of the second maximum in m/s, and of its adhesion over that of the first.
SECOND, SHARES = (0.6, 1.2), (0.9, 1.3)

#: The power of the second hump: it is narrow enough to leave the first maximum where it is.
_POWER = 20.0


class _Sum(NamedTuple):
    first: Law
    height: Scalar
    slip: Scalar

    def at(self, slip: Signal) -> Signal:
        size = jnp.abs(slip) / self.slip
        hump = jnp.exp(_POWER * (jnp.log(jnp.maximum(size, 1e-9)) + 1 - size))
        return self.first(slip, {}) + self.height * jnp.sign(slip) * hump


class TwoMaxima(Law):
    """mu(v) = mu_1(v) + A (x exp(1 - x))^20, x = v/v_2, mu_1 exponential, odd in v.

    `largest` is the higher maximum, found when the rail is drawn.
    """

    sum: _Sum
    largest: Peak

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        return self.sum.at(slip)

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        return self.largest


class TwoMaximaRails(Family):
    """The higher maximum is as high as that of nominal rails, the second at .6 to 1.2 m/s."""

    TITLE = "curves with a second maximum at .6 to 1.2 m/s"

    def draw(self, key: PRNGKeyArray, step: float) -> ByTime:
        of_peaks, of_slips, of_shares, of_starts = jax.random.split(key, 4)
        second, share = log_between(of_slips, SECOND), between(of_shares, SHARES)
        surfaces = RailSurface(jax.vmap(_law)(*peaks(of_peaks), second, share))
        return ByTime(surfaces, starts(of_starts, step))


def _law(slip: Scalar, adhesion: Scalar, second: Scalar, share: Scalar) -> TwoMaxima:
    lower = adhesion / jnp.maximum(share, 1.0)
    first = exponential(slip, lower).law
    humps = _Sum(first, share * lower - first(jnp.asarray(second), {}), second)
    return TwoMaxima(humps, _higher(humps))


def _higher(humps: _Sum) -> Peak:
    """The higher maximum: each is searched by itself, since they may be as good as equal."""
    low = 0.7 * humps.slip
    second = find_peak(lambda beyond: humps.at(low + beyond), low)
    second = second._replace(slip=low + second.slip)
    first = find_peak(humps.at, 0.7 * SECOND[0])
    return jax.tree.map(
        lambda *each: jnp.where(first.adhesion > second.adhesion, *each), first, second
    )
