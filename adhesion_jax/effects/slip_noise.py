from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.effects.api import Conditions, Facts, Points, Scalar, Signal, SlipTransform
from adhesion_jax.effects.dynamic import has_history, steps

#: Multiples of the roughness of the whole run that a part of it may have; the roughness at a point
#: is estimated from `_AROUND` points on either side of it.
_ROUGHER = 4.0 ** np.arange(-5, 2)
_AROUND = 12


class SlipNoise(SlipTransform):
    """White noise is on the measured slip; adhesion follows the slip that is to be expected.

    The true slip is a random walk whose rate is a random walk of intensity `roughness`, the noise
    of the measured one has the standard deviation sigma, or sigma/V where it `falls_with` the
    vehicle speed V: E[l] is then the smoother of Rauch, Tung and Striebel. A wheel that slips now
    and then has a slip that is calm at most times and rough in a slip event: near each point the
    walk is as rough as makes the measured slips there likely. Source: regression calibration,
    Carroll et al. 2006, chapter 4; Rauch, Tung and Striebel 1965, AIAA J. 3:1445; noise of several
    intensities, Bar-Shalom, Li and Kirubarajan 2001, Estimation, chapter 11.6.
    """

    sigma: Scalar
    roughness: Scalar
    falls_with: str = eqx.field(static=True, default="")

    FACTS = Facts(
        source="Carroll et al. 2006, Measurement Error in Nonlinear Models, chapter 4",
        described={
            "sigma": ("1 or m/s", 0.0, 10.0, "noise of the slip, or of a speed"),
            "roughness": ("1/s^1.5", 1e-9, 1e6, "change of the rate of slip"),
        },
        strengths=("sigma",),
        starts=({"sigma": 1e-3, "roughness": 0.05},),
        needs=("time_s",),
        sentence="The slip signal is noisy: the true slip is estimated from neighbouring points "
        "in time.",
        formula="mu(E[l]), E[l] the slip to be expected where white noise is on the signal of the "
        "wheel speed",
        phrase="noise in the slip signal",
        family="slip_noise",
        rests_on=("slip_ratio",),
        screened=False,
    )

    def before(self, slip: Signal, conditions: Conditions) -> Signal:
        if not has_history(conditions):
            return slip
        return expected_slip(self, jnp.asarray(slip), conditions)


class _State(NamedTuple):
    """Slip and its rate, as they are known."""

    mean: Float[Array, "*points 2"]
    covariance: Float[Array, "*points 2 2"]


class _Course(NamedTuple):
    """The filter at every point of a run."""

    ahead: _State  # before the point itself is known
    known: _State  # with it
    step: Points  # since the point before
    log_density: Points  # of the measured slip, given those before


def log_density(noise: SlipNoise, slip: Points, conditions: Conditions) -> Points:
    """Log density of each measured slip of one run given those before; 0 for the first."""
    return _filtered(noise, slip, conditions).log_density


def expected_slip(noise: SlipNoise, slip: Points, conditions: Conditions) -> Points:
    """The smoothed slip of one run in the order of time, as rough as it is near each point.

    Of some roughnesses q each has a share w of a point by how likely it makes the measured slips
    around it, and exp(sum w ln q) is the intensity there.
    """

    def likely(times: Scalar) -> Array:
        kind = eqx.tree_at(lambda one: one.roughness, noise, times * noise.roughness)
        return _around(log_density(kind, slip, conditions))

    times = jnp.asarray(_ROUGHER)
    share = jax.nn.softmax(jax.vmap(likely)(times), axis=0)
    rough = noise.roughness * jnp.exp(jnp.log(times) @ share)
    return smoothed_slip(eqx.tree_at(lambda one: one.roughness, noise, rough), slip, conditions)


def _around(told: Points) -> Points:
    """Sums over the `_AROUND` points on either side of each point."""
    return jnp.convolve(told, jnp.ones(2 * _AROUND + 1), mode="full")[_AROUND : _AROUND + told.size]


def smoothed_slip(noise: SlipNoise, slip: Points, conditions: Conditions) -> Points:
    """The smoothed slip of one run in the order of time, of one roughness or of one for each point.

    Where no time passes from one point to the next the second is taken as a repetition, which
    tells nothing new.
    """
    course = _filtered(noise, slip, conditions)
    ahead = jax.tree.map(lambda states: states[1:], course.ahead)
    known = jax.tree.map(lambda states: states[:-1], course.known)

    def smoothed(later: Array, at: tuple[_State, _State, Array]) -> tuple[Array, Array]:
        before, to, dt = at
        # The covariance of the state with the next, times the inverse variance of the next.
        gain = _product(_product(before.covariance, _motion(dt).T), _inverse(to.covariance))
        better = before.mean + jnp.sum(gain * (later - to.mean), axis=1)
        return better, better

    last = course.known.mean[-1]
    _, means = jax.lax.scan(smoothed, last, (known, ahead, course.step[1:]), reverse=True)
    return jnp.append(means[:, 0], last[0])


def _motion(dt: Array) -> Array:
    """How slip and its rate go on for a time."""
    return jnp.array([[1.0, dt], [0.0, 1.0]])


def _product(a: Array, b: Array) -> Array:
    """The product of two matrices; written as a sum it takes half the time of a product here."""
    return jnp.sum(a[:, :, None] * b[None], axis=1)


def _inverse(matrix: Array) -> Array:
    (a, b), (c, d) = matrix
    return jnp.array([[d, -b], [-c, a]]) / (a * d - b * c)


def _filtered(noise: SlipNoise, slip: Points, conditions: Conditions) -> _Course:
    """The filter of Kalman 1960 from a wide start: slip and rate have a variance of one each."""
    step = steps(conditions)
    spread = noise.sigma / conditions[noise.falls_with] if noise.falls_with else noise.sigma
    error = jnp.broadcast_to(spread, slip.shape) ** 2 + 1e-16
    densities = jnp.broadcast_to(noise.roughness, slip.shape) ** 2

    def advanced(state: _State, now: tuple) -> tuple[_State, tuple]:
        dt, measured, variance, density, counts = now
        motion = _motion(dt)
        walk = density * jnp.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]) + 1e-18 * jnp.eye(2)
        ahead = _State(
            jnp.sum(motion * state.mean, axis=1),
            _product(_product(motion, state.covariance), motion.T) + walk,
        )
        innovation, of_slip = measured - ahead.mean[0], ahead.covariance[0]
        width = of_slip[0] + variance
        gain = jnp.where(counts, of_slip / width, 0.0)
        known = _State(ahead.mean + gain * innovation, ahead.covariance - gain[:, None] * of_slip)
        told = jnp.where(counts, -0.5 * (innovation**2 / width + jnp.log(width)), 0.0)
        return known, (ahead, known, told)

    # The first point is the start itself, about which nothing was known: it tells nothing.
    start = _State(jnp.stack([slip[0], jnp.zeros_like(slip[0])]), jnp.eye(2))
    counts = (step > 0).at[0].set(True)
    _, (ahead, known, told) = jax.lax.scan(advanced, start, (step, slip, error, densities, counts))
    return _Course(ahead, known, step, told.at[0].set(0.0))
