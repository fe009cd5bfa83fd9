"""The slips that a run goes through, and what is measured of them."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.options import Points, SlipMax, SlipNoise
from adhesion_jax.records import OWN_SLIP, SHARED_SLIP, record_axes

#: Speed of the vehicle, m/s. Fang et al. 2018 does not print it; our choice for a train under way.
VEHICLE_SPEED = 20.0

#: Time between two samples, s. Fang et al. 2018 does not print it; our choice for its controller.
_SAMPLING = 0.01

#: Time in which the slip velocity goes from its least to its largest value and back, s.
_PERIOD = 8.0

#: The least slip velocity, as a share of the largest.
_LEAST = 0.125

#: Standard deviation of the measured slip velocity, m/s, as of a wheel encoder.
_SIGMA_VELOCITY = 0.005


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
    @property
    @abstractmethod
    def points(self) -> int:
        """Along the last axis."""

    @property
    @abstractmethod
    def slip_noise(self) -> float:
        """Standard deviation of the noise of the measured slip."""

    @property
    @abstractmethod
    def axes(self) -> Any:
        """Zero for each field of a record that differs from run to run, None for one shared."""

    @abstractmethod
    def draw(self, key: PRNGKeyArray, shape: tuple[int, ...]) -> tuple[Excited, PRNGKeyArray]:
        """The signals of a run, neighbours along the last axis, and the key that is left."""

    def reached(self, lengths: Sequence[int]) -> Reached:
        return Reached("samples seen (1)", [float(length) for length in lengths])

    def noisy(
        self, slip: Float[Array, "*shape"], key: PRNGKeyArray
    ) -> tuple[Float[Array, "*shape"], PRNGKeyArray]:
        """The slip as it is measured, and the key that is left."""
        if self.slip_noise == 0.0:
            return slip, key
        noise_key, left = jax.random.split(key)
        return slip + self.slip_noise * jax.random.normal(noise_key, slip.shape), left


class Sweep(Excitation):
    """Slip rises from 0 to `slip_max` in equal steps, the same in every run and block."""

    points: Points = eqx.field(default=500, static=True)
    slip_max: SlipMax = eqx.field(default=0.2, static=True)
    slip_noise: SlipNoise = eqx.field(default=0.0, static=True)

    @property
    def axes(self) -> Any:
        return OWN_SLIP if self.slip_noise else SHARED_SLIP

    def slips(self) -> Float[Array, " points"]:
        # By NumPy: the same bits, whatever program draws them.
        return jnp.asarray(np.linspace(0.0, self.slip_max, self.points))

    def draw(self, key: PRNGKeyArray, shape: tuple[int, ...]) -> tuple[Excited, PRNGKeyArray]:
        slip = jnp.broadcast_to(self.slips(), shape)
        measured, left = self.noisy(slip, key)
        return Excited(slip, measured, {}), left

    def reached(self, lengths: Sequence[int]) -> Reached:
        slips = np.asarray(self.slips())
        return Reached("slip reached (1)", [float(slips[length - 1]) for length in lengths])


class RandomSlips(Excitation):
    """The slip of every sample is uniform on 0 to `slip_max`, and independent of all others."""

    points: Points = eqx.field(default=1000, static=True)
    slip_max: SlipMax = eqx.field(default=0.2, static=True)
    slip_noise: SlipNoise = eqx.field(default=0.0, static=True)

    @property
    def axes(self) -> Any:
        return OWN_SLIP

    def draw(self, key: PRNGKeyArray, shape: tuple[int, ...]) -> tuple[Excited, PRNGKeyArray]:
        slip_key, left = jax.random.split(key)
        slip = jax.random.uniform(slip_key, shape, maxval=self.slip_max)
        measured, left = self.noisy(slip, left)
        return Excited(slip, measured, {}), left


class Wave(Excitation):
    """Slip velocity v_s follows a sine of time, and is measured with noise of its own."""

    points: Points = eqx.field(default=1800, static=True)
    #: By default a multiple of that of the peak.
    slip_max: SlipMax | None = eqx.field(default=None, static=True)

    @property
    def slip_noise(self) -> float:
        return _SIGMA_VELOCITY / VEHICLE_SPEED

    @property
    def axes(self) -> Any:
        """Every run measures its own signals at the same times."""
        return record_axes(0, 0, {"slip_velocity_mps": 0, "time_s": None})

    def slip(self, time: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """The true slip, at its least at time 0."""
        assert self.slip_max is not None
        height = 0.5 * (1 - jnp.cos(2 * jnp.pi * time / _PERIOD))
        return self.slip_max * (_LEAST + (1 - _LEAST) * height)

    def draw(self, key: PRNGKeyArray, shape: tuple[int, ...]) -> tuple[Excited, PRNGKeyArray]:
        velocity_key, left = jax.random.split(key)
        time = _SAMPLING * jnp.arange(self.points)
        slip = self.slip(time)
        velocity = VEHICLE_SPEED * slip
        velocity = velocity + _SIGMA_VELOCITY * jax.random.normal(velocity_key, shape)
        conditions = {"slip_velocity_mps": velocity, "time_s": time}
        return Excited(slip, velocity / VEHICLE_SPEED, conditions), left
