"""A curve with an offset, identified while the loop runs, and as much slip as it is worth."""

from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.filters import lagged
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Peak, Seeker
from adhesion_jax.traction.signals import Number, PerAxle, Reference, Setting, Signals

#: The steepnesses k that are weighed, s/m, and the slips among which the best is sought, m/s.
_STEEP = np.geomspace(2.0, 120.0, 48)
_SLIPS = np.geomspace(0.02, 0.6, 40)
_LEFT = np.exp(-np.outer(_STEEP, _SLIPS))

#: Time from one fit to the next, s.
_FIT = 0.01

#: Weight of the point mu(0) = 0 in samples, which leaves an offset of some hundredths free, and
#: what keeps a fit to a few samples determined.
_ORIGIN, _RIDGE = 0.01, 1e-7

#: Samples of the noise within a loop that are worth as much as one without memory, and the least
#: standard deviation of adhesion that is believed.
_ALIKE, _FINEST = 10.0, 3e-4

#: Standard errors of slip and adhesion of the peak that are due to the form, as shares of them:
#: chosen on 384 segments of nominal rails, after tuning, so that two errors hold 95 %.
_OF_FORM = (0.017, 4e-4)

#: Fewer samples than this tell no curve.
_FEWEST = 8.0

#: A sample whose slip changes at this rate counts half, m/s^2: the observer's lag takes it off the
#: curve.
_HURRY = 6.0

#: The time constant of the misfit; for how long nothing is learned after a change of the rail, as
#: the observer still mixes both rails; and how long no other change is seen, s.
_MISFIT, _BLANK, _LOCKED_OUT = 0.005, 0.01, 0.15

#: What is left of v* where the new rail has less adhesion, but not below half of the start.
_BACK = 0.6

#: No slip beyond this multiple of those seen on this rail is asked for.
_REACH = 2.0

#: A gain in worth of so many standard errors of it is believed by half.
_RISK = 0.5

#: Turns of the dither in a second, and its least amplitude in m/s, above the noise of slip.
_TURNS, _FLOOR = 2.0, 0.004


class Sums(NamedTuple):
    """Sums over samples that forget, those with exp(-k v) for each k."""

    left: Float[Array, "axles steep"]
    left_left: Float[Array, "axles steep"]
    left_slip: Float[Array, "axles steep"]
    left_adhesion: Float[Array, "axles steep"]
    weight: Float[Array, "axles 1"]
    slip: Float[Array, "axles 1"]
    slip_slip: Float[Array, "axles 1"]
    adhesion: Float[Array, "axles 1"]
    slip_adhesion: Float[Array, "axles 1"]
    adhesion_adhesion: Float[Array, "axles 1"]


class MeanCurve(NamedTuple):
    """mu(v) = A - sum over k of B_k exp(-k v) - C v: the curves of all k by their probabilities."""

    level: Float[Array, "axles 1"]
    rise: Float[Array, "axles steep"]
    fall: Float[Array, "axles 1"]

    def at(self, slip: PerAxle, left: Float[Array, "axles steep"]) -> PerAxle:
        """The adhesion at a slip whose exp(-k v) is known."""
        return self.level[:, 0] - jnp.sum(self.rise * left, axis=-1) - self.fall[:, 0] * slip

    def of(self, slip: PerAxle) -> PerAxle:
        """The adhesion at a slip."""
        return self.at(slip, jnp.exp(-_STEEP * slip[:, None]))


class OffsetCurveState(NamedTuple):
    sums: Sums
    curve: MeanCurve
    known: Bool[Array, " axles"]  # whether there is a curve
    misfit: PerAxle  # of the latest samples to it, with a lag
    seen: Float[Array, "2 axles"]  # the last slip and the largest on this rail, m/s
    since: PerAxle  # the rail changed, s
    asked: PerAxle  # v* without dither, m/s
    peak: Peak
    number: Int[Array, ""]  # of control samples so far


