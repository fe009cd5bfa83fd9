"""Filters on Kiencke's curve that forget at several rates, each weighed by its success."""

from dataclasses import replace
from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import Scalar
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.identifiers.innovations import FINEST, followed_scale, huber_weight
from adhesion_jax.identifiers.online import LARGEST, Found, Sample
from adhesion_jax.identifiers.pairs import (
    Element,
    Square,
    Symmetric,
    Vector,
    no_matrix,
    outer,
    square,
)
from adhesion_jax.identifiers.young import (
    LENGTH,
    Young,
    YoungKiencke,
    along,
    at_the_start,
    curve_at,
    inverse,
    refitted,
    voted,
)
from adhesion_jax.optim.arrays import Value
from adhesion_jax.records import Known

Of = Float[Array, " members"]

#: The correlation of the noise is that of the last so many samples.
_MEMORY = 500

#: Samples before the first one whose residual tells something of the noise.
_UNSURE = 10

#: Residuals beyond this many standard deviations count as such in the correlation.
_CLIPPED = 3.0

#: Largest squared innovation that speaks against a member: an outlier would decide alone.
_LOUDEST = 25.0

#: Largest change of mu_max, and of the logarithm of its slip, that is believed in a sample.
_FASTEST = 0.01

#: More correlation than this is not believed: the differences of samples would tell nothing.
_MOST_CORRELATED = 0.98


#: Least standard deviation of the noise: against less, what a trend may be at first is so large
#: that the difference of two covariances has no digit left.
_FINEST = 1e-6


class Members(NamedTuple):
    """What each member holds, covariances in units of the noise variance; elements [members]."""

    x: Vector  # p1 and p2
    slope: Vector  # change a sample of mu_max, and of the logarithm of p2's root
    of_x: Symmetric  # covariance of x
    across: Square  # covariance of x with the slope
    of_slope: Symmetric
    weight: Of


class BankRecursion(Young):
    """With x the mean of the mixture, and the scale of that part of the noise which is new."""

    members: Members
    squares: Value  # mean square of the residuals
    products: Value  # mean product of neighbours among them


