"""Least squares of a model under a noise: Levenberg-Marquardt inside the bounds, as one program."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from adhesion_jax.discovery.model.noise import Whitening
from adhesion_jax.discovery.model.program import Data, Model, with_jacobian
from adhesion_jax.programs import kept

#: Largest number of steps.
_STEPS = 40

#: Damping of the first step, relative to the diagonal of the Hessian.
_FIRST_DAMPING = 1e-2

#: Smallest damping.
_LEAST_DAMPING = 1e-12

#: The loss is taken for quadratic if a step lowers it by more than this share of what it promised.
_AS_PROMISED = 0.9

#: Factor on the damping after a step under which the loss is as good as quadratic.
_EASED_AS_PROMISED = 1e-4

#: Factor on the damping after any other step that lowers the loss.
_EASED = 0.2

#: After a step that does not lower the loss the damping is raised to at least this.
_RETRIED = 1e-4

#: Factor on the damping after a step that does not lower the loss.
_RAISED = 8

#: Number of passes in each step that find out which parameters stop at a bound.
_CUT_OFF = 4

#: The fit ends after this number of successive steps whose gain is below the tolerance.
_CRAWLING = 3


class Solution(NamedTuple):
    """A model at its least squares, with gradient and Hessian of the loss of each run.

    Residuals are in units of the noise; the loss is half their sum of squares plus the prior of the
    parameters, which is shared out to the runs evenly.
    """

    values: Float[Array, " flat"]
    loss: Float[Array, " runs"]
    gradient: Float[Array, "runs free"]
    hessian: Float[Array, "runs free free"]
    adhesion: Float[Array, "runs points"]  # as predicted
    residual: Float[Array, "runs points"]  # prediction less data, whitened
    jacobian: Float[Array, "free runs points"]  # of the prediction, whitened
    steps: Int[Array, ""]


class _Step(NamedTuple):
    """The best values found so far; loss, gradient and Hessian are sums over all runs."""

    values: Float[Array, " flat"]
    loss: Float[Array, ""]
    gradient: Float[Array, " free"]
    hessian: Float[Array, "free free"]
    adhesion: Float[Array, "runs points"]
    residual: Float[Array, "runs points"]
    jacobian: Float[Array, "free runs points"]
    steps: Int[Array, ""]


@kept()
def fit(
    model: Model,
    data: Data,
    white: Whitening,
    near: Float[Any, ""],
) -> Solution:
    """The least squares of a model from its values.

    The fit ends where the next step promises to lower the loss by less than the share `near` of it,
    where several successive steps lower it by less, or after a fixed number of steps.
    """
    runs, points = data.slip.shape

    def next_trial(best: _Step, damping: Array) -> tuple[Array, Array]:
        """The values after the next step, and the share of the loss that it promises to remove."""
        at, hessian, gradient = best.values[model.free], best.hessian, best.gradient
        held = ((at <= model.lower) & (gradient > 0)) | ((at >= model.upper) & (gradient < 0))
        damped = hessian + damping * jnp.diag(jnp.diag(hessian))

        def within_bounds(_turn: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
            """Parameters that reached a bound stay there; the step of the others is solved anew."""
            step, loose = found
            kept = jnp.where(loose, 0.0, step)
            scale = jnp.where(loose, 1.0, 0.0)
            matrix = damped * scale[:, None] * scale + jnp.diag(1.0 - scale)
            step = kept - jnp.linalg.solve(matrix, scale * (gradient + hessian @ kept))
            moved = jnp.clip(step, model.lower - at, model.upper - at)
            return moved, loose & (moved == step)

        start = jnp.zeros_like(at), ~held & (jnp.diag(hessian) > 0)
        step, _ = jax.lax.fori_loop(0, _CUT_OFF, within_bounds, start)
        moved = jnp.clip(at + step, model.lower, model.upper)
        promised = -(step @ gradient + 0.5 * step @ hessian @ step)
        trial = best.values.at[model.free].set(moved).at[-1].set(0.0)
        return trial, promised / jnp.maximum(best.loss, 1e-300)

    # The model is evaluated in this one place: most of the time of a first search is compiling it.
    def body(state: tuple) -> tuple:
        best, trial, promised, damping, least, crawled = state
        adhesion, residual, jacobian = with_jacobian(model, data, white, trial)
        flat = jacobian.reshape(jacobian.shape[0], -1)
        pull = model.precision @ trial[model.free]
        new = _Step(
            trial,
            0.5 * (jnp.sum(residual**2) + trial[model.free] @ pull),
            flat @ residual.ravel() + pull,
            flat @ flat.T + model.precision,
            adhesion,
            residual,
            jacobian,
            best.steps,
        )
        better = new.loss < best.loss
        kept = best.loss - new.loss > _AS_PROMISED * promised * best.loss
        eased = jnp.maximum(damping * jnp.where(kept, _EASED_AS_PROMISED, _EASED), _LEAST_DAMPING)
        # After a failure the damping falls by no more than half a step.
        raised = jnp.maximum(damping, _RETRIED) * _RAISED
        least = jnp.where(better, 0.5 * least, raised)
        damping = jnp.where(better, jnp.maximum(eased, least), raised)
        little = best.loss - new.loss < near * best.loss
        crawled = jnp.where(better, jnp.where(little, crawled + 1, 0), crawled)
        best = jax.tree.map(lambda n, o: jnp.where(better, n, o), new, best)
        best = best._replace(steps=best.steps + 1)
        return best, *next_trial(best, damping), damping, least, crawled

    def unfinished(state: tuple) -> Bool[Array, ""]:
        # A step that stops at a bound may promise a rise, one of a singular matrix is not a number:
        # neither is the end.
        best, _, promised, _, _, crawled = state
        arrived = ((promised >= 0) & (promised < near)) | (crawled >= _CRAWLING)
        return ~arrived & (best.steps < _STEPS)

    free = model.free.size
    nothing = _Step(
        model.values,
        jnp.asarray(jnp.inf),
        jnp.zeros(free),
        jnp.zeros((free, free)),
        jnp.zeros((runs, points)),
        jnp.zeros((runs, points)),
        jnp.zeros((free, runs, points)),
        jnp.asarray(0),
    )
    first = jnp.asarray(_FIRST_DAMPING)
    start = (
        *(nothing, model.values, jnp.asarray(jnp.inf)),
        *(first, jnp.asarray(0.0), jnp.asarray(0)),
    )
    best = jax.lax.while_loop(unfinished, body, start)[0]
    some = jnp.any(white.weight > 0, axis=1)
    share = some / jnp.maximum(jnp.sum(some), 1)
    at = best.values[model.free]
    pull = model.precision @ at
    found = 0.5 * (jnp.sum(best.residual**2, axis=1) + share * (at @ pull))
    gradient = jnp.einsum("krt,rt->rk", best.jacobian, best.residual)
    hessian = jnp.einsum("krt,lrt->rkl", best.jacobian, best.jacobian)
    return Solution(
        best.values,
        jnp.where(jnp.isfinite(best.loss), found, jnp.inf),
        gradient + share[:, None] * pull,
        hessian + share[:, None, None] * model.precision,
        best.adhesion,
        best.residual,
        best.jacobian,
        best.steps,
    )
