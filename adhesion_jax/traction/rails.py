"""Rails: surfaces one after the other, and what the wheels make of them."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from adhesion_jax.errors import InputError
from adhesion_jax.traction.signals import Number, PerAxle
from adhesion_jax.traction.surface import RailSurface


class Passed(NamedTuple):
    """What a rail was passed by in a step of the plant; of an axle the mean over its contacts."""

    segment: Int[Array, ""]
    slip: PerAxle  # m/s
    adhesion: PerAxle
    train_speed: Number  # m/s


class Rails(eqx.Module):
    """The surfaces of a run along the first axis of their parameters, and which lies where.

    A rail may have a state, which every step of the plant advances: how far the train has run, how
    clean it is. During a step the surface does not change. Most rails have none, and at any moment
    the surface of their segment.
    """

    surfaces: eqx.AbstractVar[RailSurface]

    @property
    @abstractmethod
    def segments(self) -> int:
        """How many there are."""

    @abstractmethod
    def segment(
        self, step: Int[Array, ""], train_speed: Float[Array, ""], braking: Bool[Array, ""]
    ) -> Int[Array, ""]:
        """Which segment a step of the plant belongs to."""

    def surface(self, number: Int[Array, ""]) -> RailSurface:
        return jax.tree.map(lambda numbers: numbers[number], self.surfaces)

    def init(self, slip: PerAxle, train_speed: Number) -> Any:
        """The state before the first step."""
        return ()

    def update(self, state: Any, passed: Passed, step: float) -> Any:
        """The state a step of the plant later, by explicit Euler."""
        return state

    def present(
        self, state: Any, segment: Int[Array, ""], step: Int[Array, ""], train_speed: Number
    ) -> RailSurface:
        """The surface under the train at a step of the plant."""
        return self.surface(segment)


class Timed(Rails):
    """A new segment at each of some steps of the plant, the first of which is 0."""

    starts: eqx.AbstractVar[Int[Array, " segments"]]

    @property
    def segments(self) -> int:
        return self.starts.size

    def segment(
        self, step: Int[Array, ""], train_speed: Float[Array, ""], braking: Bool[Array, ""]
    ) -> Int[Array, ""]:
        return jnp.sum(step >= self.starts) - 1


class ByTime(Timed):
    """A surface for each segment."""

    surfaces: RailSurface
    starts: Int[Array, " segments"]


class BySpeed(Rails):
    """Surfaces between speeds in m/s: those of traction, rising, then those of braking, falling."""

    surfaces: RailSurface
    in_traction: Float[Array, " rising"]
    in_braking: Float[Array, " falling"]

    @property
    def segments(self) -> int:
        return self.in_traction.size + self.in_braking.size + 2

    def segment(
        self, step: Int[Array, ""], train_speed: Float[Array, ""], braking: Bool[Array, ""]
    ) -> Int[Array, ""]:
        first = self.in_traction.size + 1
        driven = jnp.sum(train_speed >= self.in_traction)
        return jnp.where(braking, first + jnp.sum(train_speed < self.in_braking), driven)


def stacked(surfaces: Sequence[RailSurface]) -> RailSurface:
    """Surfaces of one kind as one whose parameters have the segments along their first axis."""
    return jax.tree.map(lambda *numbers: jnp.stack([*map(jnp.asarray, numbers)]), *surfaces)


def by_time(surfaces: Sequence[RailSurface], starts: Sequence[float], step: float) -> ByTime:
    """Surfaces from some moments in seconds on. InputError where one is off the grid of steps."""
    steps = np.round(np.asarray(starts) / step).astype(int)
    for moment, count in zip(starts, steps, strict=True):
        if abs(count * step - moment) > 1e-9:
            raise InputError(
                f"a surface begins at {moment:g} s, which is no multiple of the step of {step:g} s;"
                f" give {count * step:g} s or another step."
            )
    return ByTime(stacked(surfaces), jnp.asarray(steps))
