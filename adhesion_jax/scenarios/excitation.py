"""The slips that a run goes through, and what is measured of them."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.options import Points, SlipMax
from adhesion_jax.records import OWN_SLIP, SHARED_SLIP


class Excited(NamedTuple):
    """The signals of a run, in the shape of its `Course`."""

    slip: Float[Array, "*shape"]  # the true one
    measured: Float[Array, "*shape"]  # slip
    conditions: dict[str, Float[Array, "*shape"]]  # measured columns


class Reached(NamedTuple):
    """How far a growing sequence has come at some of its lengths, and what that is called."""

    label: str
    values: Sequence[float]


class Excitation(eqx.Module):
    #: Zero for each field of a record that differs from run to run, None for one shared by all.
    AXES: eqx.AbstractClassVar[Any]

    @abstractmethod
    def draw(self, key: PRNGKeyArray, shape: tuple[int, ...]) -> tuple[Excited, PRNGKeyArray]:
        """The signals of a run, neighbours along the last axis, and the key that is left."""

    def reached(self, lengths: Sequence[int]) -> Reached:
        return Reached("samples seen (1)", [float(length) for length in lengths])


class Sweep(Excitation):
    """Slip rises from 0 to `slip_max` in equal steps, the same in every run and block."""

    points: Points = eqx.field(default=500, static=True)
    slip_max: SlipMax = eqx.field(default=0.2, static=True)
    AXES: ClassVar[Any] = SHARED_SLIP

    def slips(self) -> Float[Array, " points"]:
        # By NumPy: the same bits, whatever program draws them.
        return jnp.asarray(np.linspace(0.0, self.slip_max, self.points))

    def draw(self, key: PRNGKeyArray, shape: tuple[int, ...]) -> tuple[Excited, PRNGKeyArray]:
        slip = jnp.broadcast_to(self.slips(), shape)
        return Excited(slip, slip, {}), key

    def reached(self, lengths: Sequence[int]) -> Reached:
        slips = np.asarray(self.slips())
        return Reached("slip reached (1)", [float(slips[length - 1]) for length in lengths])


class RandomSlips(Excitation):
    """The slip of every sample is uniform on 0 to `slip_max`, and independent of all others."""

    points: Points = eqx.field(default=1000, static=True)
    slip_max: SlipMax = eqx.field(default=0.2, static=True)
    AXES: ClassVar[Any] = OWN_SLIP

    def draw(self, key: PRNGKeyArray, shape: tuple[int, ...]) -> tuple[Excited, PRNGKeyArray]:
        slip_key, left = jax.random.split(key)
        slip = jax.random.uniform(slip_key, shape, maxval=self.slip_max)
        return Excited(slip, slip, {}), left
