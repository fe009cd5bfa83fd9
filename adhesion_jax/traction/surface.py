"""The surface of a rail: a law of adhesion in slip velocity or in slip ratio."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import SLIP_LIMIT, Law, Peak
from adhesion_jax.curves.base import SLIP_VELOCITY_LIMIT

#: Smallest speed in m/s by which a slip velocity is divided: slip ratios diverge at rest.
_SLOWEST = 0.5


class RailSurface(eqx.Module):
    """Adhesion at a slip velocity in m/s.

    The law is evaluated at the slip velocity itself, or at its ratio to the speed of the train. The
    parameters of the law are scalars, or one for each axle.
    """

    law: Law
    in_ratio: bool = eqx.field(default=False, static=True)

    def __call__(
        self, slip_velocity: Float[Array, "*contacts"], train_speed: Float[Array, ""]
    ) -> Float[Array, "*contacts"]:
        per = _per(train_speed) if self.in_ratio else 1.0
        return self.law(slip_velocity / per, {"vehicle_speed_mps": train_speed})

    def peak(self, train_speed: Float[Array, ""]) -> Peak:
        """The largest adhesion in traction, and the slip velocity that it needs."""
        conditions = {"vehicle_speed_mps": train_speed}
        if not self.in_ratio:
            return self.law.peak(conditions, SLIP_VELOCITY_LIMIT)
        found = self.law.peak(conditions, SLIP_LIMIT)
        return found._replace(slip=found.slip * _per(train_speed))


def _per(train_speed: Float[Array, ""]) -> Float[Array, ""]:
    return jnp.maximum(jnp.abs(train_speed), _SLOWEST)
