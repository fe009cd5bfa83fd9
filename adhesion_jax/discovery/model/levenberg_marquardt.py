"""Weighted least squares of a model: Levenberg-Marquardt inside the bounds, as one program."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from adhesion_jax.discovery.model.packing import Model, parts
from adhesion_jax.discovery.model.program import Data, with_jacobian
from adhesion_jax.optim.levenberg_marquardt import Local, Search, advance, arrived, begin
from adhesion_jax.programs import kept

#: Largest number of steps.
_STEPS = 400


class RunsFit(NamedTuple):
    """A model at its least squares, with gradient and Hessian of the loss of each run.

    Residuals are in units of their noise, `root` its reciprocal; the loss is half their sum of
    squares plus the prior of the parameters, which is shared out to the runs evenly.
    """

    values: Float[Array, " flat"]
    loss: Float[Array, " runs"]
    gradient: Float[Array, "runs free"]
    hessian: Float[Array, "runs free free"]
    adhesion: Float[Array, "runs points"]  # as predicted
    residual: Float[Array, "runs points"]  # prediction less data, in units of the noise
    jacobian: Float[Array, "free runs points"]  # of the prediction, likewise
    steps: Int[Array, ""]


@kept(reads=parts)
def fit(
    model: Model,
    data: Data,
    root: Float[Any, "runs points"],
    near: Float[Any, ""],
) -> RunsFit:
    """The least squares of a model from its values.

    The fit ends where the next step promises to lower the loss by less than the share `near` of it,
    where several successive steps lower it by less, or after a fixed number of steps.
    """

    def evaluated(at: Float[Array, " free"]) -> Local:
        values = model.values.at[model.free].set(at).at[-1].set(0.0)
        adhesion, residual, jacobian = with_jacobian(model, data, root, values)
        flat = jacobian.reshape(jacobian.shape[0], -1)
        pull = model.precision @ at
        return Local(
            0.5 * (jnp.sum(residual**2) + at @ pull),
            flat @ residual.ravel() + pull,
            flat @ flat.T + model.precision,
            (adhesion, residual, jacobian),
        )

    def unfinished(search: Search) -> Bool[Array, ""]:
        return ~arrived(search, near) & (search.steps < _STEPS)

    def one_step(search: Search) -> Search:
        return advance(evaluated, search, model.lower, model.upper, near)

    zero = jnp.zeros_like(data.slip)
    rest = zero, zero, jnp.zeros((model.free.size, *zero.shape))
    start = begin(model.values[model.free], rest)
    best = jax.lax.while_loop(unfinished, one_step, start)
    adhesion, residual, jacobian = best.local.rest
    some = jnp.any(root > 0, axis=1)
    share = some / jnp.maximum(jnp.sum(some), 1)
    pull = model.precision @ best.x
    found = 0.5 * (jnp.sum(residual**2, axis=1) + share * (best.x @ pull))
    gradient = jnp.einsum("krt,rt->rk", jacobian, residual)
    hessian = jnp.einsum("krt,lrt->rkl", jacobian, jacobian)
    return RunsFit(
        model.values.at[model.free].set(best.x).at[-1].set(0.0),
        jnp.where(jnp.isfinite(best.local.loss), found, jnp.inf),
        gradient + share[:, None] * pull,
        hessian + share[:, None, None] * model.precision,
        adhesion,
        residual,
        jacobian,
        best.steps,
    )
