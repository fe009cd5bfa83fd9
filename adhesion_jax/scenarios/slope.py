"""A wheel whose slip velocity moves up and down across the peak, for the slope of the curve."""

import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.errors import InputError
from adhesion_jax.options import Points, Rail, SlipMax
from adhesion_jax.records import record_axes
from adhesion_jax.scenarios.base import Scenario
from adhesion_jax.scenarios.course import REPORT, Followed
from adhesion_jax.scenarios.excitation import Excitation, Excited
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rail_process import steady
from adhesion_jax.scenarios.rails import HE2018, RAILS, peak_of

#: Number of reports between two checkpoints.
_SPACING = 10

#: Speed of the vehicle, m/s. Fang et al. 2018 does not print it; our choice for a train under way.
_VEHICLE_SPEED = 20.0

#: Time between two samples, s. Fang et al. 2018 does not print it; our choice for its controller.
_SAMPLING = 0.01

#: Time in which the slip velocity goes from its least to its largest value and back, s.
_PERIOD = 8.0

#: The least slip velocity, as a share of the largest.
_LEAST = 0.125

#: The largest slip of the stream over the slip of the peak.
_BEYOND = 1.6

#: Standard deviation of the measured slip velocity, m/s, as of a wheel encoder.
_SIGMA_VELOCITY = 0.005

_KNOWN = dataclasses.replace(HE2018, by_sample=True, asked=("slope",))


class Wave(Excitation):
    """Slip velocity v_s follows a sine of time, and is measured with noise of its own."""

    points: Points = eqx.field(default=1800, static=True)
    #: By default a multiple of that of the peak.
    slip_max: SlipMax | None = eqx.field(default=None, static=True)
    #: Every run measures its own signals at the same times.
    AXES: ClassVar[Any] = record_axes(0, 0, {"slip_velocity_mps": 0, "time_s": None})

    def slip(self, time: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """The true slip, at its least at time 0."""
        assert self.slip_max is not None
        height = 0.5 * (1 - jnp.cos(2 * jnp.pi * time / _PERIOD))
        return self.slip_max * (_LEAST + (1 - _LEAST) * height)

    def draw(self, key: PRNGKeyArray, shape: tuple[int, ...]) -> tuple[Excited, PRNGKeyArray]:
        velocity_key, left = jax.random.split(key)
        time = _SAMPLING * jnp.arange(self.points)
        slip = self.slip(time)
        velocity = _VEHICLE_SPEED * slip
        velocity = velocity + _SIGMA_VELOCITY * jax.random.normal(velocity_key, shape)
        conditions = {"slip_velocity_mps": velocity, "time_s": time}
        return Excited(slip, velocity / _VEHICLE_SPEED, conditions), left


def fang2018_slope(rail: Rail = "dry", wave: Wave = Wave(), noise: Noise = Noise()) -> Scenario:
    """1800 samples while slip velocity moves across the peak and back, for d mu/d v_s.

    The quantity sought is d mu/d v_s in s/m at the present slip velocity. It is close to zero
    beyond the peak, so that a relative error of it means little. It has no bound: it differs from
    sample to sample, and no curve that joins them is known.
    """
    if wave.points % REPORT or wave.points < REPORT * _SPACING:
        raise InputError(
            f"--points {wave.points} does not go with --scenario fang2018-slope; "
            f"it takes a multiple of {REPORT}, at least {REPORT * _SPACING}."
        )
    rails = steady(RAILS, rail, wave.points // REPORT)
    rails = dataclasses.replace(rails, conditions={"vehicle_speed_mps": _VEHICLE_SPEED})
    if wave.slip_max is None:
        wave = dataclasses.replace(wave, slip_max=_BEYOND * peak_of(RAILS[rail])[0])
    course = Followed(wave.points, _SPACING, steady=False)
    return Scenario(rails, wave, noise, course, _KNOWN)
