"""The contract of a controller: it commands the torque of each motor at every control sample."""

from abc import abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import PerAxle, Reference, Setting, Signals


class Controller(eqx.Module):
    """Its fields are settings; numbers among them may differ without a new compilation.

    A controller that follows a slip needs a seeker; another computes its torque without one. The
    loop lowers its command to the driver's demand and keeps it within the limits of the drive.
    """

    FOLLOWS: ClassVar[bool] = True  # whether it follows the slip that a seeker asks for
    BOX: ClassVar[Mapping[str, Range]] = MappingProxyType({})  # of the fields that are tuned

    def init(self, nominal: Plant, signals: Signals) -> Any:
        """The state before the first control sample; by default there is none."""
        return ()

    @abstractmethod
    def update(
        self, state: Any, nominal: Plant, signals: Signals, period: float
    ) -> tuple[Any, PerAxle]:
        """The state and the torques in N m at a control sample, `period` seconds after the last."""


def torque_for(nominal: Plant, signals: Signals, acceleration: PerAxle) -> PerAxle:
    """The torque at which slip changes at a rate in m/s^2: T_L + (i J/r)(dv_s + dV).

    dV is the acceleration of the train that the adhesion observed gives it.
    """
    train = nominal.acceleration(signals.adhesion, signals.train_speed)
    turning = nominal.gear_ratio * nominal.inertia / nominal.radius
    return signals.load + turning * (acceleration + train)


def at_least(least: Setting, nominal: Plant, signals: Signals, torque: PerAxle) -> PerAxle:
    """The torque, which in the driver's direction is this share of the largest or more."""
    sign = signals.direction
    return sign * jnp.maximum(sign * torque, least * nominal.torque_limit)


def followed(signals: Signals) -> Reference:
    """The reference of a controller that needs a seeker; the loop makes sure that it has one."""
    if signals.reference is None:
        raise TypeError("a controller that follows a slip was given no reference")
    return signals.reference
