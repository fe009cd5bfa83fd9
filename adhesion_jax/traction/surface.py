"""What a wheel rolls on: a law of adhesion in slip velocity or in slip ratio."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Law

#: Below this speed in m/s a slip ratio is taken as if the train had it: a ratio has no bound there.
_SLOWEST = 0.5


class Surface(eqx.Module):
    """Adhesion at a slip velocity in m/s.

    The law is asked at the slip velocity itself, or at its ratio to the speed of the train. The
    parameters of the law are scalars, or have the shape of the contacts.
    """

    law: Law
    in_ratio: bool = eqx.field(default=False, static=True)

    def __call__(
        self, slip_velocity: Float[Array, "*contacts"], train_speed: Float[Array, ""]
    ) -> Float[Array, "*contacts"]:
        per = jnp.maximum(jnp.abs(train_speed), _SLOWEST) if self.in_ratio else 1.0
        return self.law(slip_velocity / per, {"vehicle_speed_mps": train_speed})
