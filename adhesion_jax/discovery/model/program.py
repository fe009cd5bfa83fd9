"""One program for every model, a curve and slots for effects of any kind, and its least squares."""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from adhesion_jax.curves import Conditions
from adhesion_jax.curves.bent import BELOW_EFFECTS, functions
from adhesion_jax.discovery.model.packing import Model, layout, parts
from adhesion_jax.discovery.model.problem import Data
from adhesion_jax.discovery.model.stages import (
    ADDED,
    AT_PEAK,
    AT_SLIP,
    OF_SLIP,
    OF_SUMS,
    curve_of,
    factors_of,
    falls,
    stages_of,
    straight_of,
)
from adhesion_jax.effects.shape import peak_slips
from adhesion_jax.optim.levenberg_marquardt import Local, Search, advance, arrived, begin
from adhesion_jax.programs import kept

#: `changes` takes this many models at a time, whatever their number: one program for all data.
PROBES = 16

#: Largest number of steps of a fit.
_STEPS = 400

#: Number of parameters whose derivatives are taken together, of all causes and of one term. The
#: numbers of free parameters of the programs are multiples of the first.
_TOGETHER, _OF_TERM = 24, 6


def _adhesion(
    model: Model, span: Array, slip: Array, conditions: Conditions, columns: Array, peak: Array
) -> Float[Array, " points"]:
    """The prediction of a model for one run."""
    if not model.kind.size:
        return curve_of(model, span, slip, conditions)
    stages, values = stages_of(model, span, slip, conditions, columns, peak), model.values
    adhesion = stages.contact(values, stages.bent(values), stages.sums(values), jnp.zeros(ADDED))
    return stages.caused(values, adhesion)


def _peaks(
    model: Model, data: Data, asked: Bool[Array, ""], others: Float[Array, "runs points"]
) -> Float[Array, "runs points"]:
    """The slip of the curve's peak if it is asked for, else the others."""
    return jax.lax.cond(
        asked,
        lambda _: peak_slips(
            lambda slip: curve_of(model, data.span, slip, data.conditions), data.slip
        ),
        lambda others: others,
        others,
    )


def _over_runs(
    of_run: Callable[..., Any], model: Model, data: Data, peaks: Float[Array, "runs points"]
) -> Any:
    run = partial(of_run, model, data.span)
    return jax.vmap(run, in_axes=(0, 0, 1, 0))(data.slip, data.conditions, data.columns, peaks)


def _predict(
    model: Model, data: Data, peaks: Float[Array, "runs points"]
) -> Float[Array, "runs points"]:
    return _over_runs(_adhesion, model, data, peaks)


def _with_jacobian(
    model: Model, data: Data, root: Float[Array, "runs points"]
) -> tuple[Array, Array, Array]:
    """Prediction, residual, and Jacobian [free, runs, points], the last two times `root`."""
    if not model.kind.size:
        adhesion, jacobian = _of_curve_alone(model, data)
        return adhesion, root * (adhesion - data.adhesion), root * jacobian
    peaks = _peaks(model, data, falls(model), jnp.full_like(data.slip, jnp.inf))
    adhesion, jacobian = _over_runs(_of_run, model, data, peaks)
    jacobian = jnp.moveaxis(jacobian, 1, 0)
    return adhesion, root * (adhesion - data.adhesion), root * jacobian


