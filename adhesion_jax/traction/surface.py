"""The surface of a rail: a law of adhesion in slip velocity or in slip ratio."""

import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from adhesion_jax.curves import SLIP_LIMIT, Conditions, Exponential, Law, Peak, Scalar, Signal
from adhesion_jax.curves.base import SLIP_VELOCITY_LIMIT

#: Smallest speed in m/s by which a slip velocity is divided: slip ratios diverge at rest.
_SLOWEST = 0.5

#: Smallest slip velocity in m/s, and number of those, among which the best at a price is bracketed.
_LEAST, _POINTS = 1e-3, 256

#: Share that a step of the golden section leaves of a bracket, and number of steps.
_GOLDEN, _STEPS = 0.5 * (math.sqrt(5.0) - 1), 24


class RailSurface(eqx.Module):
    """Adhesion at a slip velocity in m/s.

    The law is evaluated at the slip velocity itself, or at its ratio to the speed of the train. The
    parameters of the law are scalars, or one for each axle.
    """

    law: Law
    in_ratio: bool = eqx.field(default=False, static=True)

    def __call__(
        self, slip_velocity: Float[Array, "*contacts"], train_speed: Float[Array, ""]
    ) -> Float[Array, "*contacts"]:
        unit = per(train_speed) if self.in_ratio else 1.0
        return self.law(slip_velocity / unit, {"vehicle_speed_mps": train_speed})

    def peak(self, train_speed: Float[Array, ""]) -> Peak:
        """The largest adhesion in traction, and the slip velocity that it needs."""
        conditions = {"vehicle_speed_mps": train_speed}
        if not self.in_ratio:
            return self.law.peak(conditions, SLIP_VELOCITY_LIMIT)
        found = self.law.peak(conditions, SLIP_LIMIT)
        return found._replace(slip=found.slip * per(train_speed))

    def best(self, train_speed: Float[Array, ""], price: float, axles: int) -> Peak:
        """The slip of the largest mu(v) (V - price v) and its adhesion, for each of some axles.

        At price 0 that is the peak.
        """
        if price == 0:
            return self.peak(train_speed)

        def gain(slip: Float[Array, " axles"]) -> Float[Array, " axles"]:
            return self(slip, train_speed) * (train_speed - price * slip)

        slip = highest(gain, (_LEAST, SLIP_VELOCITY_LIMIT), _POINTS, axles)
        return Peak(slip, self(slip, train_speed), jnp.ones(axles, dtype=bool))


def highest(
    gain: Callable[[Float[Array, " axles"]], Float[Array, " axles"]],
    ends: tuple[Scalar, Scalar],
    points: int,
    axles: int,
) -> Float[Array, " axles"]:
    """The slip of the largest gain of each axle between two ends.

    It is bracketed on a logarithmic grid, and the bracket narrowed by the golden section.
    """
    grid = jnp.geomspace(*ends, points)
    top = jnp.argmax(jax.vmap(lambda slip: gain(jnp.full(axles, slip)))(grid), axis=0)

    def narrowed(_: Int[Array, ""], bracket: tuple[Array, Array]) -> tuple[Array, Array]:
        low, high = bracket
        kept = _GOLDEN * (high - low)
        falls = gain(high - kept) > gain(low + kept)
        return jnp.where(falls, low, high - kept), jnp.where(falls, low + kept, high)

    bracket = grid[jnp.maximum(top - 1, 0)], grid[jnp.minimum(top + 1, points - 1)]
    low, high = jax.lax.fori_loop(0, _STEPS, narrowed, bracket)
    return 0.5 * (low + high)


class Scaled(Law):
    """A law times a factor, one number or one for each axle."""

    law: Law
    factor: Scalar | Float[Array, " axles"]

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        return self.factor * self.law(slip, conditions)

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        found = self.law.peak(conditions, slip_limit)
        return found._replace(adhesion=self.factor * found.adhesion)


def exponential(a: Scalar, b: Scalar, c: Scalar) -> RailSurface:
    """A surface mu = c (exp(-a v_s) - exp(-b v_s)), v_s in m/s."""
    return RailSurface(Exponential(a=a, b=b, c=c))


def with_peak(largest: Scalar, slip: Scalar, ratio: float) -> RailSurface:
    """The surface of that form whose largest adhesion lies at a slip in m/s; `ratio` is b/a."""
    a = math.log(ratio) / (ratio - 1) / slip
    share = ratio ** (-1 / (ratio - 1)) - ratio ** (-ratio / (ratio - 1))
    return exponential(a, ratio * a, largest / share)


def per(train_speed: Float[Array, ""]) -> Float[Array, ""]:
    """The speed by which a slip velocity is divided for its ratio, m/s."""
    return jnp.maximum(jnp.abs(train_speed), _SLOWEST)