class Bank(YoungKiencke):
    """Kalman filters on x = (p1, p2), with and without a trend, and the mixture of them.

    A member is an extended Kalman filter for z = mu(l; x) + e with S = 1 + h'P h, in units of the
    variance of the noise, P <- P/factor between two samples (West and Harrison 1997, Bayesian
    Forecasting and Dynamic Models, chapter 6). One with a trend carries the slopes of the height
    of the peak and of the logarithm of its slip along: what a rail does by itself is a change of
    the peak, and x = x(peak) would bend where the peak goes straight on. Each predicts the sample;
    weights are multiplied by the densities of what is then measured, and a share `change` of all
    weight is dealt out anew by `prior` at each sample (Herbster and Warmuth 1998, Machine Learning
    32:151-178). A member without a trend takes over what the mixture knows with the weight that it
    is dealt, so that one which forgets nothing is right again when a drift has ended.

    The noise may have a memory: e = r e' + w with the e' of the sample before, r estimated from
    the residuals and kept between 0 and 1, so that h is g - r g' and the innovation
    z - mu - r (z' - mu'). Young, and after a reset by votes, all members hold the fit to the
    latest samples (`young`).
    """

    KNOWS_MEMORY = True

    factor: Float[Array | np.ndarray, " members"]  # by which the past is discounted in a sample
    slope: Float[Array | np.ndarray, " members"]  # prior standard deviation, relative; 0: no trend
    prior: Float[Array | np.ndarray, " members"]  # weight of the member before any data
    change: Scalar
    huber: Scalar
    gain: Scalar  # least gain of the scale
    start: Scalar  # standard deviation of the start, as a share of the box

    def initial(self, known: Known, key: PRNGKeyArray) -> BankRecursion:
        young, zero = at_the_start(known), jnp.zeros(())
        members = self._alike(known, young.x, no_matrix(), young.scale, zero)
        return BankRecursion(**vars(young), members=members, squares=zero, products=zero)

    def found(self, known: Known, recursion: BankRecursion) -> Found:
        """The mean of the mixture, and its covariance within the members and between them."""
        _, covariance = mixture(recursion.members, recursion.scale)
        return Found(
            recursion.x.array(),
            recursion.scale**2 * covariance.array(),
            recursion.samples > 2,
            jnp.sum(recursion.members.weight * self.factor),
        )

    def after(self, known: Known, recursion: BankRecursion, sample: Sample) -> BankRecursion:
        _, size, adhesion, _ = sample
        scale, kept = recursion.scale, recursion.kept
        memory = correlation(recursion)
        members = self._moved(known, self._dealt(recursion.members, scale), scale)
        by_member = jax.vmap(predicted, (None, 0, None, None))
        now = by_member(known, members.x, size, adhesion)
        before = by_member(known, members.x, kept.size[0], kept.adhesion[0])
        residual = now.residual - memory * before.residual
        gradient = now.gradient - memory * before.gradient
        grown, spread = self._updated(known, members, residual, gradient, scale)

        # The innovation of the mixture, whose members do not agree.
        mean = jnp.sum(members.weight * residual)
        between = ((residual - mean) / scale) ** 2
        nu = mean / (scale * jnp.sqrt(jnp.sum(members.weight * (spread + between))))

        # Of a noise with the correlation r the share 1 - r^2 of the variance is new in a sample.
        whole = scale / jnp.sqrt(1 - memory**2)
        errors = (jnp.sum(members.weight * one.residual) for one in (now, before))
        pair = (jnp.clip(one, -_CLIPPED * whole, _CLIPPED * whole) for one in errors)
        recursion = _heard(recursion, *pair)
        memory = correlation(recursion)
        new = jnp.sqrt(1 - memory**2)
        recursion, reset = voted(recursion, sample, nu)
        scale = followed_scale(scale, nu, recursion.samples, self.gain)
        scale = jnp.maximum(scale, _FINEST)
        recursion = replace(recursion, x=mixture(grown, scale)[0], scale=scale / new)
        recursion = refitted(known, recursion, reset, self.huber, self.start)
        first = recursion.samples <= LENGTH
        scale = jnp.maximum(jnp.where(first, recursion.scale * new, scale), _FINEST)
        # The mean of such a noise has 1/(1 - r)^2 times the variance that its new share would have.
        young = self._alike(
            known,
            recursion.x,
            1 / (1 - memory) ** 2 * inverse(recursion.sums),
            scale,
            jnp.sum(recursion.kept.used, dtype=float),
        )
        is_young = recursion.age <= LENGTH
        members = jax.tree.map(lambda a, b: jnp.where(is_young, a, b), young, grown)
        return replace(recursion, x=mixture(members, scale)[0], members=members, scale=scale)

    def _alike(
        self, known: Known, x: Vector, covariance: Symmetric, scale: Value, count: Value
    ) -> Members:
        """All members at one fit to `count` samples, which is that of the middle of them."""
        one, none = jnp.ones_like(self.prior), jnp.zeros_like(self.prior)
        peak, root = peak_of(known, x)
        slope = (jnp.asarray(self.slope) / scale) ** 2
        of_slope = Symmetric(peak**2 * slope, none, slope)
        since = jnp.maximum(count - 1, 0.0) / 2
        bend = bend_of(known, peak, root)
        across = since * (bend @ of_slope.full())
        return Members(
            one * x,
            Vector(none, none),
            one * covariance + since * (across @ bend.transposed()).symmetric(),
            across,
            of_slope,
            one * self.prior,
        )

    def _dealt(self, members: Members, scale: Value) -> Members:
        """The members after the share `change` of the weight was dealt out anew."""
        mean, covariance = mixture(members, scale)
        weight = (1 - self.change) * members.weight + self.change * self.prior
        share = jnp.where(jnp.asarray(self.slope) == 0, self.change * self.prior / weight, 0.0)
        apart = mean - members.x
        of_x = members.of_x + share * (covariance - members.of_x)
        return members._replace(
            x=members.x + share * apart,
            of_x=of_x + share * (1 - share) / scale**2 * square(apart),
            weight=weight,
        )

    def _moved(self, known: Known, members: Members, scale: Value) -> Members:
        """The members one sample later: the peak has moved by its slope, the past counts less.

        x' = x(peak(x) + slope), F = dx'/dx, J = dx'/dslope. While the variance of x is that of the
        box, nothing is discounted: without excitation it would grow beyond all bounds.
        """
        x, slope, of_x, across, of_slope, _ = members
        peak, root = peak_of(known, x)
        after = jnp.maximum(peak + slope.a, peak / 2)
        factor = jnp.exp(slope.b)
        bend = bend_of(known, after, factor * root)
        higher, none = (peak / after) ** 2, jnp.zeros_like(peak)
        forward = Square(higher, (higher - factor) / root, none, factor**2)
        back, bent = forward @ across, bend @ of_slope.full()
        moved = forward @ of_x.full() @ forward.transposed()
        mixed = back @ bend.transposed()
        of_x = (moved + mixed + mixed.transposed() + bent @ bend.transposed()).symmetric()
        width = (known.upper - known.lower) / scale
        wide = (of_x.a > width[0] ** 2) | (of_x.c > width[1] ** 2)
        more = jnp.where(wide, 1.0, 1 / jnp.asarray(self.factor))
        return members._replace(
            x=x_of(known, after, factor * root),
            of_x=more * of_x,
            across=more * (back + bent),
            of_slope=more * of_slope,
        )

    def _updated(
        self, known: Known, members: Members, residual: Of, gradient: Vector, scale: Value
    ) -> tuple[Members, Of]:
        """The members after a sample, and S of each."""
        x, slope, of_x, across, of_slope, weight = members
        of_gradient = of_x.times(gradient), across.transposed().times(gradient)
        leverage = jnp.maximum(gradient.dot(of_gradient[0]), 0.0)
        spread = 1 + leverage
        nu = residual / (scale * jnp.sqrt(spread))
        share = 1 / (1 / huber_weight(nu, self.huber) + leverage)
        x = x + share * residual * of_gradient[0]
        slope = slope + share * residual * of_gradient[1]
        surprise = jnp.log(spread) + jnp.minimum(nu**2, _LOUDEST)
        weight = weight * jnp.exp(-0.5 * (surprise - jnp.min(surprise)))
        return Members(
            Vector(*map(jnp.clip, (x.a, x.b), known.lower, known.upper)),
            Vector(*(jnp.clip(one, -_FASTEST, _FASTEST) for one in (slope.a, slope.b))),
            of_x - share * square(of_gradient[0]),
            across - share * outer(*of_gradient),
            of_slope - share * square(of_gradient[1]),
            weight / jnp.sum(weight),
        ), spread


