"""The true load, for comparison: the best that an observer could give."""

from typing import NamedTuple

import jax.numpy as jnp

from adhesion_jax.traction.observers.base import Observer
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import Measurement, PerAxle


class TrueLoadState(NamedTuple):
    load: PerAxle
    slip: PerAxle


class TrueLoad(Observer):
    """The true T_L in N m, which no train can measure."""

    TOLD_LOAD = True

    def init(self, nominal: Plant, measured: Measurement) -> TrueLoadState:
        return TrueLoadState(jnp.zeros_like(measured.motor_speed), measured.slip)

    def update(
        self,
        state: TrueLoadState,
        nominal: Plant,
        measured: Measurement,
        torque: PerAxle,
        step: float,
    ) -> TrueLoadState:
        assert measured.load is not None
        return TrueLoadState(measured.load, measured.slip)
