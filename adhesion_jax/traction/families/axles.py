"""Exponential surfaces of each axle's own, and wheels that are worn as control does not know."""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from adhesion_jax.errors import InputError
from adhesion_jax.traction.families.base import SEGMENTS, Family, exponential, peaks, starts
from adhesion_jax.traction.loop import Loop
from adhesion_jax.traction.plants.rigid_axles import RigidAxles
from adhesion_jax.traction.rails import ByTime

#: By how much the radius of the wheels of each axle differs from the one that is known, m; assumed.
WEAR = (0.004, -0.004, 0.002, -0.002, 0.003, -0.003, 0.001, -0.001)


class AxleRails(Family):
    """Each of eight axles has peaks of its own, which change at one time for all."""

    TITLE = "exponential curves of each axle's own under wheels that are worn by up to 4 mm"

    def draw(self, key: PRNGKeyArray, step: float) -> ByTime:
        of_surfaces, of_starts = jax.random.split(key)
        each = (x.reshape(SEGMENTS, -1) for x in peaks(of_surfaces, SEGMENTS * len(WEAR)))
        return ByTime(jax.vmap(jax.vmap(exponential))(*each), starts(of_starts, step))

    def met(self, loop: Loop) -> Loop:
        axles = loop.slip.size
        if not isinstance(loop.plant, RigidAxles) or axles != len(WEAR):
            raise InputError(
                f"these rails are those of {len(WEAR)} axles of a locomotive, and the plant has "
                f"{axles}; give --plant hxd1f_axles."
            )
        worn = loop.plant.wheel_radius + jnp.asarray(WEAR)
        return replace(loop, plant=replace(loop.plant, wheel_radius=worn))
