"""The full-dimension state observer with a double pole, and the true load."""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp
import numpy as np

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.observers.base import Observer
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import Measurement, PerAxle, Setting


class FullDimensionState(NamedTuple):
    speed: PerAxle  # rad/s
    load: PerAxle  # N m
    slip: PerAxle  # m/s, through the same low-pass
    slip_rate: PerAxle


class FullDimension(Observer):
    """dw^ = 2 p (w^ - w) + (T - T_L^)/J, dT_L^ = J p^2 (w^ - w), p < 0 in 1/s.

    T_L^ is T_L through p^2/(s - p)^2, so that a step is followed to 2 % after 5.83/|p|; the slip
    passes the same filter. After Fang et al. 2018, Eq. 7 and 10.
    """

    pole: Setting = -233.0

    BOX: ClassVar = {"pole": Range(-150.0, -1000.0, log=True)}

    def init(self, nominal: Plant, measured: Measurement) -> FullDimensionState:
        none = jnp.zeros_like(measured.motor_speed)
        return FullDimensionState(measured.motor_speed, none, measured.slip, none)

    def update(
        self,
        state: FullDimensionState,
        nominal: Plant,
        measured: Measurement,
        torque: PerAxle,
        step: float,
    ) -> FullDimensionState:
        ahead = state.speed - measured.motor_speed
        turning = 2 * self.pole * ahead + (torque - state.load) / nominal.inertia
        behind = measured.slip - state.slip
        bending = self.pole**2 * behind + 2 * self.pole * state.slip_rate
        return FullDimensionState(
            state.speed + step * turning,
            state.load + step * nominal.inertia * self.pole**2 * ahead,
            state.slip + step * state.slip_rate,
            state.slip_rate + step * bending,
        )

    def largest_step(self, nominal: Plant) -> float:
        return 2 / float(np.max(np.abs(self.pole)))


class TrueLoad(Observer):
    """The true T_L in N m, which no train can measure."""

    TOLD_LOAD = True

    def init(self, nominal: Plant, measured: Measurement) -> Measurement:
        return measured

    def update(
        self,
        state: Measurement,
        nominal: Plant,
        measured: Measurement,
        torque: PerAxle,
        step: float,
    ) -> Measurement:
        return measured
