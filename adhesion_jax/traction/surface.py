"""The surface of a rail: a law of adhesion in slip velocity or in slip ratio."""

import math
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import SLIP_LIMIT, Conditions, Exponential, Law, Peak, Scalar, Signal
from adhesion_jax.curves.base import SLIP_VELOCITY_LIMIT

#: Smallest speed in m/s by which a slip velocity is divided: slip ratios diverge at rest.
_SLOWEST = 0.5

#: Number of slips among which the best one is looked for, and what share of the largest the
#: smallest is.
_SLIPS, _SHARE = 64, 5e-3


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

    def of_sides(
        self,
        right: Float[Array, " axles"],
        left: Float[Array, " axles"],
        train_speed: Float[Array, ""],
    ) -> tuple[Float[Array, " axles"], Float[Array, " axles"]]:
        """Adhesion of the right and of the left wheel of each axle, each at a slip of its own."""
        if not isinstance(self.law, BothSides):
            return self(right, train_speed), self(left, train_speed)
        on_right, on_left = (
            RailSurface(law, self.in_ratio) for law in (self.law.right, self.law.left)
        )
        return on_right(right, train_speed), on_left(left, train_speed)

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
        peak = self.peak(train_speed)
        if price == 0:
            return peak

        def gain(slip: Float[Array, " axles"]) -> Float[Array, " axles"]:
            return self(slip, train_speed) * (train_speed - price * slip)

        # Beyond the peak there is less adhesion for more slip.
        end = jnp.where(peak.found, 1.2 * peak.slip, SLIP_VELOCITY_LIMIT)
        slip = highest(gain, jnp.broadcast_to(end, axles))
        return Peak(slip, self(slip, train_speed), jnp.ones(axles, dtype=bool))


def highest(
    gain: Callable[[Float[Array, " axles"]], Float[Array, " axles"]], end: Float[Array, " axles"]
) -> Float[Array, " axles"]:
    """The slip of the largest gain of each axle, up to an end.

    Of the parabolas through three neighbours on a logarithmic grid the highest is taken, and then
    one through closer points around its vertex.
    """
    each = jax.vmap(gain)
    ratio = _SHARE ** (-1 / (_SLIPS - 1))
    slips = end * ratio ** jnp.arange(1.0 - _SLIPS, 1.0)[:, None]
    rows = each(slips)
    shift, height = _vertex(rows[:-2], rows[1:-1], rows[2:])
    number = jnp.argmax(height, axis=0)
    chosen = number, jnp.arange(end.size)
    slip = slips[1:-1][chosen] * ratio ** shift[chosen]
    near = slip * ratio ** jnp.array([[-0.125], [0.0], [0.125]])
    slip = slip * ratio ** (0.125 * _vertex(*each(near))[0])
    return jnp.where(rows[-1] > height[chosen], end, slip)


def _vertex(
    before: Float[Array, "*at axles"],
    here: Float[Array, "*at axles"],
    after: Float[Array, "*at axles"],
) -> tuple[Float[Array, "*at axles"], Float[Array, "*at axles"]]:
    """Place of the vertex, in steps from the middle of three points, and its height there.

    Where the middle is not the highest of the three it is taken itself, as lower than all.
    """
    bend = before + after - 2 * here
    top = (here >= before) & (here >= after) & (bend < 0)
    bend = jnp.where(top, bend, 1.0)
    shift = jnp.where(top, (before - after) / (2 * bend), 0.0)
    return shift, jnp.where(top, here - (after - before) ** 2 / (8 * bend), -jnp.inf)


class KnownPeak(Law):
    """A law whose peak is given, so that it is sought once a rail."""

    largest: Peak

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        return self.largest


class BothSides(KnownPeak):
    """The mean of the laws of both rails at one slip: that of an axle whose wheels turn alike."""

    right: Law
    left: Law

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        return (self.right(slip, conditions) + self.left(slip, conditions)) / 2


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
