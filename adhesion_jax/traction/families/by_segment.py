"""Families whose segments have a law each, the same as long as a segment lasts."""

from dataclasses import replace

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from adhesion_jax.curves import Conditions, Law, Peak, PolachFalling, Scalar, Signal
from adhesion_jax.curves.peak import find_peak
from adhesion_jax.errors import InputError
from adhesion_jax.traction.families.base import (
    SEGMENTS,
    SLIPS,
    Family,
    between,
    exponential,
    exponentials,
    log_between,
    peaks,
    starts,
)
from adhesion_jax.traction.loop import Loop
from adhesion_jax.traction.plants.rigid_axles import RigidAxles
from adhesion_jax.traction.rails import ByTime
from adhesion_jax.traction.signals import Number
from adhesion_jax.traction.surface import BothSides, KnownPeak, RailSurface


class ExponentialRails(Family):
    """mu(v) = c (exp(-a v) - exp(-b v)), b/a = 2.2222; the peak is drawn for each segment."""

    TITLE = "exponential curves, one for each segment"

    def draw(self, key: PRNGKeyArray, step: float) -> ByTime:
        of_surfaces, of_starts = jax.random.split(key)
        return ByTime(exponentials(of_surfaces), starts(of_starts, step))


#: By how much the radius of the wheels of each axle differs from the one that is known, m; assumed.
WEAR = (0.004, -0.004, 0.002, -0.002, 0.003, -0.003, 0.001, -0.001)


class AxleRails(Family):
    """Each of eight axles has peaks of its own, which change at one time for all."""

    TITLE = "exponential curves of each axle's own under wheels that are worn by up to 4 mm"

    def draw(self, key: PRNGKeyArray, step: float) -> ByTime:
        of_surfaces, of_starts = jax.random.split(key)
        each = (x.reshape(SEGMENTS, -1) for x in peaks(of_surfaces, SEGMENTS * len(WEAR)))
        return ByTime(jax.vmap(jax.vmap(exponential))(*each), starts(of_starts, step))

    def met(self, loop: Loop) -> Loop:
        axles = loop.slip.size
        if not isinstance(loop.plant, RigidAxles) or axles != len(WEAR):
            raise InputError(
                f"these rails are those of {len(WEAR)} axles of a locomotive, and the plant has "
                f"{axles}; give --plant hxd1f_axles."
            )
        worn = loop.plant.wheel_radius + jnp.asarray(WEAR)
        return replace(loop, plant=replace(loop.plant, wheel_radius=worn))


class SplitRails(Family):
    """Each rail has a peak of its own in each segment; the best slip is that of their mean."""

    TITLE = "exponential curves, others on the left rail than on the right"

    def draw(self, key: PRNGKeyArray, step: float) -> ByTime:
        of_right, of_left, of_starts = jax.random.split(key, 3)
        surfaces = RailSurface(jax.vmap(_both_sides)(*peaks(of_right), *peaks(of_left)))
        return ByTime(surfaces, starts(of_starts, step))


def _both_sides(*of_sides: Scalar) -> BothSides:
    right, left = exponential(*of_sides[:2]).law, exponential(*of_sides[2:]).law
    # Between the best slips of both.
    largest = find_peak(lambda slip: (right(slip, {}) + left(slip, {})) / 2, jnp.asarray(SLIPS[1]))
    return BothSides(largest, right, left)


class Saturating(KnownPeak):
    """mu(v) = mu_inf (1 - exp(-3 v/v95)), odd in v; mu(v95) = .95 mu_inf.

    It has no peak: what stands for it is mu_inf, with the slip v95 in m/s.
    """

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        end, level, _ = self.largest
        return -level * jnp.sign(slip) * jnp.expm1(-3 * jnp.abs(slip) / end)


class NoMaximumRails(Family):
    """Level and v95 are drawn as the peaks of other rails are."""

    TITLE = "curves that rise without end to a level"

    def draw(self, key: PRNGKeyArray, step: float) -> ByTime:
        of_surfaces, of_starts = jax.random.split(key)
        slip, level = peaks(of_surfaces)
        surfaces = RailSurface(Saturating(Peak(slip, level, jnp.zeros(SEGMENTS, dtype=bool))))
        return ByTime(surfaces, starts(of_starts, step))


