"""Surfaces whose adhesion rises with slip without end."""

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from adhesion_jax.curves import SLIP_LIMIT, Conditions, Law, Peak, Scalar, Signal
from adhesion_jax.traction.families.base import Family, peaks, starts
from adhesion_jax.traction.rails import ByTime
from adhesion_jax.traction.surface import RailSurface


class Saturating(Law):
    """mu(v) = mu_inf (1 - exp(-3 v/v95)), odd in v; mu(v95) = .95 mu_inf.

    It has no peak: what stands for it is mu_inf, with the slip v95 in m/s.
    """

    slip: Scalar
    level: Scalar

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        return -self.level * jnp.sign(slip) * jnp.expm1(-3 * jnp.abs(slip) / self.slip)

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        return Peak(jnp.asarray(self.slip), jnp.asarray(self.level), jnp.zeros((), dtype=bool))


class NoMaximumRails(Family):
    """Level and v95 are drawn as the peaks of other rails are."""

    TITLE = "curves that rise without end to a level"

    def draw(self, key: PRNGKeyArray, step: float) -> ByTime:
        of_surfaces, of_starts = jax.random.split(key)
        surfaces = RailSurface(jax.vmap(Saturating)(*peaks(of_surfaces)))
        return ByTime(surfaces, starts(of_starts, step))
