"""Levenberg-Marquardt inside a box: one step at a time, for one problem or for many at once.

Nonlinear least squares by steps of damped normal equations (Levenberg 1944; Marquardt 1963, J. SIAM
11:431-441), the damping relative to the diagonal of J'J. Parameters on a bound that they are
pushed against are held; others that reach one on the way stay there, and the step of the rest is
solved anew.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.optim.arrays import Count, Matrix, Value, Vector, Whether
from adhesion_jax.optim.least_squares import Residual, Result, separated
from adhesion_jax.optim.turns import Turns, compacted_while_loop
from adhesion_jax.programs import kept

#: Damping of the first step, relative to the diagonal of J'J.
_FIRST_DAMPING = 1e-3

#: Smallest damping after a step that lowers the loss, and before it is raised.
_LEAST_DAMPING, _LEAST_RAISED = 1e-15, 1e-8

#: The loss is taken for quadratic if a step lowers it by more than this share of what it promised:
#: the damping is then multiplied by the factor beside it.
_AS_PROMISED, _EASED_AS_PROMISED = 0.9, 0.1

#: Smallest factor on the damping after any other step that lowers the loss.
_EASED = 1 / 3

#: First factor on the damping after a step that does not lower the loss; each further one in a row
#: doubles it.
_RAISED = 2.0

#: Number of passes in each step that find out which parameters stop at a bound.
_CUT_OFF = 4

#: The search ends after this number of successive steps whose gain is below the tolerance.
_CRAWLING = 3

#: A step that promises to remove less than this share of the loss may seem to raise it.
_ROUNDING = 1e-13

#: Up to this number of parameters, sums and elimination are written out number by number, and in a
#: batch each number is an array over the problems; with more, they are left to BLAS and LAPACK.
_WRITTEN_OUT = 8

#: `fit` ends where no parameter is to move by more than this share of itself.
_SETTLED = 1e-7

#: `fit` also ends after a few successive steps that gained less than this share of the loss.
_CRAWL = 2e-16

#: How the searches of a batch take turns. Others of 16 to 128 side by side, and of 1 to 4 steps,
#: were not faster for 500 points by more than single measurements scatter.
_TURNS = Turns(side_by_side=32, steps=2, axis=0)

#: The Jacobian counts as singular where, its columns at unit length, the part of one that is
#: orthogonal to those before it is shorter than the square root of this: J'J tells no better.
_SINGULAR = 1e-13


class Local(NamedTuple):
    """What is known of the loss at one place: half the sum of squares, its gradient and J'J.

    A prior or a penalty may be part of each of the three.
    """

    loss: Value
    gradient: Vector
    hessian: Matrix
    rest: Any = ()  # whatever else was computed there and is wanted at the end


class Search(NamedTuple):
    """A search: the best place so far, and the next one to try."""

    x: Vector
    local: Local  # at x
    steps: Count  # evaluations so far
    trial: Vector
    promised: Value  # the share of the loss that the trial is to remove
    damping: Value
    raised: Value  # factor on the damping if the trial fails
    scale: Vector  # largest diagonal of J'J so far
    crawled: Count  # successive steps that gained less than the tolerance


Evaluate = Callable[[Vector], Local]


def begin(start: Vector, rest: Any = ()) -> Search:
    """The search before its first evaluation, which is that of the start.

    `rest` has the form of `Local.rest`; its numbers are not used. (To find the form by tracing the
    function once more would add a tenth to the time of compiling a large model.)
    """
    infinite = jnp.full((), jnp.inf)
    return Search(
        start,
        Local(infinite, jnp.zeros_like(start), jnp.zeros((start.size, start.size)), rest),
        jnp.asarray(0),
        start,
        jnp.asarray(jnp.inf),
        jnp.asarray(_FIRST_DAMPING),
        jnp.asarray(_RAISED),
        jnp.zeros_like(start),
        jnp.asarray(0),
    )


def advance(
    evaluate: Evaluate, search: Search, lower: Vector, upper: Vector, near: Value
) -> Search:
    """The search after one more evaluation: the only place of a program where it is evaluated."""
    best, damping = search.local, search.damping
    new = evaluate(search.trial)
    # At the bottom the gain of a step is less than the rounding of the loss.
    small = (search.promised >= 0) & (search.promised < _ROUNDING)
    better = (new.loss < best.loss) | (small & (new.loss <= best.loss * (1 + 10 * _ROUNDING)))
    gain = best.loss - new.loss
    ratio = gain / (search.promised * best.loss)
    eased = jnp.maximum(_EASED, 1 - (2 * ratio - 1) ** 3)
    eased = damping * jnp.where(ratio > _AS_PROMISED, _EASED_AS_PROMISED, eased)
    raised = jnp.maximum(damping, _LEAST_RAISED) * search.raised
    begun = jnp.isfinite(best.loss)
    damping = jnp.where(better & begun, jnp.maximum(eased, _LEAST_DAMPING), damping)
    damping = jnp.where(better, damping, raised)
    little = gain < near * best.loss
    crawled = jnp.where(better, jnp.where(little, search.crawled + 1, 0), search.crawled)
    x = jnp.where(better, search.trial, search.x)
    local = jax.tree.map(lambda n, o: jnp.where(better, n, o), new, best)
    scale = jnp.maximum(search.scale, jnp.diag(local.hessian))
    step = bounded_step(x, local, damping * scale, lower, upper)
    # Exactly on a bound, where it is one.
    trial = jnp.where(step <= lower - x, lower, jnp.where(step >= upper - x, upper, x + step))
    promised = -(step @ local.gradient + 0.5 * step @ local.hessian @ step)
    promised = promised / jnp.maximum(local.loss, 1e-300)
    raised = jnp.where(better, _RAISED, 2 * search.raised)
    return Search(x, local, search.steps + 1, trial, promised, damping, raised, scale, crawled)


def arrived(search: Search, near: Value) -> Whether:
    """Whether the next step promises, or several successive ones have gained, less than `near`.

    As shares of the loss. A step that stops at a bound may promise a rise, one of a singular matrix
    is not a number: neither is the end.
    """
    return ((search.promised >= 0) & (search.promised < near)) | (search.crawled >= _CRAWLING)


def bounded_step(x: Vector, local: Local, damping: Vector, lower: Vector, upper: Vector) -> Vector:
    """The damped step from x that ends inside the box."""
    gradient, hessian = local.gradient, local.hessian
    held = ((x <= lower) & (gradient > 0)) | ((x >= upper) & (gradient < 0))
    damped = hessian + jnp.diag(damping)

    def within_bounds(_turn: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
        """Parameters that reached a bound stay there; the step of the others is solved anew."""
        step, loose = found
        kept = jnp.where(loose, 0.0, step)
        scale = jnp.where(loose, 1.0, 0.0)
        matrix = damped * scale[:, None] * scale + jnp.diag(1.0 - scale)
        step = kept - solved(matrix, scale * (gradient + hessian @ kept)).x
        moved = jnp.clip(step, lower - x, upper - x)
        return moved, loose & (moved == step)

    start = jnp.zeros_like(x), ~held & (jnp.diag(hessian) > 0)
    return jax.lax.fori_loop(0, _CUT_OFF, within_bounds, start)[0]


@kept()
def advanced(search: Search, local: Local, lower: Vector, upper: Vector, near: Value) -> Search:
    """`advance`, compiled, for a loss that is computed in NumPy: `local` is that of the trial."""
    return advance(lambda _: local, search, lower, upper, near)


class Solved(NamedTuple):
    x: Vector
    pivots: Vector


def solved(matrix: Matrix, right: Vector) -> Solved:
    """The solution of a positive definite system, and the pivots of its elimination."""
    size = right.size
    if size > _WRITTEN_OUT:
        factor = jnp.linalg.cholesky(matrix)
        return Solved(jnp.linalg.solve(matrix, right), jnp.diag(factor) ** 2)
    # Cholesky's elimination as L D L'.
    below: dict[tuple[int, int], Array] = {}
    pivots: list[Array] = []
    ahead: list[Array] = []
    for i in range(size):
        for j in range(i):
            inner = sum(below[i, k] * below[j, k] * pivots[k] for k in range(j))
            below[i, j] = (matrix[i, j] - inner) / pivots[j]
        pivots.append(matrix[i, i] - sum(below[i, k] ** 2 * pivots[k] for k in range(i)))
        ahead.append(right[i] - sum(below[i, k] * ahead[k] for k in range(i)))
    found: dict[int, Array] = {}
    for i in reversed(range(size)):
        found[i] = ahead[i] / pivots[i] - sum(below[k, i] * found[k] for k in range(i + 1, size))
    return Solved(jnp.stack([found[i] for i in range(size)]), jnp.stack(pivots))


def normal_equations(columns: list[Float[Array, " n"]], left: Float[Array, " n"]) -> Local:
    """The loss and its derivatives of a residual whose Jacobian has these columns."""
    # Without the barrier the residual is computed once more for each of the sums.
    rows = jax.lax.optimization_barrier([*columns, left])
    if len(columns) > _WRITTEN_OUT:
        whole = jnp.stack(rows)
        products = whole @ whole.T
    else:
        # In a batch these take half as long as products of small matrices.
        sums = [[jnp.sum(a * b) for b in rows[: i + 1]] for i, a in enumerate(rows)]
        count = range(len(rows))
        products = jnp.stack(
            [jnp.stack([sums[max(i, j)][min(i, j)] for j in count]) for i in count]
        )
    return Local(0.5 * products[-1, -1], products[-1, :-1], products[:-1, :-1])


def fit(residual: Residual, start: Vector, lower: Vector, upper: Vector, max_steps: int) -> Result:
    """The least squares of a residual inside the box, and whether it is proven to be a minimum.

    In a batch no search waits for the slowest: each one that has ended gives its place to another.
    """
    value, data = separated(residual, start)

    def evaluated(data: list[Array], x: Vector) -> Local:
        left, push = jax.linearize(partial(value, data), x)
        return normal_equations([push(along) for along in jnp.eye(x.size)], left)

    def unfinished(search: Search) -> Whether:
        still = jnp.all(jnp.abs(search.trial - search.x) <= 0.5 * _SETTLED * jnp.abs(search.x))
        sure = (search.damping <= _FIRST_DAMPING) | ~jnp.isfinite(search.local.loss)
        ended = (still & sure) | (search.crawled >= _CRAWLING)
        return (search.steps == 0) | (~ended & (search.steps < max_steps))

    def one_step(data: list[Array], box: tuple[Array, Array], search: Search) -> Search:
        return advance(partial(evaluated, data), search, *box, jnp.asarray(_CRAWL))

    @jax.custom_batching.custom_vmap
    def ended(data: list[Array], box: tuple[Array, Array], start: Array) -> Search:
        return jax.lax.while_loop(unfinished, partial(one_step, data, box), begin(start))

    @ended.def_vmap
    def ended_in_batch(
        size: int, batched: list, data: list[Array], box: tuple[Array, Array], start: Array
    ) -> tuple[Search, Search]:
        axes = jax.tree.map(lambda is_batched: 0 if is_batched else None, tuple(batched))
        started = jax.vmap(begin, (axes[2],), axis_size=size)(start)
        steps = jax.vmap(one_step, (*axes[:2], 0))
        found = compacted_while_loop(
            jax.vmap(unfinished), steps, started, (data, box), axes[:2], _TURNS
        )
        return found, jax.tree.map(lambda _: True, found)

    search = ended(data, (lower, upper), jnp.clip(start, lower, upper))
    finite = jnp.all(jnp.isfinite(search.x)) & jnp.isfinite(search.local.loss)
    x = jnp.where(finite, search.x, start)
    local, steps = search.local, search.steps
    converged = finite & proven(x, local, lower, upper)
    return Result(x, 2 * local.loss, local.hessian, steps, steps * (1 + x.size), converged)


def undamped(x: Vector, local: Local, lower: Vector, upper: Vector) -> tuple[Vector, Whether]:
    """The step of Gauss and Newton, and whether the Jacobian is of full rank.

    Parameters on a bound that they are pushed against take no part.
    """
    held = ((x <= lower) & (local.gradient > 0)) | ((x >= upper) & (local.gradient < 0))
    length = jnp.sqrt(jnp.diag(local.hessian))
    loose = jnp.where(held, 0.0, 1.0) / jnp.where(length > 0, length, 1.0)
    matrix = local.hessian * loose[:, None] * loose + jnp.diag(jnp.where(held, 1.0, 0.0))
    step, pivots = solved(matrix, -loose * local.gradient)
    return loose * step, jnp.all(pivots > _SINGULAR)


def proven(x: Vector, local: Local, lower: Vector, upper: Vector) -> Whether:
    """Whether x is a minimum: no undamped step is left, and the Jacobian is of full rank."""
    step, regular = undamped(x, local, lower, upper)
    return regular & jnp.all(jnp.abs(step) <= _SETTLED * jnp.abs(x))