#: Bounds of the shape at mu0 = 1, slip in units of 1/b: A and kS, and C, which is log-uniform.
LEFT, REDUCTIONS, STIFFNESSES = (0.2, 0.6), (0.2, 1.0), (30.0, 120.0)


#: The shape is one of slip velocity alone, whatever the speed of the train.
_ANY_SPEED = {"vehicle_speed_mps": 1.0}


class Stretched(KnownPeak):
    """mu(v) = mu_max g(x v/v*)/g(x): a shape g of slip with its peak at x, put to (v*, mu_max)."""

    shape: Law
    top: Peak  # of the shape

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        found = self.shape(self.top.slip / self.largest.slip * slip, _ANY_SPEED)
        return self.largest.adhesion / self.top.adhesion * found


class PolachRails(Family):
    """Peaks are those of the nominal rails; how steep and how flat the curve is beside them varies.

    The law is PolachFalling in slip velocity.
    """

    TITLE = "curves of Polach's shape, one for each segment"

    def draw(self, key: PRNGKeyArray, step: float) -> ByTime:
        keys = jax.random.split(key, 5)
        left, k_s = between(keys[0], LEFT), between(keys[1], REDUCTIONS)
        shapes = left, k_s, log_between(keys[2], STIFFNESSES)
        surfaces = RailSurface(jax.vmap(_polach)(*peaks(keys[3]), *shapes))
        return ByTime(surfaces, starts(keys[4], step))


def _polach(slip: Number, adhesion: Number, left: Scalar, k_s: Scalar, c: Scalar) -> Stretched:
    shape = PolachFalling(mu0=1.0, a=left, b=1.0, stiffness=c, k_s=k_s)
    top = shape.peak(_ANY_SPEED)
    return Stretched(Peak(slip, adhesion, top.found), shape, top)


#: Bounds of the slip of the second maximum in m/s, and of its adhesion over that of the first.
SECOND, SHARES = (0.6, 1.2), (0.9, 1.3)

#: The power of the second hump: it is narrow enough to leave the first maximum where it is.
_POWER = 20.0


class TwoMaxima(KnownPeak):
    """mu(v) = mu_1(v) + A (x exp(1 - x))^20, x = v/v_2, mu_1 exponential, odd in v."""

    first: Law
    height: Scalar
    slip: Scalar

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        size = jnp.abs(slip) / self.slip
        hump = jnp.exp(_POWER * (jnp.log(jnp.maximum(size, 1e-9)) + 1 - size))
        return self.first(slip, conditions) + self.height * jnp.sign(slip) * hump


class TwoMaximaRails(Family):
    """The higher maximum is as high as that of nominal rails, the second at .6 to 1.2 m/s."""

    TITLE = "curves with a second maximum at .6 to 1.2 m/s"

    def draw(self, key: PRNGKeyArray, step: float) -> ByTime:
        of_peaks, of_slips, of_shares, of_starts = jax.random.split(key, 4)
        second, share = log_between(of_slips, SECOND), between(of_shares, SHARES)
        surfaces = RailSurface(jax.vmap(_two_maxima)(*peaks(of_peaks), second, share))
        return ByTime(surfaces, starts(of_starts, step))


def _two_maxima(slip: Scalar, adhesion: Scalar, second: Scalar, share: Scalar) -> TwoMaxima:
    lower = adhesion / jnp.maximum(share, 1.0)
    first, low = exponential(slip, lower).law, 0.7 * second
    nowhere = Peak(jnp.zeros(()), jnp.zeros(()), jnp.zeros((), dtype=bool))
    law = TwoMaxima(nowhere, first, share * lower - first(jnp.asarray(second), {}), second)
    # Each maximum is searched by itself, since they may be as good as equal.
    of_second = find_peak(lambda beyond: law(low + beyond, {}), low)
    of_second = of_second._replace(slip=low + of_second.slip)
    of_first = find_peak(lambda slip: law(slip, {}), 0.7 * SECOND[0])
    higher = of_first.adhesion > of_second.adhesion
    largest = jax.tree.map(lambda *each: jnp.where(higher, *each), of_first, of_second)
    return replace(law, largest=largest)
