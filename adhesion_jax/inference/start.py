"""The start of a fit: the curve of least squares within its physical bounds, wherever it lies."""

from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Curve, with_free_values
from adhesion_jax.optim import differential_evolution as de
from adhesion_jax.optim import levenberg_marquardt
from adhesion_jax.programs import QUICKLY, kept
from adhesion_jax.records import Record

#: Polach's curve with falling friction has two valleys: of 48 noisy records a population of 50
#: with F = .6 ended in the wrong one in 15, one of 100 with F = .8 in 1, these in none.
_POPULATION, _SCALE, _CROSSOVER = 200, 0.9, 0.9
_GENERATIONS, _SPREAD, _SEED = 2000, 1e-8, 0

#: Largest number of steps of Levenberg-Marquardt.
_STEPS = 500

#: Largest numbers of points of the search and of its last steps, chosen evenly in slip.
_SEARCH_POINTS, _POLISH_POINTS = 1000, 20_000


def least_squares(curve: Curve, record: Record) -> Float[np.ndarray, " free"]:
    """The best parameters for a record of up to 20,000 points, and of so many of a longer one.

    As shares of the physical box; those with a positive lower bound on a logarithmic scale.
    Differential evolution over the whole box, then Levenberg-Marquardt from its best. `record` must
    hold the conditions the curve NEEDS.
    """
    size = np.abs(np.asarray(record.slip))
    order = np.argsort(size, kind="stable")
    order = order[:: -(-order.size // _POLISH_POINTS)]
    order.sort()  # rows of a short record stay as they are
    slip, adhesion = np.asarray(record.slip)[order], np.asarray(record.adhesion)[order]
    conditions = {name: np.asarray(record.conditions[name])[order] for name in curve.NEEDS}
    by_size = np.argsort(size[order], kind="stable")
    chosen = by_size[:: -(-by_size.size // _SEARCH_POINTS)]
    return np.asarray(_least_squares(curve, slip, adhesion, conditions, chosen))


def parameters_at(curve: Curve, share: Any) -> Any:
    """The parameters at shares of the physical box, [free ...], of NumPy or of jax."""
    described = [curve.PARAMETERS[name] for name in curve.free]
    shape = (-1, *(1,) * (share.ndim - 1))
    lower = np.reshape([p.lower for p in described], shape)
    upper = np.reshape([p.upper for p in described], shape)
    logarithmic = lower > 0
    ratio = np.where(logarithmic, upper, 1.0) / np.where(logarithmic, lower, 1.0)
    width = np.where(logarithmic, 0.0, upper - lower)
    return lower * ratio**share + width * share


def share_of(curve: Curve) -> Float[np.ndarray, " free"]:
    """The inverse of `parameters_at`: shares of the box of the values of the free parameters."""
    values = np.array([float(getattr(curve, name)) for name in curve.free])
    described = [curve.PARAMETERS[name] for name in curve.free]
    lower, upper = np.array([[p.lower, p.upper] for p in described]).T
    logarithmic = lower > 0
    ratio = np.where(logarithmic, upper, 2.0) / np.where(logarithmic, lower, 1.0)
    along = np.log(np.where(logarithmic, values / np.where(logarithmic, lower, 1.0), 1.0))
    return np.where(logarithmic, along / np.log(ratio), (values - lower) / (upper - lower))


def stretch_at(curve: Curve, share: Float[np.ndarray, " free"]) -> Float[np.ndarray, " free"]:
    """The derivatives of the parameters by the shares of the box."""
    described = [curve.PARAMETERS[name] for name in curve.free]
    lower, upper = np.array([[p.lower, p.upper] for p in described]).T
    ratio = np.where(lower > 0, upper, 1.0) / np.where(lower > 0, lower, 1.0)
    return np.where(lower > 0, parameters_at(curve, share) * np.log(ratio), upper - lower)


# Compiling takes many times as long as running: unoptimised and without the fusion emitters, of the
# six curves together, 11 CPU-seconds instead of 37, and running 2.4 instead of 1.2.
@kept(compiler={"xla_backend_optimization_level": "0", **QUICKLY})
def _least_squares(
    curve: Curve,
    slip: Float[Array, " points"],
    adhesion: Float[Array, " points"],
    conditions: Mapping[str, Float[Array, " points"]],
    chosen: Array,
) -> Float[Array, " free"]:
    zero, one = jnp.zeros(len(curve.free)), jnp.ones(len(curve.free))

    def misfit(share: Float[Array, " free"]) -> Float[Array, " points"]:
        parameters = parameters_at(curve, share)
        return with_free_values(curve, parameters)(slip, conditions) - adhesion

    few = {name: column[chosen] for name, column in conditions.items()}

    def objective(share: Float[Array, " free"]) -> Float[Array, ""]:
        model = with_free_values(curve, parameters_at(curve, share))(slip[chosen], few)
        value = jnp.sum((model - adhesion[chosen]) ** 2)
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
    return levenberg_marquardt.fit(misfit, search.x, zero, one, _STEPS).x
