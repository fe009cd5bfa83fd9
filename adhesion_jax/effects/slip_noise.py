from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from adhesion_jax.effects.api import Conditions, Facts, Scalar, Signal, SlipTransform, Values
from adhesion_jax.effects.base import Points
from adhesion_jax.effects.history import has_history

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
    """Slip and its rate: their means, variances and covariance."""

    slip: Values
    rate: Values
    of_slip: Values
    shared: Values
    of_rate: Values


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

    def smoothed(
        later: tuple[Array, Array], at: tuple[_State, _State, Array]
    ) -> tuple[tuple[Array, Array], Array]:
        before, to, dt = at
        # Gain: the covariance of the state with the next, times the inverse variance of the next.
        first, second = before.of_slip + dt * before.shared, before.shared
        third, fourth = before.shared + dt * before.of_rate, before.of_rate
        size = to.of_slip * to.of_rate - to.shared**2
        a = (first * to.of_rate - second * to.shared) / size
        b = (second * to.of_slip - first * to.shared) / size
        c = (third * to.of_rate - fourth * to.shared) / size
        d = (fourth * to.of_slip - third * to.shared) / size
        # By how much what comes later changes the mean of the next.
        slip, rate = later[0] - to.slip, later[1] - to.rate
        better = before.slip + a * slip + b * rate
        return (better, before.rate + c * slip + d * rate), better

    last = (course.known.slip[-1], course.known.rate[-1])
    _, slips = jax.lax.scan(smoothed, last, (known, ahead, course.step[1:]), reverse=True)
    return jnp.append(slips, last[0])


def _filtered(noise: SlipNoise, slip: Points, conditions: Conditions) -> _Course:
    """The filter of Kalman 1960 from a wide start: slip and rate have a variance of one each."""
    time = jnp.asarray(conditions["time_s"])
    step = jnp.diff(time, prepend=time[:1])
    spread = noise.sigma / conditions[noise.falls_with] if noise.falls_with else noise.sigma
    error = jnp.broadcast_to(spread, slip.shape) ** 2 + 1e-16
    densities = jnp.broadcast_to(noise.roughness, slip.shape) ** 2

    def advanced(state: _State, now: tuple) -> tuple[_State, tuple]:
        dt, measured, variance, density, counts = now
        ahead = _State(
            state.slip + dt * state.rate,
            state.rate,
            state.of_slip
            + dt * (2 * state.shared + dt * state.of_rate)
            + density * dt**3 / 3
            + 1e-18,
            state.shared + dt * state.of_rate + density * dt**2 / 2,
            state.of_rate + density * dt + 1e-18,
        )
        innovation, width = measured - ahead.slip, ahead.of_slip + variance
        gain = jnp.where(counts, ahead.of_slip / width, 0.0)
        of_rate = jnp.where(counts, ahead.shared / width, 0.0)
        known = _State(
            ahead.slip + gain * innovation,
            ahead.rate + of_rate * innovation,
            ahead.of_slip - gain * ahead.of_slip,
            ahead.shared - gain * ahead.shared,
            ahead.of_rate - of_rate * ahead.shared,
        )
        told = jnp.where(counts, -0.5 * (innovation**2 / width + jnp.log(width)), 0.0)
        return known, (ahead, known, told)

    one, none = jnp.ones_like(slip[0]), jnp.zeros_like(slip[0])
    # The first point is the start itself, about which nothing was known: it tells nothing.
    start = _State(slip[0], none, one, none, one)
    counts = (step > 0).at[0].set(True)
    _, (ahead, known, told) = jax.lax.scan(advanced, start, (step, slip, error, densities, counts))
    return _Course(ahead, known, step, told.at[0].set(0.0))