def _of_run(
    model: Model, span: Array, slip: Array, conditions: Conditions, columns: Array, peak: Array
) -> tuple[Array, Array]:
    """Prediction and Jacobian [free, points] of one run.

    Adhesion in the contact depends on most parameters through the departure at two slips and
    through the sums of the terms of the shape alone. Its derivatives by these are taken once, and
    those of a departure or a term by its own parameters are cheap.
    """
    stages = stages_of(model, span, slip, conditions, columns, peak)
    values, free, places = model.values, model.free, layout()
    sums, bent = stages.sums(values), stages.bent(values)

    def contact(curve: Array, added: Array) -> Array:
        return stages.contact(values.at[: places.curve].set(curve), bent, sums, added)

    def along(of_curve: Array, of_added: Array) -> tuple[Array, Array]:
        here = values[: places.curve], jnp.zeros(ADDED)
        return jax.jvp(contact, here, (of_curve, of_added))

    units = jnp.split(jnp.eye(places.curve + ADDED), [places.curve], axis=1)
    adhesion, slopes = jax.vmap(along, out_axes=(None, 0))(*units)
    by_curve, by_added = slopes[: places.curve], slopes[places.curve :]
    at = stages.at(bent, sums)
    shape, at_peak = (
        functions(some, span[0], span[1], BELOW_EFFECTS).T
        for some in (at, jnp.minimum(peak, span[1]))
    )
    of_traction = by_added[AT_SLIP] * shape
    by_factors = of_traction + by_added[AT_PEAK] * at_peak, jnp.where(at < 0, of_traction, 0.0)
    of_base = jnp.concatenate([by_curve, *by_factors])
    first = free[: places.base]
    of_base = jnp.where((first < places.base)[:, None], of_base[first.clip(max=places.base - 1)], 0)
    # A loop may write some rows too many, which the next one or the end overwrites.
    rows = jnp.zeros((free.size + _OF_TERM, slip.size)).at[: places.base].set(of_base)
    free = jnp.pad(free, (0, _OF_TERM), constant_values=values.size - 1)

    def steps_of(first: Array, count: int) -> Array:
        return jax.nn.one_hot(jax.lax.dynamic_slice_in_dim(free, first, count), values.size)

    def of_slot(slot: Array, rows: Array) -> Array:
        begin = places.base + slot * places.effect
        own = (free >= begin) & (free < begin + places.effect)
        by_sum = by_added[OF_SUMS + model.column[slot, 2]]

        def some(turn: Array, rows: Array) -> Array:
            first = jnp.argmax(own) + turn * _OF_TERM

            def moved(step: Array) -> Array:
                _, of_term = jax.jvp(lambda values: stages.term(values, slot), (values,), (step,))
                _, of_slip = jax.jvp(stages.bent, (values,), (step,))
                return by_sum * of_term + by_added[OF_SLIP] * of_slip

            found = jax.vmap(moved)(steps_of(first, _OF_TERM))
            return jax.lax.dynamic_update_slice_in_dim(rows, found, first, 0)

        return jax.lax.fori_loop(0, -(-jnp.sum(own) // _OF_TERM), some, rows)

    def through(turn: Array, rows: Array) -> Array:
        """Some rows after the causes that act on the adhesion."""
        first = turn * _TOGETHER

        def moved(step: Array, row: Array) -> Array:
            return jax.jvp(stages.caused, (values, adhesion), (step, row))[1]

        some = jax.lax.dynamic_slice_in_dim(rows, first, _TOGETHER)
        found = jax.vmap(moved)(steps_of(first, _TOGETHER), some)
        return jax.lax.dynamic_update_slice_in_dim(rows, found, first, 0)

    rows = jax.lax.fori_loop(0, stages.used, of_slot, rows)[: model.free.size]
    turns = -(-jnp.sum(free != values.size - 1) // _TOGETHER)
    rows = jax.lax.fori_loop(0, jnp.where(stages.acts, turns, 0), through, rows)
    return stages.caused(values, adhesion), rows


def _of_curve_alone(model: Model, data: Data) -> tuple[Array, Array]:
    """Prediction and Jacobian of a curve without effects, linear in the factors of a departure."""
    count = layout().curve
    straight, push = jax.linearize(
        lambda v: straight_of(model._replace(values=v), data.slip, data.conditions),
        model.values[:count],
    )
    shape = jnp.moveaxis(functions(data.slip, data.span[0], data.span[1], BELOW_EFFECTS), -1, 0)
    both = jnp.stack([shape, jnp.where(data.slip < 0, shape, 0.0)])
    bent = 1 + jnp.einsum("bk,bkrt->rt", factors_of(model.values), both)
    of_curve = bent * jax.vmap(push)(jnp.eye(count))
    of_factors = straight * both.reshape(-1, *data.slip.shape)
    padding = jnp.zeros((1, *data.slip.shape))
    jacobian = jnp.concatenate([of_curve, of_factors, padding])[model.free]
    return straight * bent, jacobian


@kept(reads=parts)
def changes(
    models: Model, count: Int[Any, ""], data: Data, now: Array
) -> Float[Array, "models runs points"]:
    """The predictions of the first `count` of the models, less the prediction `now`; then zeros."""
    falling = falls(models)

    def change(place: Array, known: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        found, before, peaks = known
        model = jax.tree.map(lambda leaf: leaf[place], models)
        # Models of one curve share its peak, which takes longer than all the rest.
        curve = model.values[: layout().base]
        peaks = _peaks(model, data, falling & jnp.any(curve != before), peaks)
        return found.at[place].set(_predict(model, data, peaks) - now), curve, peaks

    nothing = jnp.zeros((PROBES, *now.shape))
    none, far = jnp.full(layout().base, jnp.nan), jnp.full_like(data.slip, jnp.inf)
    return jax.lax.fori_loop(0, count, change, (nothing, none, far))[0]


@kept(reads=parts)
def fit(
    model: Model,
    data: Data,
    root: Float[Any, "runs points"],
    near: Float[Any, ""],
) -> tuple[Array, ...]:
    """The least squares of a model from its values, by Levenberg and Marquardt inside the bounds.

    The loss is half the sum of squares of the residuals in units of the noise, `root` its
    reciprocal, plus the prior of the parameters, which is shared out to the runs evenly. Returns
    the values, then loss, gradient, Hessian, adhesion, residual and Jacobian as `Fitted` has them.

    The fit ends where the next step promises to lower the loss by less than the share `near` of it,
    where several successive steps lower it by less, or after a fixed number of steps.
    """

    def evaluated(at: Float[Array, " free"]) -> Local:
        values = model.values.at[model.free].set(at).at[-1].set(0.0)
        adhesion, residual, jacobian = _with_jacobian(model._replace(values=values), data, root)
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
    return (
        model.values.at[model.free].set(best.x).at[-1].set(0.0),
        jnp.where(jnp.isfinite(best.local.loss), found, jnp.inf),
        gradient + share[:, None] * pull,
        hessian + share[:, None, None] * model.precision,
        adhesion,
        residual,
        jacobian,
    )