class Prediction(NamedTuple):
    """What is measured less what is predicted, and d mu/d x."""

    residual: Element
    gradient: Vector


def predicted(known: Known, x: Vector, size: Value, adhesion: Value) -> Prediction:
    d, model = curve_at(known, x, size)
    return Prediction(adhesion - model, -model * size / d * along(size))


def mixture(members: Members, scale: Value) -> tuple[Vector, Symmetric]:
    """Mean and covariance of x, the latter in units of the noise variance."""
    weight, x = members.weight, members.x
    mean = (weight * x).sum()
    apart = x - mean
    return mean, (weight * (members.of_x + 1 / scale**2 * square(apart))).sum()


def correlation(recursion: BankRecursion) -> Value:
    """Of neighbours in the noise, 0 where they differ more than independent ones would."""
    ratio = recursion.products / jnp.maximum(recursion.squares, FINEST**2)
    return jnp.clip(ratio, 0.0, _MOST_CORRELATED)


def _heard(recursion: BankRecursion, now: Value, before: Value) -> BankRecursion:
    """The mean products of residuals with those of one more sample and the sample before it."""
    gain = jnp.where(
        recursion.samples < _UNSURE, 0.0, 1 / jnp.minimum(recursion.samples + 1.0, _MEMORY)
    )
    squares, products = recursion.squares, recursion.products
    return replace(
        recursion,
        squares=squares + gain * ((now**2 + before**2) / 2 - squares),
        products=products + gain * (now * before - products),
    )


def peak_of(known: Known, x: Vector) -> tuple[Element, Element]:
    """mu_max = a0/(p1 + 2 root) and the root of p2, one over the slip of the peak."""
    a0, root = cast(Kiencke, known.curve).a0, jnp.sqrt(x.b)
    return a0 / jnp.maximum(x.a + 2 * root, a0 / LARGEST), root


def x_of(known: Known, peak: Element, root: Element) -> Vector:
    """p1 and p2 of the curve with this peak."""
    return Vector(cast(Kiencke, known.curve).a0 / peak - 2 * root, root**2)


def bend_of(known: Known, peak: Element, root: Element) -> Square:
    """The derivatives of p1 and p2 by mu_max and by log root."""
    a0 = cast(Kiencke, known.curve).a0
    return Square(-a0 / peak**2, -2 * root, jnp.zeros_like(root), 2 * root**2)


def bank(without: dict[float, float], *trends: tuple[float, dict[float, float]]) -> Bank:
    """From weight by factor, of members without and with a trend of some standard deviation."""
    rows = [
        (factor, slope, weight)
        for slope, weights in ((0.0, without), *trends)
        for factor, weight in weights.items()
    ]
    factor, slope, prior = np.array(rows).T
    return Bank(factor, slope, prior, 1e-4, 2.0, 0.02, 0.1)


#: Nine tenths of the weight before any data are on rails that stay or go evenly, slowly or not; the
#: rest is for what neither holds for.
bank_kiencke = bank(
    {0.9: 0.005, 0.95: 0.005, 0.98: 0.005, 0.995: 0.005, 1.0: 0.8},
    (
        2e-3,
        {0.9: 0.005, 0.95: 0.005, 0.97: 0.005, 0.98: 0.005, 0.99: 0.005, 0.995: 0.005, 1.0: 0.05},
    ),
    (5e-5, {1.0: 0.1}),
)
