"""The contract of an observer: it estimates the load of the motor, and so the adhesion.

It computes them from speed and torque at every step of the plant. Its fields are its settings,
numbers or arrays [axles] that may differ without a new compilation.
"""

import math
from abc import abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import equinox as eqx

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import Measurement, PerAxle


class Observer(eqx.Module):
    """J dw = T - T_L at the motor of each axle; adhesion is that of the load T_L.

    A state has the fields `load`, that of each motor in N m, and `slip`, the measured slip in m/s
    with the lag of the load if that lag is linear.
    """

    TOLD_LOAD: ClassVar[bool] = False  # whether it is given the true load, for comparison
    BOX: ClassVar[Mapping[str, Range]] = MappingProxyType({})  # of the fields that are tuned

    @abstractmethod
    def init(self, nominal: Plant, measured: Measurement) -> Any:
        """The state at the first measurement, without load."""

    @abstractmethod
    def update(
        self,
        state: Any,
        nominal: Plant,
        measured: Measurement,
        torque: PerAxle,
        step: float,
    ) -> Any:
        """The state a step of the plant later, by explicit Euler."""

    def largest_step(self, nominal: Plant) -> float:
        """The step in s beyond which explicit Euler is not stable; by default there is none."""
        return math.inf
