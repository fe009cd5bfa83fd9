"""The slip signal is noisy: its neighbours in time know the slip better than it does itself."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.discovery.effects.base import Columns, Effect
from adhesion_jax.discovery.effects.history import has_history

_SOURCE = "Carroll et al. 2006, Measurement Error in Nonlinear Models, chapter 4"


class SlipNoise(Effect):
    """mu(E[l]), E[l] the slip to be expected where white noise is on the signal of the wheel speed.

    The true slip is a random walk whose rate is a random walk of intensity `roughness`, the noise
    of the measured one has the standard deviation sigma, or sigma/V where it `falls_with` the
    vehicle speed V: E[l] is then the smoother of Rauch, Tung and Striebel. Source: regression
    calibration, Carroll et al. 2006, chapter 4; Rauch, Tung and Striebel 1965, AIAA J. 3:1445.
    """

    sigma: Scalar
    roughness: Scalar
    falls_with: str = eqx.field(static=True, default="")

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "sigma": Parameter("1 or m/s", 0.0, 10.0, "noise of the slip, or of a speed", _SOURCE),
        "roughness": Parameter("1/s^1.5", 1e-9, 1e6, "change of the rate of slip", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("sigma",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("time_s",)
    ORDER: ClassVar[int] = 0

    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        if not has_history(conditions):
            return slip
        return expected_slip(self, jnp.asarray(slip), conditions).slip

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        return adhesion

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(sigma=1e-3, roughness=0.05)]


class ExpectedSlip(NamedTuple):
    """The slip of one run given all of its measured slips."""

    slip: Float[Array, " points"]
    variance: Float[Array, " points"]  # of the true slip about it
    covariance: Float[Array, " points"]  # with the error of the point before; 0 at the first
    log_density: Float[Array, ""]  # of the measured slips


def expected_slip(
    noise: SlipNoise, slip: Float[Array, " points"], conditions: Conditions
) -> ExpectedSlip:
    """The smoothed slip of one run in the order of time.

    Where no time passes from one point to the next the second is taken as a repetition, which
    tells nothing new.
    """
    time = jnp.asarray(conditions["time_s"])
    step = jnp.diff(time, prepend=time[:1])
    spread = noise.sigma / conditions[noise.falls_with] if noise.falls_with else noise.sigma
    error = jnp.broadcast_to(spread, slip.shape) ** 2 + 1e-16
    density = jnp.asarray(noise.roughness) ** 2
    new = (step > 0).at[0].set(True)

    def filtered(state: tuple[Array, Array], now: tuple) -> tuple[tuple[Array, Array], tuple]:
        mean, spread = state
        dt, measured, variance, counts = now
        move = jnp.array([[1.0, dt], [0.0, 1.0]])
        pushed = density * jnp.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        ahead, wide = move @ mean, move @ spread @ move.T + pushed + 1e-18 * jnp.eye(2)
        innovation, width = measured - ahead[0], wide[0, 0] + variance
        gain = jnp.where(counts, wide[:, 0] / width, 0.0)
        kept = wide - jnp.outer(gain, wide[0])
        told = jnp.where(counts, -0.5 * (innovation**2 / width + jnp.log(width)), 0.0)
        after = ahead + gain * innovation
        return (after, kept), (after, kept, ahead, wide, move, told)

    start = jnp.array([slip[0], 0.0]), jnp.diag(jnp.array([1.0, 1.0]))
    inputs = (step, slip, error, new)
    _, (means, spreads, ahead, wide, moves, told) = jax.lax.scan(filtered, start, inputs)

    def smoothed(state: tuple[Array, Array], at: tuple) -> tuple[tuple[Array, Array], tuple]:
        later, broad = state
        mean, spread, next_mean, next_wide, move = at
        gain = jnp.linalg.solve(next_wide, move @ spread).T
        better = mean + gain @ (later - next_mean)
        narrow = spread + gain @ (broad - next_wide) @ gain.T
        return (better, narrow), (better[0], narrow[0, 0], (broad @ gain.T)[0, 0])

    last = means[-1], spreads[-1]
    known = (means[:-1], spreads[:-1], ahead[1:], wide[1:], moves[1:])
    _, (values, variances, shared) = jax.lax.scan(smoothed, last, known, reverse=True)
    return ExpectedSlip(
        jnp.concatenate([values, means[-1:, 0]]),
        jnp.maximum(jnp.concatenate([variances, spreads[-1:, 0, 0]]), 0.0),
        jnp.concatenate([jnp.zeros(1), shared]),
        # The first point is what the diffuse start is conditioned on.
        told[1:].sum(),
    )
