"""From the parameters a batch method found to its Estimate: the part all batch methods share."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from adhesion_jax.curves import free_values, with_free_values
from adhesion_jax.identifiers.base import Estimate, Status
from adhesion_jax.optim.box import on_bound
from adhesion_jax.scenarios import Known, Record


class Fit(NamedTuple):
    """Parameters found on one record and what the record says about them."""

    parameters: Float[Array, " free"]
    information: Float[Array, "free free"]  # J'J, J the sensitivities of adhesion
    objective: Float[Array, ""]
    points: Int[Array, ""]
    evaluations: Int[Array, ""]
    converged: Bool[Array, ""]
    finite: Bool[Array, ""]


class FitState(NamedTuple):
    """The state of a batch method: the last fit, and what the next one starts from."""

    known: Known
    key: PRNGKeyArray  # a solver's own randomness, new for every block
    fit: Fit


def start(known: Known, key: PRNGKeyArray) -> FitState:
    parameters = free_values(known.curve)
    size = parameters.size
    zero, no = jnp.int32(0), jnp.zeros((), dtype=bool)
    empty = Fit(parameters, jnp.zeros((size, size)), jnp.zeros(()), zero, zero, no, ~no)
    return FitState(known, key, empty)


def residual(known: Known, record: Record, parameters: Float[Array, " free"]) -> Float[Array, " n"]:
    """Model minus measurement, zero where there is no point."""
    model = with_free_values(known.curve, parameters)(record.slip, record.conditions)
    return jnp.where(record.mask, model - record.adhesion, 0.0)


def evaluate(
    known: Known,
    record: Record,
    previous: Fit,
    parameters: Float[Array, " free"],
    evaluations: Int[Array, ""],
    converged: Bool[Array, ""],
) -> Fit:
    """Residual and information at the parameters found, the same for every method.

    Parameters that are not finite are replaced by those of the previous fit.
    """
    finite = jnp.all(jnp.isfinite(parameters))
    parameters = jnp.where(finite, parameters, previous.parameters)
    misfit, push = jax.linearize(lambda p: residual(known, record, p), parameters)
    sensitivity = jax.vmap(push)(jnp.eye(parameters.size))
    return Fit(
        parameters,
        jnp.sum(sensitivity[:, None] * sensitivity[None, :], axis=-1),
        jnp.sum(misfit**2),
        jnp.sum(record.mask, dtype=jnp.int32),
        evaluations.astype(jnp.int32),
        converged,
        finite,
    )


def quantities(known: Known, parameters: Float[Array, " free"]) -> Float[Array, " values"]:
    """The free parameters, the largest adhesion and its slip."""
    peak = with_free_values(known.curve, parameters).peak({})
    return jnp.concatenate([parameters, jnp.stack([peak.adhesion, peak.slip])])


def quantity_names(known: Known) -> tuple[str, ...]:
    return (*known.curve.free, "mu_max", "slip_opt")


def covariance_from(
    information: Float[Array, "free free"], variance: Float[Array, ""]
) -> Float[Array, "free free"]:
    """variance * information^-1, the parameters brought to one scale first.

    NaN where the information is singular: there the data do not determine the parameters.
    """
    scale = jnp.sqrt(jnp.diagonal(information))
    scale = jnp.where(scale > 0, scale, 1.0)
    inverse = jnp.linalg.inv(information / jnp.outer(scale, scale))
    regular = jnp.all(jnp.isfinite(inverse)) & jnp.all(jnp.diagonal(inverse) > 0)
    return jnp.where(regular, variance * inverse / jnp.outer(scale, scale), jnp.nan)


def to_estimate(state: FitState) -> Estimate:
    """Values, their covariance by the delta method (noise variance estimated), and status."""
    known, fit = state.known, state.fit
    size = fit.parameters.size
    variance = fit.objective / jnp.maximum(fit.points - size, 1)
    gradient = jax.jacfwd(lambda p: quantities(known, p))(fit.parameters)
    covariance = gradient @ covariance_from(fit.information, variance) @ gradient.T
    values = quantities(known, fit.parameters)
    peak = with_free_values(known.curve, fit.parameters).peak({})
    status = jnp.select(
        [
            ~fit.finite,
            ~(peak.adhesion > 0),
            ~peak.found,
            ~fit.converged,
            jnp.any(on_bound(fit.parameters, known.lower, known.upper)),
        ],
        [
            Status.NOT_FINITE.value,
            Status.INADMISSIBLE.value,
            Status.NO_PEAK.value,
            Status.NOT_CONVERGED.value,
            Status.ON_BOX.value,
        ],
        Status.TRUSTED.value,
    )
    named = dict(zip(quantity_names(known), values, strict=True))
    return Estimate(named, covariance, status, fit.objective, fit.evaluations)
