"""Standard errors of curves fitted to blocks, whatever noise or misfit their points have."""

from collections.abc import Iterable
from functools import reduce
from operator import add
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import with_free_values
from adhesion_jax.inference.sandwich import of_cosines
from adhesion_jax.metrics.information import information_of, quantities
from adhesion_jax.records import Known, Record

#: Parts of a block, of equally many points, whose sums stand for the points: the cosines, of at
#: most two waves, are slow against them.
_PARTS = 50


def cosine_errors(
    known: Known, record: Record, run_axes: Any, parameters: Float[Array, "runs free"]
) -> Float[Array, "runs values"]:
    """Standard errors of `quantities` of the curves with the least squares of a block of each run.

    They are the larger of two, by cosines over the points in their order, and in the order of their
    slips: the first has the noise that neighbours in time share, the second the misfit of a wrong
    curve, which neighbours in slip share. Degrees of freedom are COSINES. NaN where the points do
    not determine the parameters. `run_axes` are those of the record, as `jax.vmap` takes them.
    """

    def of_run(record: Record, parameters: Float[Array, " free"]) -> tuple[Array, ...]:
        """Sensitivities and residual of each point; L and a L' of B = L'L, a the gradient."""
        curve = with_free_values(known.curve, parameters)
        adhesion, push = jax.linearize(
            lambda values: with_free_values(curve, values)(record.slip, record.conditions),
            parameters,
        )
        rows = jnp.where(record.mask, jax.vmap(push)(jnp.eye(parameters.size)), 0.0)
        residual = jnp.where(record.mask, record.adhesion - adhesion, 0.0)
        gradient = jax.jacfwd(lambda values: quantities(with_free_values(curve, values), known))
        information = information_of(rows)
        scale = 1 / jnp.sqrt(jnp.diagonal(information))
        factor = jnp.linalg.cholesky(information * scale * scale[:, None])
        root = jax.scipy.linalg.solve_triangular(factor, jnp.diag(scale), lower=True)
        return jnp.concatenate([rows, residual[None]]), root, root.T @ root @ gradient(parameters).T

    # From here on the run axis is the last, and sums over parameters are written out: numbers that
    # lie side by side then go through the same operations.
    found = jax.vmap(of_run, (run_axes, 0), -1)(record, parameters)
    points, root, along = jax.lax.optimization_barrier(found)

    def variance(points: Float[Array, "sums points runs"]) -> Float[Array, "values runs"]:
        *rows, residual = points
        told = [_dot((_of_parts(one * row) for one in rows), along) for row in rows]
        pull = _dot((_of_parts(one * residual) for one in rows), along)
        found: Array = of_cosines(
            pull, jnp.stack([_dot(line, told) for line in root]), _dot(told, along)
        )
        return found

    def larger(number: Array, before: Float[Array, "values runs"]) -> Float[Array, "values runs"]:
        order = orders[number]
        ordered = points[:, order] if shared else jnp.take_along_axis(points, order.T[None], 1)
        return jnp.maximum(before, variance(ordered))

    by_slip = jnp.argsort(jnp.where(record.mask, record.slip, jnp.inf), axis=-1)
    in_time = jnp.broadcast_to(jnp.arange(by_slip.shape[-1]), by_slip.shape)
    orders, shared = jnp.stack([in_time, by_slip]), by_slip.ndim == 1
    different = jnp.where(jnp.all(in_time == by_slip), 1, 2)  # the orders are one in a sweep
    return jnp.sqrt(jax.lax.fori_loop(0, different, larger, jnp.zeros(along.shape[1:]))).T


def _dot(one: Iterable[Array], other: Iterable[Array]) -> Array:
    return reduce(add, (a * b for a, b in zip(one, other, strict=True)))


def _of_parts(of_points: Float[Array, "points runs"]) -> Float[Array, "parts 1 runs"]:
    """The sums over the points of each part; the last parts of few points are empty."""
    each = -(-len(of_points) // _PARTS)
    padded = jnp.pad(of_points, [(0, _PARTS * each - len(of_points)), (0, 0)])
    return padded.reshape(_PARTS, each, -1).sum(axis=1)[:, None]
