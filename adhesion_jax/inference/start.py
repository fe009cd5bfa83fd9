"""The start of a fit: the curve of least squares within its physical bounds, wherever it lies."""

from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Curve, with_free_values
from adhesion_jax.curves.bent import FUNCTIONS
from adhesion_jax.inference.descent import Problem, descended, parameters_at
from adhesion_jax.inference.law import Span
from adhesion_jax.inference.rows import Rows, evenly, means, of_like
from adhesion_jax.inference.sums import Variance, law_at
from adhesion_jax.optim import levenberg_marquardt
from adhesion_jax.programs import QUICKLY, kept
from adhesion_jax.records import Record

#: Places of the box that are tried, in as many groups as searches start from the best of each; most
#: steps of a search.
_TRIED, _STARTS, _STEPS, _SEED = 1024, 32, 100, 0

#: Most points of a record, chosen evenly; and groups of like slip, or of like slip and of like
#: values of the first column that a curve needs, by whose means the start is searched.
_POINTS, _GROUPS = 20_000, (256, (64, 16))

#: The last search ends where a step promises to lower half the deviance by less than this.
_NEAR = 1e-10


def least_squares(curve: Curve, record: Record) -> Float[np.ndarray, " free"]:
    """The best parameters for a record of up to 20,000 points, and of so many of a longer one.

    As shares of the physical box; those with a positive lower bound on a logarithmic scale.
    Levenberg-Marquardt from many places of the box for the means of groups of like points, then
    from the best of its ends for the points. `record` must hold the conditions the curve NEEDS.
    """
    chosen = evenly(np.asarray(record.slip).size, _POINTS)
    slip, adhesion = np.asarray(record.slip)[chosen], np.asarray(record.adhesion)[chosen]
    conditions = {name: np.asarray(record.conditions[name])[chosen] for name in curve.NEEDS}
    alike, exact, whole = np.ones(slip.size), np.zeros(slip.size), np.array([0, slip.size])
    group = of_like(slip, conditions, *_GROUPS)
    found = means(group, alike, slip, adhesion, conditions, exact)
    lacking = _GROUPS[1][0] * _GROUPS[1][1] if conditions else _GROUPS[0]
    lacking -= found.slip.size

    def filled(column: np.ndarray) -> np.ndarray:
        return np.pad(column, (0, lacking), "edge")

    few = (
        filled(found.slip),
        filled(found.adhesion),
        {n: filled(c) for n, c in found.conditions.items()},
    )
    weight = np.pad(found.weight, (0, lacking))
    share = np.append(_best(curve, weight, *few), np.zeros(FUNCTIONS))
    rows = Rows(slip, adhesion, conditions, alike, whole, whole, np.zeros(1, int), False, False)
    problem = Problem(curve, Span(1.0, 1.0))
    (law,) = law_at(rows, problem.law(share), exact)
    square = max(float(np.mean((adhesion - law) ** 2)), 1e-24 * float(np.mean(adhesion**2)), 1e-300)
    variance = Variance(float(np.sqrt(square)), alike, exact)
    return descended(problem, share, rows, variance, robust=False, near=_NEAR)[0][: problem.free]


def share_of(curve: Curve) -> Float[np.ndarray, " free"]:
    """The inverse of `parameters_at`: shares of the box of the values of the free parameters."""
    values = np.array([float(getattr(curve, name)) for name in curve.free])
    described = [curve.PARAMETERS[name] for name in curve.free]
    lower, upper = np.array([[p.lower, p.upper] for p in described]).T
    logarithmic = lower > 0
    ratio = np.where(logarithmic, upper, 2.0) / np.where(logarithmic, lower, 1.0)
    along = np.log(np.where(logarithmic, values / np.where(logarithmic, lower, 1.0), 1.0))
    return np.where(logarithmic, along / np.log(ratio), (values - lower) / (upper - lower))


# Compiling takes many times as long as running: unoptimised and without the fusion emitters.
@kept(compiler={"xla_backend_optimization_level": "0", **QUICKLY})
def _best(
    curve: Curve,
    weight: Float[Array, " groups"],
    slip: Float[Array, " groups"],
    adhesion: Float[Array, " groups"],
    conditions: Mapping[str, Float[Array, " groups"]],
) -> Float[Array, " free"]:
    count = len(curve.free)
    zero, one = jnp.zeros(count), jnp.ones(count)

    def misfit(share: Float[Array, " free"]) -> Float[Array, " groups"]:
        model = with_free_values(curve, parameters_at(curve, share))(slip, conditions)
        return jnp.sqrt(weight) * (model - adhesion)

    def amount(share: Float[Array, " free"]) -> Float[Array, ""]:
        # A denominator may vanish inside the box: such a curve counts as worse than any other.
        value = jnp.sum(misfit(share) ** 2)
        return jnp.where(jnp.isfinite(value), value, jnp.inf)

    tried = jax.random.uniform(jax.random.key(_SEED), (_STARTS, _TRIED // _STARTS, count))
    best = jnp.argmin(jax.lax.map(jax.vmap(amount), tried), axis=1)
    starts = jnp.take_along_axis(tried, best[:, None, None], axis=1)[:, 0]
    ends = jax.lax.map(lambda x: levenberg_marquardt.fit(misfit, x, zero, one, _STEPS).x, starts)
    return ends[jnp.argmin(jax.vmap(amount)(ends))]
