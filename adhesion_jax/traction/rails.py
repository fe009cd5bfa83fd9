"""Surfaces one after the other: by time, or by the speed of the train."""

from abc import abstractmethod
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from adhesion_jax.errors import InputError
from adhesion_jax.traction.surface import RailSurface


class Rails(eqx.Module):
    """Surfaces of the segments of a run, the segments along the first axis of their parameters."""

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

    def surface(self, segment: Int[Array, ""]) -> RailSurface:
        return jax.tree.map(lambda numbers: numbers[segment], self.surfaces)


class ByTime(Rails):
    """A new surface at each of some steps of the plant, the first of which is 0."""

    surfaces: RailSurface
    starts: Int[Array, " segments"]

    @property
    def segments(self) -> int:
        return self.starts.size

    def segment(
        self, step: Int[Array, ""], train_speed: Float[Array, ""], braking: Bool[Array, ""]
    ) -> Int[Array, ""]:
        return jnp.sum(step >= self.starts) - 1


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
