"""A sliding mode controller of slip, with and without a boundary layer."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.traction.controllers.base import (
    Controller,
    Scalar,
    direction,
    following,
    torque_for,
)
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import Reference, Signals


class SlidingMode(Controller):
    """T = T_L + (i J/r)(dV + dv*) - gain sat(z/layer), z = v_s - v*; a layer of 0 is the sign."""

    gain: Scalar  # N m
    layer: Scalar  # m/s
    least: Scalar  # torque, as a share of the largest

    def init(self, nominal: Plant, signals: Signals) -> tuple[()]:
        return ()

    def update(
        self,
        state: tuple[()],
        nominal: Plant,
        signals: Signals,
        reference: Reference | None,
        period: float,
    ) -> tuple[tuple[()], Float[Array, " axles"]]:
        asked, sign = following(reference), direction(signals)
        error = signals.slip - asked.slip
        switched = self.gain * jnp.clip(error / jnp.maximum(self.layer, 1e-12), -1.0, 1.0)
        torque = sign * (torque_for(nominal, signals, asked.rate) - switched)
        return state, sign * jnp.maximum(torque, self.least * nominal.torque_limit)
