"""The Estimate from the parameters that a method found: shared by all methods with a curve."""

from collections import OrderedDict
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import free_values, with_free_values
from adhesion_jax.identifiers.base import Estimate, Identifier, Status, as_arrays
from adhesion_jax.metrics.information import (
    adhesion_and_information,
    inverse_information,
    quantities,
    quantity_covariance,
    quantity_names,
)
from adhesion_jax.optim.arrays import Count, Value, Whether
from adhesion_jax.optim.box import on_bound
from adhesion_jax.optim.least_squares import Result
from adhesion_jax.records import Known, Record


class Fit(NamedTuple):
    """The parameters found, and their fit to the last record."""

    parameters: Float[Array, " free"]
    covariance: Float[Array, "free free"]
    objective: Value  # sum of squared residuals over the record
    evaluations: Count
    converged: Whether
    finite: Whether
    skipped: Count  # points of the record left out because they are not finite


class FitState(NamedTuple):
    """The state of a batch method: the last fit, which is what the next one starts from."""

    known: Known
    key: PRNGKeyArray  # random key of the solver, new for every block
    fit: Fit


class OfLastRecord(Identifier):
    """A method with a curve that uses its last record alone: `update` sets the fit."""

    RESETS = False

    def init(self, known: Known, key: PRNGKeyArray) -> FitState:
        parameters = free_values(known.curve)
        size = parameters.size
        zero, no = jnp.int32(0), jnp.zeros((), dtype=bool)
        empty = Fit(parameters, jnp.zeros((size, size)), jnp.zeros(()), zero, no, ~no, zero)
        return as_arrays(FitState(known, key, empty))

    def estimate(self, state: FitState) -> Estimate:
        return to_estimate(state.known, state.fit, jnp.asarray(jnp.nan), jnp.zeros((), dtype=bool))


def residual(known: Known, record: Record, parameters: Float[Array, " free"]) -> Float[Array, " n"]:
    """Model minus measurement, zero where there is no point."""
    model = with_free_values(known.curve, parameters)(record.slip, record.conditions)
    return jnp.where(record.mask, model - record.adhesion, 0.0)


def evaluate(
    known: Known,
    record: Record,
    previous: Fit,
    parameters: Float[Array, " free"],
    evaluations: Count,
    converged: Whether,
) -> Fit:
    """`judge` with the objective and the information taken from the points."""
    curve = with_free_values(known.curve, parameters)
    adhesion, information = adhesion_and_information(
        curve, record.slip, record.mask, record.conditions
    )
    objective = jnp.sum(jnp.where(record.mask, adhesion - record.adhesion, 0.0) ** 2)
    found = Result(parameters, objective, information, evaluations, evaluations, converged)
    return judge(record, previous, found)


def judge(record: Record, previous: Fit, found: Result) -> Fit:
    """The fit of a record for what minimises its sum of squares.

    Their covariance is the inverse information times the noise variance, which is estimated
    from the residual. A record that makes the sum of squares NaN or infinite is left out whole,
    and the previous parameters stay: if single points were masked out, every run of a batch would
    have its own mask, and quantities that runs of equal slips share would be computed in each.
    """
    parameters, objective = found.x, found.objective
    finite = jnp.isfinite(objective) & jnp.all(jnp.isfinite(parameters))
    points = jnp.sum(record.mask, dtype=jnp.int32)
    variance = objective / jnp.maximum(points - parameters.size, 1)
    covariance = variance * inverse_information(found.information)
    return Fit(
        jnp.where(finite, parameters, previous.parameters),
        jnp.where(finite, covariance, previous.covariance),
        objective,
        found.evaluations.astype(jnp.int32),
        found.converged & (points >= parameters.size),
        finite,
        jnp.where(finite, 0, points),
    )


def to_estimate(known: Known, fit: Fit, forgetting: Value, reset: Whether) -> Estimate:
    """Values, their covariance and status."""
    curve = with_free_values(known.curve, fit.parameters)
    covariance = quantity_covariance(curve, fit.covariance, known)
    peak = curve.peak(known.conditions, known.slip_limit)
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
    named = OrderedDict(zip(quantity_names(curve), quantities(curve, known), strict=True))
    return Estimate(
        named,
        covariance,
        status,
        fit.objective,
        reset,
        forgetting,
        fit.evaluations,
        fit.skipped,
    )
