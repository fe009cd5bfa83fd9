"""Exponential surfaces that depend on the speed of the train."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from adhesion_jax.traction.families.base import (
    SPEED,
    Family,
    between,
    exponential,
    peaks,
    starts,
)
from adhesion_jax.traction.rails import Timed
from adhesion_jax.traction.signals import Number
from adhesion_jax.traction.surface import RailSurface, Scaled

#: Bounds of the power of the speed with which adhesion falls.
POWERS = (0.0, 1.0)


class Falling(Timed):
    """mu(v_s, V) = (V/5 m/s)^-q mu(v_s/V): the best slip is a fixed share of the speed V.

    Below .5 m/s adhesion is that at .5 m/s.
    """

    surfaces: RailSurface  # in slip ratio
    starts: Int[Array, " segments"]
    powers: Float[Array, " segments"]

    def present(
        self, state: tuple[()], segment: Int[Array, ""], step: Int[Array, ""], train_speed: Number
    ) -> RailSurface:
        surface = self.surface(segment)
        left = (jnp.maximum(jnp.abs(train_speed), 0.5) / SPEED) ** -self.powers[segment]
        return RailSurface(Scaled(surface.law, left), in_ratio=True)


class SpeedRails(Family):
    """The peaks are drawn at 5 m/s; at each other speed of the train they are others."""

    TITLE = "exponential curves in slip ratio, lower at higher speed of the train"

    def draw(self, key: PRNGKeyArray, step: float) -> Falling:
        of_peaks, of_powers, of_starts = jax.random.split(key, 3)
        slip, adhesion = peaks(of_peaks)
        surfaces = RailSurface(jax.vmap(exponential)(slip / SPEED, adhesion).law, in_ratio=True)
        return Falling(surfaces, starts(of_starts, step), between(of_powers, POWERS))
