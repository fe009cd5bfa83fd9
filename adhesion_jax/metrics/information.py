"""The information of data on a curve: sensitivities, covariance, Cramer-Rao bound."""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from adhesion_jax.curves import Conditions, Curve, Scalar, free_values, with_free_values
from adhesion_jax.optim.levenberg_marquardt import solved
from adhesion_jax.programs import kept
from adhesion_jax.records import Known


def quantity_names(curve: Curve) -> tuple[str, ...]:
    """The names of `quantities`: the free parameters, mu_max and slip_opt."""
    return (*curve.free, "mu_max", "slip_opt")


def quantities(curve: Curve, known: Known) -> Float[Array, " values"]:
    """The free parameters, the largest adhesion and its slip.

    Here and below `known` gives the conditions and the largest slip for the peak.
    """
    peak = curve.peak(known.conditions, known.slip_limit)
    return jnp.concatenate([free_values(curve), jnp.stack([peak.adhesion, peak.slip])])


@kept()
def _quantities_of_many(curves: Curve, known: Known) -> Float[Array, "curves values"]:
    return jax.vmap(quantities, in_axes=(0, None))(curves, known)


def true_quantities(curves: Curve, known: Known) -> Mapping[str, np.ndarray]:
    """`quantities` of stacked curves, by name."""
    values = np.asarray(_quantities_of_many(curves, known))
    return dict(zip(quantity_names(curves), values.T, strict=True))


def adhesion_and_information(
    curve: Curve,
    slip: Float[Array, " points"],
    mask: Bool[Array, " points"],
    conditions: Conditions,
) -> tuple[Float[Array, " points"], Float[Array, "free free"]]:
    """The model at every point, and J'J over the points of the mask, J = d mu/d parameters.

    For noise of variance s^2 the Fisher information is J'J/s^2.
    """
    adhesion, push = jax.linearize(
        lambda values: with_free_values(curve, values)(slip, conditions), free_values(curve)
    )
    sensitivity = jax.vmap(push)(jnp.eye(len(curve.free)))
    return adhesion, information_of(jnp.where(mask, sensitivity, 0.0))


def information_of(sensitivity: Float[Array, "free points"]) -> Float[Array, "free free"]:
    """J'J, J the transposed sensitivity."""
    # A sum of products: a matrix product of this shape is slower in a batch.
    return jnp.sum(sensitivity[:, None] * sensitivity[None, :], axis=-1)


def information_along(
    sensitivity: Float[Array, "free samples"],
    path: Float[Array, "free samples"] | None,
    sigma: Scalar,
    every: int,
) -> Float[Array, "reports free free"]:
    """The posterior information after every so many samples of a stream, in units of 1/sigma^2.

    J(k+1) = (Q + J(k)^-1)^-1 + j j'/sigma^2 from J = 0, j the sensitivity of a sample and Q the
    mean square of the steps that the parameters take along their path, 0 without one. For a linear
    model and a random walk of such steps its inverse is the covariance of the exact Kalman filter.
    Source: Tichavsky, Muravchik and Nehorai 1998, Eq. 21, with the identity as transition.
    """
    free = sensitivity.shape[0]
    # Q as the sum of g g' over the rows g of a triangle.
    walk = jnp.zeros((0, free))
    if path is not None:
        steps = jnp.diff(path).T
        walk = jnp.linalg.qr(steps / np.sqrt(len(steps)), mode="r")

    def sample(
        information: Float[Array, "free free"], own: Float[Array, " free"]
    ) -> tuple[Float[Array, "free free"], None]:
        # Q + J^-1 inverted a row of the walk at a time: it takes no inverse of J, which is
        # singular at first.
        for row in walk:
            towards = jnp.sum(information * row, axis=-1)
            spread = sigma**2 + jnp.sum(towards * row)
            known = jnp.where(spread > 0, spread, 1.0)
            information = information - towards[:, None] * towards / known
        return information + own[:, None] * own, None

    def report(
        information: Float[Array, "free free"], seen: Float[Array, "every free"]
    ) -> tuple[Float[Array, "free free"], Float[Array, "free free"]]:
        information, _ = jax.lax.scan(sample, information, seen)
        return information, information

    parts = sensitivity.T.reshape(-1, every, free)
    found: Float[Array, "reports free free"] = jax.lax.scan(report, jnp.zeros((free, free)), parts)[
        1
    ]
    return found


def inverse_information(information: Float[Array, "free free"]) -> Float[Array, "free free"]:
    """(J'J)^-1, the parameters brought to one scale first.

    NaN where it is singular: there the data do not determine the parameters.
    """
    scale = jnp.sqrt(jnp.diagonal(information))
    scale = jnp.where(scale > 0, scale, 1.0)
    scaled = information / jnp.outer(scale, scale)
    inverse = jax.vmap(lambda unit: solved(scaled, unit).x)(jnp.eye(len(scale)))
    pivots = solved(scaled, scale).pivots
    regular = jnp.all(jnp.isfinite(inverse)) & jnp.all(pivots > 0)
    return jnp.where(regular, inverse / jnp.outer(scale, scale), jnp.nan)


def quantity_covariance(
    curve: Curve, covariance: Float[Array, "free free"], known: Known
) -> Float[Array, "values values"]:
    """Covariance of `quantities` by the delta method, from that of the free parameters."""
    gradient = jax.jacfwd(lambda values: quantities(with_free_values(curve, values), known))(
        free_values(curve)
    )
    return gradient @ covariance @ gradient.T


def cramer_rao_bound(
    curve: Curve,
    slip: Float[Array, " points"],
    mask: Bool[Array, " points"],
    conditions: Conditions,
    sigma: Scalar,
    known: Known,
) -> Float[Array, " values"]:
    """Smallest standard deviation of an unbiased estimate of each of `quantities`.

    For independent Gaussian noise of standard deviation sigma and parameters without bounds.
    """
    _, information = adhesion_and_information(curve, slip, mask, conditions)
    return bound_of_information(curve, information, sigma, known)


def bound_of_information(
    curve: Curve, information: Float[Array, "free free"], sigma: Scalar, known: Known
) -> Float[Array, " values"]:
    """Smallest standard deviation of each of `quantities` where J'J is this."""
    covariance = sigma**2 * inverse_information(information)
    return jnp.sqrt(jnp.diagonal(quantity_covariance(curve, covariance, known)))
