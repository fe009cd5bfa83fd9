"""From the parameters a batch method found to its Estimate: the part all batch methods share."""

from collections import OrderedDict
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from adhesion_jax.curves import free_values, with_free_values
from adhesion_jax.identifiers.base import Estimate, Status
from adhesion_jax.metrics.information import (
    adhesion_and_information,
    quantities,
    quantity_covariance,
    quantity_names,
)
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
    curve = with_free_values(known.curve, parameters)
    adhesion, information = adhesion_and_information(
        curve, record.slip, record.mask, record.conditions
    )
    return Fit(
        parameters,
        information,
        jnp.sum(jnp.where(record.mask, adhesion - record.adhesion, 0.0) ** 2),
        jnp.sum(record.mask, dtype=jnp.int32),
        evaluations.astype(jnp.int32),
        converged,
        finite,
    )


def to_estimate(state: FitState) -> Estimate:
    """Values, their covariance (noise variance estimated from the residual), and status."""
    known, fit = state.known, state.fit
    curve = with_free_values(known.curve, fit.parameters)
    variance = fit.objective / jnp.maximum(fit.points - fit.parameters.size, 1)
    covariance = quantity_covariance(curve, fit.information, variance)
    peak = curve.peak({})
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
    # A plain dict would come out of a compiled function with its names sorted.
    named = OrderedDict(zip(quantity_names(curve), quantities(curve), strict=True))
    return Estimate(named, covariance, status, fit.objective, fit.evaluations)
