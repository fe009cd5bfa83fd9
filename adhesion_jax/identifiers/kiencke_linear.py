"""Kiencke's curve as a linear regression: Z = p1 U1 + p2 U2.

U1 = l mu, U2 = l^2 mu, Z = a0 l - mu, with slip and adhesion made positive together. The
measured adhesion stands in the regressors too, so its noise biases every least squares solution:
mu_max comes out too high by about (sigma/mu_max)^2 of itself.
Source: Qian et al. 2024, Eq. 3 to 6.
"""

import dataclasses
from typing import NamedTuple, cast

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Scalar, free_values
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.identifiers.online import OnlineMethod, Sample
from adhesion_jax.identifiers.pairs import Symmetric, Vector, no_matrix, no_vector, square
from adhesion_jax.optim.arrays import Value
from adhesion_jax.optim.quadratic_program import Products, bounded_pair_seldom_on_edge
from adhesion_jax.records import Known

#: The quadratic program in the box has a prior at the start of this share of the information:
#: enough to determine it from a single sample, too little to matter afterwards.
_RIDGE = 1e-10


class Regression(NamedTuple):
    """Regressors and target, of a record or of one sample."""

    u: Vector
    z: Float[Array, "*points"]


class Normal(NamedTuple):
    """Sums over samples, each with a weight w: sum w U U', sum w U Z and sum w^2 e^2 U U'.

    The last one, of the residuals e = Z - U x, makes the covariance of x true although the
    noise of Z depends on the slip (White 1980, Econometrica 48:817-838).
    """

    h: Symmetric
    f: Vector
    g: Symmetric


def no_samples() -> Normal:
    """The sums before any."""
    return Normal(no_matrix(), no_vector(), no_matrix())


def needs_kiencke(known: Known) -> str | None:
    """None, or the reason why what is known does not have this form."""
    curve = known.curve
    if type(curve) is Kiencke and curve.free == ("p1", "p2"):
        return None
    return "it is written for Kiencke's curve with a0 known, p1 and p2 unknown"


def regression(
    known: Known, slip: Float[Array, "*points"], adhesion: Float[Array, "*points"]
) -> Regression:
    a0 = cast(Kiencke, known.curve).a0
    size, adhesion = jnp.abs(slip), jnp.where(slip < 0, -adhesion, adhesion)
    return Regression(adhesion * powers(size), a0 * size - adhesion)


def powers(size: Float[Array, "*points"]) -> Vector:
    """|l| and l^2."""
    return Vector(size, size**2)


def start_of(known: Known) -> Vector:
    """The p1 and p2 that a method begins at."""
    return Vector(*free_values(known.curve))


def solve_in_box(known: Known, normal: Normal) -> Vector:
    """The best x in the box, with a weak prior at the start of the scenario."""
    h, pull = normal.h, _RIDGE * (normal.h.a + normal.h.c)
    f = normal.f + pull * start_of(known)
    products = Products(f.a, f.b, h.a + pull, h.c + pull, h.b)
    ranges = ((known.lower[i], known.upper[i]) for i in (0, 1))
    return Vector(*bounded_pair_seldom_on_edge(products, *ranges))


def covariance(normal: Normal) -> Float[Array, "2 2"]:
    """H^-1 G H^-1 of the x without bounds."""
    bread = normal.h.inverse().array()
    return bread @ normal.g.array() @ bread


def forgetting(
    known: Known, sample: Sample, x: Vector, least: Scalar, most: Scalar, gain: Scalar
) -> Value:
    """Eta = max(least, most - gain |mu - mu_hat(l; p(k-1))|) (Qian et al. 2024, Eq. 9).

    The equation prints the error of the estimate that eta is needed for; it is read as that of
    the estimate before.
    """
    predicted = dataclasses.replace(cast(Kiencke, known.curve), p1=x.a, p2=x.b)(sample.slip, {})
    return jnp.maximum(least, most - gain * jnp.abs(sample.adhesion - predicted))


def discounted(normal: Normal, sample: Regression, eta: Value, weight: Value) -> Normal:
    """The sums after one more sample: the old sums times eta, plus the sample times its weight.

    The sums of residuals are only discounted: the residual is known once x is.
    """
    u, z = sample
    h, f = eta * normal.h + weight * square(u), eta * normal.f + weight * z * u
    return Normal(h, f, eta**2 * normal.g)


def with_residual(normal: Normal, sample: Regression, weight: Value, x: Vector) -> Normal:
    """The sums with the residual of the last sample, at the x that was found with it."""
    residual = weight * (sample.z - sample.u.dot(x))
    return normal._replace(g=normal.g + residual**2 * square(sample.u))


class OnlineKiencke(OnlineMethod):
    """An online method of p1 and p2."""

    def accepts(self, known: Known) -> str | None:
        return needs_kiencke(known)
