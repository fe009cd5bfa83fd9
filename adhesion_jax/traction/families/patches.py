"""Exponential surfaces by the place of the train."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from adhesion_jax.traction.families.base import Family, exponentials, log_between, starts
from adhesion_jax.traction.rails import Passed, Timed
from adhesion_jax.traction.signals import Number, PerAxle
from adhesion_jax.traction.surface import RailSurface

#: Number of patches, after which the first one comes again, and bounds of their lengths in m.
PATCHES, LENGTHS = 32, (0.5, 20.0)


class ByPosition(Timed):
    """A surface up to each of some distances in m, the last of which is their period.

    The segments are by time, as those of other rails, and mean nothing for the surfaces. All axles
    are at one place.
    """

    surfaces: RailSurface
    starts: Int[Array, " segments"]
    ends: Float[Array, " patches"]

    def init(self, slip: PerAxle, train_speed: Number) -> Number:
        """The distance run in m."""
        return jnp.zeros(())

    def update(self, state: Number, passed: Passed, step: float) -> Number:
        return state + step * passed.train_speed

    def present(
        self, state: Number, segment: Int[Array, ""], step: Int[Array, ""], train_speed: Number
    ) -> RailSurface:
        return self.surface(jnp.sum(state % self.ends[-1] >= self.ends))


class PatchRails(Family):
    """Patches between .5 and 20 m, lengths log-uniform, each with a peak of its own."""

    TITLE = "patches of .5 to 20 m, each with an exponential curve of its own"

    def draw(self, key: PRNGKeyArray, step: float) -> ByPosition:
        of_surfaces, of_starts, of_lengths = jax.random.split(key, 3)
        ends = jnp.cumsum(log_between(of_lengths, LENGTHS, PATCHES))
        return ByPosition(exponentials(of_surfaces, PATCHES), starts(of_starts, step), ends)
