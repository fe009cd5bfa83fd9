"""Exponential surfaces that pass into each other."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from adhesion_jax.traction.families.base import Family, exponentials, starts
from adhesion_jax.traction.rails import Timed
from adhesion_jax.traction.signals import Number
from adhesion_jax.traction.surface import RailSurface

#: Duration of a transition in s, from the start of a segment on.
TRANSITION = 1.0


class Passing(Timed):
    """Each parameter p passes from that of the segment before as p0^(1 - x) p1^x, x from 0 to 1.

    x grows in proportion to time over the steps of a transition.
    """

    surfaces: RailSurface
    starts: Int[Array, " segments"]
    steps: Float[Array, ""]

    def present(
        self, state: tuple[()], segment: Int[Array, ""], step: Int[Array, ""], train_speed: Number
    ) -> RailSurface:
        passed = jnp.clip((step - self.starts[segment]) / self.steps, 0.0, 1.0)
        return jax.tree.map(
            lambda old, new: old ** (1 - passed) * new**passed,
            self.surface(jnp.maximum(segment - 1, 0)),
            self.surface(segment),
        )


class SlowRails(Family):
    """The nominal rails, whose peak passes into the next one within a second."""

    TITLE = "exponential curves that pass into each other within 1 s"

    def draw(self, key: PRNGKeyArray, step: float) -> Passing:
        of_surfaces, of_starts = jax.random.split(key)
        steps = jnp.asarray(TRANSITION / step)
        return Passing(exponentials(of_surfaces), starts(of_starts, step), steps)
