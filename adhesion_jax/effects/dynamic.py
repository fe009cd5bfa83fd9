"""Causes with a memory, which a plant advances sample by sample."""

from abc import abstractmethod
from typing import Any

import jax.numpy as jnp

from adhesion_jax.curves import Conditions, Scalar
from adhesion_jax.effects.base import Signal, Value, Values
from adhesion_jax.effects.cause import AdhesionTransform, Cause
from adhesion_jax.effects.history import Filtered, filtered, lagged

#: What a cause remembers, and this after one more sample with the adhesion of that sample.
State = Any
Stepped = tuple[State, Value]


class Dynamic(Cause):
    """A cause with a memory, which a plant advances sample by sample.

    `init` is told the first sample of a run, `step` every sample from the first on; conditions
    are scalars with `time_s`. Over a run it gives what `after` gives; where `after` looks a sample
    ahead, for a rate, to the first order in the time between two samples.
    """

    @abstractmethod
    def init(self, adhesion: Value, slip: Value, conditions: Conditions) -> State:
        """The memory at the start of a run."""

    @abstractmethod
    def step(self, state: State, adhesion: Value, slip: Value, conditions: Conditions) -> Stepped:
        """The memory after one more sample, and the adhesion of that sample."""


class Lagging(AdhesionTransform, Dynamic):
    """A first-order lag of the adhesion, T dmu/dt + mu = mu_steady."""

    ORDER = 2

    @abstractmethod
    def time(self, conditions: Conditions) -> Values | Scalar:
        """The time constant T in s."""

    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        return lagged(adhesion, self.time(conditions), conditions)

    def init(self, adhesion: Value, slip: Value, conditions: Conditions) -> State:
        return Filtered(now(conditions), adhesion, adhesion)

    def step(self, state: State, adhesion: Value, slip: Value, conditions: Conditions) -> Stepped:
        state = filtered(state, adhesion, self.time(conditions), now(conditions))
        return state, state.value


def now(conditions: Conditions) -> Value:
    """Time of a sample, s."""
    return jnp.asarray(conditions["time_s"])
