"""The true load, for comparison: the best that an observer could give."""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.traction.observers.base import Observer
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import Measured


class TrueLoadState(NamedTuple):
    load: Float[Array, " axles"]
    slip: Float[Array, " axles"]


class TrueLoad(Observer):
    """The true T_L in N m, which no train can measure."""

    TOLD_LOAD: ClassVar[bool] = True

    def init(self, nominal: Plant, measured: Measured) -> TrueLoadState:
        return TrueLoadState(jnp.zeros_like(measured.motor_speed), measured.slip)

    def update(
        self,
        state: TrueLoadState,
        nominal: Plant,
        measured: Measured,
        torque: Float[Array, " axles"],
        step: float,
    ) -> TrueLoadState:
        assert measured.load is not None
        return TrueLoadState(measured.load, measured.slip)

    def load(self, state: TrueLoadState, nominal: Plant) -> Float[Array, " axles"]:
        return state.load

    def slip(self, state: TrueLoadState) -> Float[Array, " axles"]:
        return state.slip

    def largest_step(self, nominal: Plant) -> float:
        return np.inf
