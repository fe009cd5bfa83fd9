"""The best fit of a curve to one measured record within its physical bounds, without a start."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.special import stdtrit

from adhesion_jax import runtime
from adhesion_jax.curves import SLIP_LIMIT, Curve, Peak, Scalar, physical_box, with_free_values
from adhesion_jax.identifiers.base import Status
from adhesion_jax.metrics.information import inverse_information
from adhesion_jax.optim import differential_evolution as de
from adhesion_jax.optim.box import on_bound
from adhesion_jax.optim.optimistix_solvers import levenberg_marquardt
from adhesion_jax.programs import QUICKLY, kept
from adhesion_jax.records import Record

#: Largest slip at which a peak is searched if slip is a velocity, m/s.
SLIP_VELOCITY_LIMIT = 10.0

#: Polach's curve with falling friction has two valleys: of 48 noisy records a population of 50
#: with F = .6 ended in the wrong one in 15, one of 100 with F = .8 in 1, these in none.
_POPULATION, _SCALE, _CROSSOVER = 200, 0.9, 0.9
_GENERATIONS, _SPREAD, _SEED = 2000, 1e-8, 0

#: Largest number of steps of Levenberg-Marquardt.
_STEPS = 500

#: Largest number of points of the search, chosen evenly in slip; the final fit uses all points.
_SEARCH_POINTS = 1000

#: A parameter lies on its bound if moving it there raises the misfit by at most this share.
_FREE_OF_COST = 1e-9

#: A parameter has no influence if its whole range changes adhesion by less than this (rms).
_NO_INFLUENCE = 1e-7

#: A fit has converged if the next step is below this share of the standard errors.
_STEP_LEFT = 1e-3

#: A residual below this share of the adhesion is due to the rounding of numbers, not to noise.
EXACT = 1e-10


class MeasuredFit(NamedTuple):
    """The least squares fit of one curve to a record, with errors and status.

    Noise is taken as independent, of one unknown variance SSE/(n - p), p the parameters that are
    not held. A parameter that is held (on its bound, or without influence) has no standard error
    (NaN); the others have those of a fit with that parameter known.
    """

    curve: Curve  # with the fitted values of its free parameters
    conditions: Mapping[str, float]  # conditions of the peak: the medians of the record
    slip_limit: float  # largest slip at which the peak was searched
    slip_unit: str
    points: int
    sum_of_squares: float
    parameters: Float[np.ndarray, " free"]
    covariance: Float[np.ndarray, "free free"]  # zero where held
    on_bound: Bool[np.ndarray, " free"]
    no_influence: Bool[np.ndarray, " free"]
    peak: Peak
    slip_opt_se: float  # NaN where there is no peak
    mu_max_se: float
    converged: bool

    @property
    def held(self) -> Bool[np.ndarray, " free"]:
        return self.on_bound | self.no_influence

    @property
    def standard_errors(self) -> Float[np.ndarray, " free"]:
        return np.where(self.held, np.nan, np.sqrt(np.diagonal(self.covariance)))

    @property
    def rms(self) -> float:
        """sqrt(SSE/n)."""
        return float(np.sqrt(self.sum_of_squares / self.points))

    @property
    def bic(self) -> float:
        """Bayes' information criterion: n ln(SSE/n) + (p + 1) ln n.

        p counts all free parameters, held or not, and the one more is the noise variance.
        Schwarz 1978, Ann. Statist. 6:461-464, less the constants that all curves share.
        """
        size = self.parameters.size + 1
        return float(
            2 * self.points * np.log(max(self.rms, np.finfo(float).tiny))
            + size * np.log(self.points)
        )

    @property
    def quantile(self) -> float:
        """Half the width of a 95 % interval in standard errors: Student's t with n - p."""
        return float(stdtrit(self.points - np.sum(~self.held), 0.975))

    @property
    def status(self) -> Status:
        if not np.isfinite(self.sum_of_squares):
            return Status.NOT_FINITE
        if not self.peak.adhesion > 0:
            return Status.INADMISSIBLE
        if not self.peak.found:
            return Status.NO_PEAK
        if not self.converged or not np.all(np.isfinite(self.covariance)):
            return Status.NOT_CONVERGED
        return Status.ON_BOX if np.any(self.held) else Status.TRUSTED


def fit_measured(curve: Curve, record: Record, slip_is_velocity: bool) -> MeasuredFit:
    """The curve of least squares over its physical box, whatever the start.

    Differential evolution over the whole box, then Levenberg-Marquardt from its best. Parameters
    with a positive lower bound are searched on a logarithmic scale. `record` must hold the
    conditions the curve NEEDS.
    """
    return fit_all({"": curve}, record, slip_is_velocity)[""]