class OffsetCurve(Seeker):
    """mu = A - B exp(-k v) - C v by least squares that forget, for 48 k that are weighed by their
    probability, and v* the slip of the largest mu^(v) (V - price v).

    The offset A - B takes up what the radius of a wheel or a bias puts into slip and adhesion. The
    mean curve is the sum of the curves of all k, each times exp(-S/(2 s^2)), S its sum of squares.
    v* moves towards the best slip of the mean curve by the share g^2/(g^2 + e^2/4), g what that is
    worth more in adhesion and e the standard error of g: a direction that is sure is followed at
    once, and v* rests where nothing is to be gained. v* is dithered by v* + a sin(4 pi t), a the
    standard error of the slip of the peak within .004 m/s and `dither` v*. A misfit of the
    samples to the curve above `threshold` is a change of the rail, and all is learned anew. A rail
    without a maximum takes slip only as long as the rise is worth its price.
    Linear least squares for each value of a nonlinear number: Golub and Pereyra 1973, SIAM J.
    Numer. Anal. 10:413-432.
    """

    price: Setting = 1.0  # of a joule lost in the contact, in joules of useful work
    memory: Setting = 0.6  # s
    threshold: Setting = 0.007  # of adhesion
    dither: Setting = 0.06  # largest, as a share of v*
    start: Setting = 0.1  # m/s

    BOX: ClassVar = {
        "memory": Range(0.2, 1.0, log=True),
        "threshold": Range(0.005, 0.015, log=True),
        "dither": Range(0.03, 0.1, log=True),
    }

    def init(self, nominal: Plant, signals: Signals) -> OffsetCurveState:
        none = jnp.zeros_like(signals.slip)
        one, rows, unknown = none[:, None], jnp.zeros((none.size, _STEEP.size)), none + jnp.nan
        return OffsetCurveState(
            Sums(*4 * (rows,), *6 * (one,)),
            MeanCurve(one, rows, one),
            none > 0,
            none,
            jnp.stack([none, none]),
            none,
            none + self.start,
            Peak(unknown, unknown, unknown, unknown),
            jnp.zeros((), dtype=int),
        )

    def update(
        self, state: OffsetCurveState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[OffsetCurveState, Reference]:
        sign = signals.direction
        slip, adhesion = sign * signals.slip_beside, sign * signals.adhesion
        state = self._sampled(state._replace(number=state.number + 1), slip, adhesion, period)
        # Counted alike in all runs, so that a fit that is not due costs nothing in any of them.
        state = jax.lax.cond(
            state.number % max(round(_FIT / period), 1) == 0,
            lambda state: self._fitted(state, signals.train_speed),
            lambda state: state,
            state,
        )
        most = self.dither * state.asked
        size = jnp.where(state.known, jnp.minimum(state.peak.slip_error, most), most)
        size = jnp.maximum(size, _FLOOR)
        turn = 2 * jnp.pi * _TURNS
        angle = turn * period * state.number
        asked = state.asked + size * jnp.sin(angle)
        return state, Reference(sign * asked, sign * size * turn * jnp.cos(angle))

    def identified(self, state: OffsetCurveState) -> Peak:
        """The peak with the errors of noise without memory and those of the form.

        Those by which v* is moved allow for the noise of a moment, most of which the next moments
        take back: what is observed of the load is a derivative. The form is not that of the rail.
        """
        slip, adhesion, *errors = state.peak
        noise = [error / np.sqrt(_ALIKE) for error in errors]
        form = _OF_FORM[0] * slip, _OF_FORM[1] * adhesion
        return Peak(slip, adhesion, *map(jnp.hypot, noise, form))

    def _sampled(
        self, state: OffsetCurveState, slip: PerAxle, adhesion: PerAxle, period: float
    ) -> OffsetCurveState:
        """The state with one more sample, or without a past where it tells of another rail."""
        left = jnp.exp(-_STEEP * slip[:, None])
        error = jnp.where(state.known, adhesion - state.curve.at(slip, left), 0.0)
        misfit = jnp.where(state.known, lagged(state.misfit, error, _MISFIT, period), 0.0)
        since = state.since + period
        changed = (jnp.abs(misfit) > self.threshold) & (since > _LOCKED_OUT)
        since = jnp.where(changed, 0.0, since)
        back = jnp.maximum(_BACK * state.asked, jnp.minimum(state.asked, self.start / 2))
        blank = since < _BLANK
        kept = jnp.where(blank, 0.0, jnp.exp(-period / jnp.asarray(self.memory)))
        hurry = (slip - state.seen[0]) / (period * _HURRY)
        taken = jnp.where(blank, 0.0, 1 / (1 + hurry**2))
        v, mu = slip[:, None], adhesion[:, None]
        one = jnp.ones_like(v)
        new = Sums(left, left * left, left * v, left * mu, one, v, v * v, mu, v * mu, mu * mu)
        return state._replace(
            sums=jax.tree.map(lambda a, b: kept[:, None] * a + taken[:, None] * b, state.sums, new),
            known=state.known & ~blank,
            misfit=misfit,
            seen=jnp.stack([slip, jnp.where(blank, slip, jnp.maximum(state.seen[1], slip))]),
            since=since,
            asked=jnp.where(changed & (misfit < 0), back, state.asked),
        )

    def _fitted(self, state: OffsetCurveState, train_speed: Number) -> OffsetCurveState:
        """The state with the curve of the samples so far, and v* moved by it."""
        weight = state.sums.weight[:, 0]
        x, inverse, squares = fits(state.sums)
        least = jnp.min(squares, axis=-1)
        variance = _ALIKE * jnp.maximum(least / jnp.maximum(weight, 1.0), _FINEST**2)
        share = jax.nn.softmax((least[:, None] - squares) / (2 * variance[:, None]), axis=-1)
        mean = jnp.sum(share[..., None] * x, axis=1)
        curve = MeanCurve(mean[:, :1], share * x[..., 1], mean[:, 2:])
        # A sum and no product of matrices, whose bits would depend on the runs beside.
        rises = jnp.sum(curve.rise[..., None] * _LEFT, axis=1)
        adhesion = curve.level - rises - curve.fall * _SLIPS

        reach = _REACH * state.seen[1]
        price = self.price / jnp.maximum(jnp.abs(train_speed), 1.0)
        best = _best(adhesion * (1 - price * _SLIPS), reach)
        top = _best(adhesion, reach)

        first = jnp.argmax(share, axis=-1)
        steep = jnp.asarray(_STEEP)[first]
        _, rise, _ = _of(x, first).T
        errors = variance[:, None, None] * _of(inverse, first)
        worth = lambda slip: (1 - price * slip)[:, None] * _row(steep, slip)  # noqa: E731
        from_here = worth(best) - worth(state.asked)
        gain = jnp.maximum(jnp.sum(from_here * _of(x, first), axis=-1), 0.0) ** 2
        doubt = _RISK**2 * _form(errors, from_here)
        known = (weight > _FEWEST) & jnp.isfinite(best) & jnp.isfinite(doubt)
        moved = jnp.where(known, gain / jnp.maximum(gain + doubt, 1e-300), 0.0)

        # d mu/dv = B k exp(-k v) - C, of which the slip of the peak is the root.
        bent = steep * jnp.exp(-steep * top)
        slope = jnp.stack([jnp.zeros_like(bent), bent, -jnp.ones_like(bent)], axis=-1)
        curvature = jnp.maximum(rise * steep * bent, 1e-3)
        peak = Peak(
            top,
            curve.at(top, jnp.exp(-_STEEP * top[:, None])),
            jnp.sqrt(_form(errors, slope)) / curvature,
            jnp.sqrt(_form(errors, _row(steep, top))),
        )
        asked = state.asked * (jnp.where(known, best, state.asked) / state.asked) ** moved
        # The first samples of a rail that holds more are those of a slip that fell: v* that follows
        # them may stay for a second at a slip where nothing else is learned.
        young = state.since < _LOCKED_OUT
        least = jnp.where(young, jnp.minimum(state.asked, self.start / 2), _SLIPS[0])
        return state._replace(
            curve=curve,
            known=known,
            asked=jnp.maximum(asked, least),
            peak=jax.tree.map(lambda one: jnp.where(known, one, jnp.nan), peak),
        )


def fits(
    sums: Sums,
) -> tuple[
    Float[Array, "axles steep 3"], Float[Array, "axles steep 3 3"], Float[Array, "axles steep"]
]:
    """A, B and C for each k, the inverse of their information, and the sum of squares left."""
    a, b, c = sums.weight + _ORIGIN, -(sums.left + _ORIGIN), -sums.slip
    d, e, f = sums.left_left + _ORIGIN + _RIDGE, sums.left_slip, sums.slip_slip + _RIDGE
    minors = (
        *(d * f - e * e, c * e - b * f, b * e - c * d),
        *(a * f - c * c, b * c - a * e, a * d - b * b),
    )
    determinant = jnp.maximum(a * minors[0] + b * minors[1] + c * minors[2], 1e-300)
    p, q, r, s, t, u = (minor / determinant for minor in minors)
    inverse = jnp.stack([p, q, r, q, s, t, r, t, u], axis=-1).reshape(*p.shape, 3, 3)
    target = jnp.broadcast_arrays(sums.adhesion, -sums.left_adhesion, -sums.slip_adhesion)
    pull = jnp.stack(target, axis=-1)
    x = jnp.sum(inverse * pull[..., None, :], axis=-1)
    left_over = sums.adhesion_adhesion - jnp.sum(x * pull, axis=-1)
    return x, inverse, jnp.maximum(left_over, 0.0)


def _best(worth: Float[Array, "axles slips"], most: PerAxle) -> PerAxle:
    """The slip of the largest worth up to a slip, by the parabola through three of the grid."""
    most = jnp.clip(most, _SLIPS[0], _SLIPS[-1])
    place = jnp.argmax(jnp.where(most[:, None] >= _SLIPS, worth, -jnp.inf), axis=-1)
    place = jnp.clip(place, 1, _SLIPS.size - 2)
    before, here, after = (_of(worth, place + step) for step in (-1, 0, 1))
    bend = before - 2 * here + after
    beside = 0.5 * (before - after) / jnp.where(bend < 0, bend, -jnp.inf)
    slip = jnp.asarray(_SLIPS)[place] * (_SLIPS[1] / _SLIPS[0]) ** jnp.clip(beside, -0.5, 0.5)
    return jnp.minimum(slip, most)


def _of(numbers: Float[Array, "axles many *rest"], place: Int[Array, " axles"]) -> Array:
    """Those at a place of each axle."""
    return numbers[jnp.arange(place.size), place]


def _row(steep: PerAxle, slip: PerAxle) -> Float[Array, "axles 3"]:
    """The derivatives of mu by A, B and C at a slip."""
    return jnp.stack([jnp.ones_like(slip), -jnp.exp(-steep * slip), -slip], axis=-1)


def _form(matrix: Float[Array, "axles 3 3"], row: Float[Array, "axles 3"]) -> PerAxle:
    """The variance of a row times (A, B, C)."""
    return jnp.maximum(jnp.sum(row[:, :, None] * matrix * row[:, None, :], axis=(1, 2)), 0.0)
