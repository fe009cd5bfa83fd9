"""A wheel whose slip velocity moves up and down across the peak, for the slope of the curve."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import Curve
from adhesion_jax.errors import InputError
from adhesion_jax.options import Outliers, Points, Rail, Sigma, SlipMax
from adhesion_jax.records import Known, Record, record_axes
from adhesion_jax.scenarios.base import Group, Scenario
from adhesion_jax.scenarios.draws import normal
from adhesion_jax.scenarios.noise import draw_noise
from adhesion_jax.scenarios.rails import HE2018, RAILS, peak_of, rail_named

#: Number of samples between two reports.
_BLOCK = 10

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

#: Every run measures its own signals at the same times.
_RUN_AXES = record_axes(0, 0, {"slip_velocity_mps": 0, "time_s": None})

_KNOWN = dataclasses.replace(HE2018, by_sample=True, asked=("slope",))


class SlopeStream(Scenario):
    """One rail; slip velocity v_s follows a sine of time, adhesion Burckhardt's curve.

    Adhesion and slip velocity are both measured with noise. The quantity sought is d mu/d v_s
    in s/m at the present slip velocity. It is close to zero beyond the peak, so that a relative
    error of it means little.
    """

    rails: tuple[str, ...] = eqx.field(static=True)
    sigma: float = eqx.field(static=True)
    outliers: float = eqx.field(static=True)
    slip_max: float = eqx.field(static=True)
    truth: tuple[Curve, ...]
    known: Known
    run_axes: Any = eqx.field(default=_RUN_AXES, static=True)

    def time(self) -> Float[Array, "blocks points"]:
        shape = (len(self.rails), _BLOCK)
        return _SAMPLING * jnp.arange(shape[0] * shape[1]).reshape(shape)

    def slip(self, time: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """The true slip, at its least at time 0."""
        height = 0.5 * (1 - jnp.cos(2 * jnp.pi * time / _PERIOD))
        return self.slip_max * (_LEAST + (1 - _LEAST) * height)

    def draw(self, key: PRNGKeyArray) -> Record:
        velocity_key, noise_key = jax.random.split(key)
        time = self.time()
        slip = self.slip(time)
        every = jnp.ones(time.shape, dtype=bool)
        velocity = _VEHICLE_SPEED * slip
        velocity = velocity + _SIGMA_VELOCITY * normal(velocity_key, time.shape)
        noise = draw_noise(noise_key, time.shape, self.sigma, self.outliers)
        adhesion = self.truth[0](slip, {}) + noise
        conditions = {"slip_velocity_mps": velocity, "time_s": time}
        return Record(velocity / _VEHICLE_SPEED, adhesion, every, every, conditions)

    def quantities(self) -> Mapping[str, np.ndarray]:
        slope = jax.vmap(jax.grad(lambda slip: self.truth[0](slip, {})))
        return {"slope": np.asarray(slope(self.slip(self.time()[:, -1]))) / _VEHICLE_SPEED}

    def bound(self, record: Record) -> Float[Array, "blocks values"]:
        """NaN: the slope differs from sample to sample, and no curve that joins them is known."""
        return jnp.full((len(self.rails), 1), jnp.nan)

    def support(self) -> np.ndarray:
        return _BLOCK * (np.arange(len(self.rails)) + 1)

    def tables(self) -> Mapping[str, Sequence[Group]]:
        """The last block in the summary; k counts the samples seen."""
        blocks = len(self.rails)
        spaced = range(_SPACING - 1, blocks, _SPACING)
        checkpoints = [Group(self.rails[b], (b,), k=_BLOCK * (b + 1)) for b in spaced]
        return {
            "summary": [Group(self.rails[-1], (blocks - 1,))],
            "checkpoints": checkpoints,
        }


def fang2018_slope(
    rail: Rail = "dry",
    sigma: Sigma = 0.01,
    points: Points = 1800,
    slip_max: SlipMax | None = None,
    outliers: Outliers = 0.0,
) -> SlopeStream:
    """1800 samples while slip velocity moves across the peak and back, for d mu/d v_s."""
    if points % _BLOCK or points < _BLOCK * _SPACING:
        raise InputError(
            f"--points {points} does not go with --scenario fang2018-slope; "
            f"it takes a multiple of {_BLOCK}, at least {_BLOCK * _SPACING}."
        )
    rail = rail_named(rail)
    truth, blocks = RAILS[rail], points // _BLOCK
    return SlopeStream(
        rails=(rail,) * blocks,
        sigma=sigma,
        outliers=outliers,
        slip_max=_BEYOND * peak_of(truth)[0] if slip_max is None else slip_max,
        truth=(truth,) * blocks,
        known=_KNOWN,
    )
