"""The contract of an observer: it estimates the load of the motor, and so the adhesion.

It computes them from speed and torque at every step of the plant. Its fields are its settings,
numbers or arrays [axles] that may differ without a new compilation.
"""

from abc import abstractmethod
from typing import Any, ClassVar

import equinox as eqx
from jaxtyping import Array, Float

from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import Measured

Scalar = float | Float[Array, "..."]


class Observer(eqx.Module):
    """J dw = T - T_L at the motor of each axle; adhesion is that of the load T_L."""

    TOLD_LOAD: ClassVar[bool] = False  # whether it is given the true load, for comparison

    @abstractmethod
    def init(self, nominal: Plant, measured: Measured) -> Any:
        """The state at the first measurement, without load."""

    @abstractmethod
    def update(
        self,
        state: Any,
        nominal: Plant,
        measured: Measured,
        torque: Float[Array, " axles"],
        step: float,
    ) -> Any:
        """The state a step of the plant later, by explicit Euler."""

    @abstractmethod
    def load(self, state: Any, nominal: Plant) -> Float[Array, " axles"]:
        """The load of each motor, N m."""

    @abstractmethod
    def slip(self, state: Any) -> Float[Array, " axles"]:
        """The measured slip in m/s, with the lag of the load if that lag is linear."""

    @abstractmethod
    def largest_step(self, nominal: Plant) -> float:
        """The step in seconds beyond which explicit Euler is not stable."""
