"""The driver's demand: torque up to a speed, then braking down to another."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from adhesion_jax.traction.signals import PerAxle

TRACTION, BRAKING, DONE = 0, 1, 2


class Driver(eqx.Module):
    """Torques of a motor in N m and speeds in m/s; control can only lower what is asked for."""

    traction: Float[Array, ""] | float
    until: Float[Array, ""] | float = jnp.inf
    braking: Float[Array, ""] | float = 0.0
    down_to: Float[Array, ""] | float = 0.0

    def update(self, mode: Int[Array, ""], train_speed: Float[Array, ""]) -> Int[Array, ""]:
        """What the driver does at a speed of the train."""
        brakes = (mode == TRACTION) & (train_speed >= self.until)
        ends = (mode == BRAKING) & (train_speed <= self.down_to)
        return jnp.where(brakes | ends, mode + 1, mode)

    def demand(self, mode: Int[Array, ""]) -> Float[Array, ""]:
        return jnp.where(
            mode == TRACTION, self.traction, jnp.where(mode == BRAKING, -self.braking, 0.0)
        )


def lowered(demand: PerAxle, command: PerAxle) -> Array:
    """A command no larger than the demand, in the direction of the demand."""
    return jnp.where(demand >= 0, jnp.minimum(command, demand), jnp.maximum(command, demand))