class _Problem(NamedTuple):
    """The arguments of `_fit`."""

    curve: Curve
    slip: Float[Array, " points"]
    adhesion: Float[Array, " points"]
    conditions: Mapping[str, Float[Array, " points"]]
    chosen: Int[Array, " search"]
    medians: Mapping[str, Scalar]
    slip_limit: Scalar


def _problem(curve: Curve, record: Record, slip_is_velocity: bool) -> _Problem:
    conditions = {name: record.conditions[name] for name in curve.NEEDS}
    medians = {name: float(np.median(column)) for name, column in conditions.items()}
    limit = SLIP_VELOCITY_LIMIT if slip_is_velocity else SLIP_LIMIT
    order = np.argsort(np.abs(np.asarray(record.slip)), kind="stable")
    chosen = jnp.asarray(order[:: -(-order.size // _SEARCH_POINTS)])
    return _Problem(curve, record.slip, record.adhesion, conditions, chosen, medians, limit)


def _measured_fit(problem: _Problem, found: tuple, slip_is_velocity: bool) -> MeasuredFit:
    *estimated, peak, peak_se, converged = found
    parameters, covariance, bound, unfelt, objective = map(np.asarray, estimated)
    slip_opt_se, mu_max_se = np.asarray(peak_se).tolist()
    return MeasuredFit(
        with_free_values(problem.curve, parameters),
        {name: float(value) for name, value in problem.medians.items()},
        float(problem.slip_limit),
        " m/s" if slip_is_velocity else "",
        problem.slip.size,
        float(objective),
        parameters,
        covariance,
        bound,
        unfelt,
        peak,
        slip_opt_se,
        mu_max_se,
        bool(converged),
    )


def fit_all(
    curves: Mapping[str, Curve], record: Record, slip_is_velocity: bool
) -> dict[str, MeasuredFit]:
    """Every curve that can be evaluated on the record, by name, in the order of `curves`."""
    problems = {
        name: _problem(curve, record, slip_is_velocity)
        for name, curve in curves.items()
        if not missing_columns(curve, record)
    }

    def fitted(problem: _Problem) -> MeasuredFit:
        return _measured_fit(problem, _fit(*problem), slip_is_velocity)

    with runtime.threads() as pool:  # nearly all the time is compilation
        return dict(zip(problems, pool.map(fitted, problems.values()), strict=True))


def missing_columns(curve: Curve, record: Record) -> tuple[str, ...]:
    """The columns without which the curve cannot be evaluated on this record."""
    return tuple(name for name in curve.NEEDS if name not in record.conditions)


def confidence_band(
    fit: MeasuredFit, slip: Float[Array, " points"]
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    """The curve and half the width of its pointwise 95 % band, by the delta method."""
    adhesion, error = _band(fit.curve, jnp.asarray(fit.covariance), slip, fit.conditions)
    return np.asarray(adhesion), fit.quantile * np.asarray(error)


def box_share_to_parameters(
    curve: Curve, share: Float[Array, "free ..."]
) -> Float[Array, "free ..."]:
    lower, upper = (jnp.expand_dims(b, range(1, share.ndim)) for b in physical_box(curve))
    logarithmic = lower > 0
    ratio = jnp.where(logarithmic, upper, 1.0) / jnp.where(logarithmic, lower, 1.0)
    return jnp.where(logarithmic, lower * ratio**share, lower + (upper - lower) * share)


# Compiling takes many times as long as running: unoptimised and without the fusion emitters, of the
# six curves together, 11 CPU-seconds instead of 37, and running 2.4 instead of 1.2.
@kept(compiler={"xla_backend_optimization_level": "0", **QUICKLY})
def _fit(
    curve: Curve,
    slip: Float[Array, " points"],
    adhesion: Float[Array, " points"],
    conditions: Mapping[str, Float[Array, " points"]],
    chosen: Int[Array, " search"],
    medians: Mapping[str, Scalar],
    slip_limit: Scalar,
) -> tuple[Array, Array, Array, Array, Array, Peak, Array, Array]:
    zero, one = jnp.zeros(len(curve.free)), jnp.ones(len(curve.free))

    def misfit(parameters: Float[Array, " free"]) -> Float[Array, " points"]:
        return with_free_values(curve, parameters)(slip, conditions) - adhesion

    def misfit_of_share(share: Float[Array, " free"]) -> Float[Array, " points"]:
        return misfit(box_share_to_parameters(curve, share))

    few = {name: column[chosen] for name, column in conditions.items()}

    def objective(share: Float[Array, "free members"]) -> Float[Array, " members"]:
        def one_member(parameters: Float[Array, " free"]) -> Float[Array, ""]:
            model = with_free_values(curve, parameters)(slip[chosen], few)
            return jnp.sum((model - adhesion[chosen]) ** 2)

        value = jax.vmap(one_member, in_axes=1)(box_share_to_parameters(curve, share))
        # A denominator may vanish inside the box: such a curve counts as worse than any other.
        return jnp.where(jnp.isfinite(value), value, jnp.inf)

    population_key, search_key = jax.random.split(jax.random.key(_SEED))
    settings = de.Settings(
        scale=jnp.asarray(_SCALE),
        crossover=jnp.asarray(_CROSSOVER),
        reflect=jnp.asarray(True),
        tolerance=jnp.asarray(_SPREAD),
    )
    population = jax.random.uniform(population_key, (len(curve.free), _POPULATION))
    search = de.minimise(objective, population, zero, one, search_key, settings, _GENERATIONS)
    polished = levenberg_marquardt(misfit_of_share, search.x, zero, one, _STEPS)
    improved = polished.objective <= jnp.sum(misfit_of_share(search.x) ** 2)
    share = jnp.where(improved, polished.x, search.x)

    snapped = jnp.where(on_bound(share, zero, one), jnp.round(share), share)
    at_bound = jnp.sum(misfit_of_share(snapped) ** 2)
    inside = jnp.sum(misfit_of_share(share) ** 2)
    free_of_cost = at_bound <= inside * (1 + _FREE_OF_COST)
    bound = on_bound(share, zero, one) & free_of_cost
    share = jnp.where(bound, snapped, share)

    parameters = box_share_to_parameters(curve, share)
    sensitivity = jax.jacfwd(misfit_of_share)(share)
    unfelt = ~bound & (jnp.sqrt(jnp.mean(sensitivity**2, axis=0)) < _NO_INFLUENCE)
    free = ~bound & ~unfelt
    sum_of_squares = jnp.sum(misfit(parameters) ** 2)
    variance = sum_of_squares / jnp.maximum(slip.size - jnp.sum(free), 1)
    # Held parameters are removed: their rows and columns become those of the identity.
    information = jnp.where(jnp.outer(free, free), sensitivity.T @ sensitivity, 0.0)
    information = information + jnp.diag(jnp.where(free, 0.0, 1.0))
    of_share = jnp.where(jnp.outer(free, free), variance * inverse_information(information), 0.0)
    stretch = jax.jacfwd(lambda share: box_share_to_parameters(curve, share))(share)
    covariance = stretch @ of_share @ stretch.T

    def peak_values(parameters: Float[Array, " free"]) -> Float[Array, "2"]:
        peak = with_free_values(curve, parameters).peak(medians, slip_limit)
        return jnp.stack([peak.slip, peak.adhesion])

    peak = with_free_values(curve, parameters).peak(medians, slip_limit)
    # The derivative by a parameter that is held may not be a number, and is not needed.
    by_parameter = jnp.where(free, jax.jacfwd(peak_values)(parameters), 0.0)
    peak_se = jnp.sqrt(jnp.diagonal(by_parameter @ covariance @ by_parameter.T))
    # Without a peak the slip of the largest adhesion is an end of the range, not an estimate.
    peak_se = jnp.stack([jnp.where(peak.found, peak_se[0], jnp.nan), peak_se[1]])
    # Gauss-Newton's next step, squared and in standard errors: g' C g / s^4 with g = J'e.
    gradient = sensitivity.T @ misfit(parameters) / variance
    converged = gradient @ of_share @ gradient <= _STEP_LEFT**2
    # Points that lie on the curve to rounding leave no noise to measure the step by.
    converged = converged | (sum_of_squares <= EXACT**2 * jnp.sum(adhesion**2))
    return parameters, covariance, bound, unfelt, sum_of_squares, peak, peak_se, converged


@kept()
def _band(
    curve: Curve,
    covariance: Float[Array, "free free"],
    slip: Float[Array, " points"],
    conditions: Mapping[str, Scalar],
) -> tuple[Array, Array]:
    values = jnp.stack([getattr(curve, name) for name in curve.free])
    jacobian = jax.jacfwd(lambda v: with_free_values(curve, v)(slip, conditions))(values)
    error = jnp.sqrt(jnp.einsum("ni,ij,nj->n", jacobian, covariance, jacobian))
    return curve(slip, conditions), error
