"""Kiencke's curve as a linear regression: Z = p1 U1 + p2 U2.

U1 = l mu, U2 = l^2 mu, Z = a0 l - mu, with slip and adhesion made positive together. The
measured adhesion stands in the regressors too, so its noise biases every least squares solution:
mu_max comes out too high by about (sigma/mu_max)^2 of itself.
Source: Qian et al. 2024, Eq. 3 to 6.
"""

import dataclasses
from functools import partial
from typing import NamedTuple, cast

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from adhesion_jax.curves import Scalar, free_values
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.identifiers.base import Estimate
from adhesion_jax.identifiers.curve_fit import Fit, to_estimate
from adhesion_jax.identifiers.online import OnlineState, R, Step, over_fresh_samples
from adhesion_jax.optim.quadratic_program import Products, bounded_pair_seldom_on_edge
from adhesion_jax.records import Known, Record

#: The quadratic program in the box has a prior at the start of this share of the information:
#: enough to determine it from a single sample, too little to matter afterwards.
_RIDGE = 1e-10

#: p1 and p2 of one estimate; not one array, for over a batch of runs each of them is one.
Pair = tuple[Float[Array, ""], Float[Array, ""]]


class Regression(NamedTuple):
    """Regressors and target, of a record or of one sample."""

    u1: Float[Array, "*points"]
    u2: Float[Array, "*points"]
    z: Float[Array, "*points"]


class Normal(NamedTuple):
    """Sums over samples, each with a weight w: sum w U U', sum w U Z and sum w^2 e^2 U U'.

    The last one, of the residuals e = Z - U x, makes the covariance of x true although the
    noise of Z depends on the slip (White 1980, Econometrica 48:817-838). Scalars, not matrices:
    over a batch of runs each is then one array.
    """

    h11: Float[Array, ""]
    h12: Float[Array, ""]
    h22: Float[Array, ""]
    f1: Float[Array, ""]
    f2: Float[Array, ""]
    g11: Float[Array, ""]
    g12: Float[Array, ""]
    g22: Float[Array, ""]


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
    return Regression(size * adhesion, size**2 * adhesion, a0 * size - adhesion)


def solve(normal: Normal) -> Float[Array, "2"]:
    """The x without bounds, NaN where the samples do not determine it."""
    determinant = normal.h11 * normal.h22 - normal.h12**2
    x1 = normal.h22 * normal.f1 - normal.h12 * normal.f2
    x2 = normal.h11 * normal.f2 - normal.h12 * normal.f1
    return jnp.stack([x1, x2]) / jnp.where(determinant > 0, determinant, jnp.nan)


def solve_in_box(known: Known, normal: Normal) -> Pair:
    """The best x in the box, with a weak prior at the start of the scenario."""
    pull = _RIDGE * (normal.h11 + normal.h22)
    x1, x2 = free_values(known.curve)
    products = Products(
        normal.f1 + pull * x1,
        normal.f2 + pull * x2,
        normal.h11 + pull,
        normal.h22 + pull,
        normal.h12,
    )
    return bounded_pair_seldom_on_edge(
        products, (known.lower[0], known.upper[0]), (known.lower[1], known.upper[1])
    )


def covariance(normal: Normal) -> Float[Array, "2 2"]:
    """H^-1 G H^-1 of the x without bounds."""
    determinant = normal.h11 * normal.h22 - normal.h12**2
    adjugate = jnp.array([[normal.h22, -normal.h12], [-normal.h12, normal.h11]])
    inverse = adjugate / jnp.where(determinant > 0, determinant, jnp.nan)
    g = jnp.array([[normal.g11, normal.g12], [normal.g12, normal.g22]])
    return inverse @ g @ inverse


def forgetting(
    known: Known,
    slip: Float[Array, ""],
    adhesion: Float[Array, ""],
    x: Pair,
    least: Scalar,
    most: Scalar,
    gain: Scalar,
) -> Float[Array, ""]:
    """Eta = max(least, most - gain |mu - mu_hat(l; p(k-1))|) (Qian et al. 2024, Eq. 9).

    The equation prints the error of the estimate that eta is needed for; it is read as that of
    the estimate before.
    """
    predicted = _curve_of(known, x)(slip, {})
    return jnp.maximum(least, most - gain * jnp.abs(adhesion - predicted))


def _curve_of(known: Known, x: Pair) -> Kiencke:
    return dataclasses.replace(cast(Kiencke, known.curve), p1=x[0], p2=x[1])


def discounted(
    normal: Normal,
    sample: Regression,
    eta: Float[Array, ""],
    weight: Float[Array, ""],
) -> Normal:
    """The sums after one more sample: the old sums times eta, plus the sample times its weight.

    The sums of residuals are only discounted: the residual is known once x is.
    """
    u1, u2, z = sample
    return Normal(
        eta * normal.h11 + weight * u1 * u1,
        eta * normal.h12 + weight * u1 * u2,
        eta * normal.h22 + weight * u2 * u2,
        eta * normal.f1 + weight * u1 * z,
        eta * normal.f2 + weight * u2 * z,
        *(eta**2 * g for g in (normal.g11, normal.g12, normal.g22)),
    )


def with_residual(normal: Normal, sample: Regression, weight: Float[Array, ""], x: Pair) -> Normal:
    """The sums with the residual of the last sample, at the x that was found with it."""
    u1, u2, z = sample
    squared = (weight * (z - x[0] * u1 - x[1] * u2)) ** 2
    return normal._replace(
        g11=normal.g11 + squared * u1 * u1,
        g12=normal.g12 + squared * u1 * u2,
        g22=normal.g22 + squared * u2 * u2,
    )


def after_record(step: Step[R], state: OnlineState, record: Record) -> OnlineState:
    """The state of an online method, whose recursion holds the estimate `x`, one record on."""
    state = over_fresh_samples(partial(step, state.known), state, record)
    return state._replace(objective=_objective(state.known, record, tuple(state.recursion.x)))


def _objective(known: Known, record: Record, x: Pair) -> Float[Array, ""]:
    """The sum of squared residuals, of the points that are finite."""
    curve = _curve_of(known, x)

    def add(total: Float[Array, ""], point: tuple[Array, ...]) -> tuple[Float[Array, ""], None]:
        mask, slip, adhesion = point
        misfit = curve(slip, {}) - adhesion
        return total + jnp.where(mask & jnp.isfinite(misfit), misfit, 0.0) ** 2, None

    points = (record.mask, record.slip, record.adhesion)
    return jax.lax.scan(add, jnp.zeros(()), points)[0]


def online_estimate(
    state: OnlineState,
    covariance: Float[Array, "2 2"],
    converged: Bool[Array, ""],
    forgetting: Float[Array, ""],
    reset: Bool[Array, ""] | None = None,
) -> Estimate:
    """The estimate of an online method; should its sums have overflowed, the start."""
    known, x = state.known, jnp.stack(state.recursion.x)
    finite = jnp.all(jnp.isfinite(x))
    x = jnp.where(finite, x, free_values(known.curve))
    fit = Fit(x, covariance, state.objective, state.samples, converged, finite, state.skipped)
    none = jnp.zeros((), dtype=bool)
    return to_estimate(known, fit, forgetting, none if reset is None else reset)
