"""One program for every model, a curve and slots for effects of any kind, and its least squares."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from adhesion_jax.curves import BASES, Conditions, Curve, with_free_values
from adhesion_jax.curves.bent import BELOW_EFFECTS, functions
from adhesion_jax.discovery.model.packing import Model, layout, parts, words_of
from adhesion_jax.discovery.model.problem import Data
from adhesion_jax.effects import KINDS
from adhesion_jax.effects.shape import ACTS_ON, fallen, peak_slips
from adhesion_jax.optim.levenberg_marquardt import Local, Search, advance, arrived, begin
from adhesion_jax.programs import kept

#: `changes` takes this many models at a time, whatever their number: one program for all data.
PROBES = 16

#: Largest number of steps of a fit.
_STEPS = 400

#: Number of parameters whose derivatives are taken together, sharing the transcendental functions;
#: the numbers of parameters of the program's sizes are multiples of it.
_TOGETHER = 24


def _adhesion(
    model: Model, span: Array, slip: Array, conditions: Conditions, columns: Array, peak: Array
) -> Float[Array, " points"]:
    """The prediction of a model for one run, equal to that of `law.with_effects`."""
    kind, places = model.kind, layout()
    if not kind.size:
        return _curve(model, span, slip, conditions)
    parameters = model.values[places.base : -1].reshape(kind.size, places.effect)
    # The loops end at the last effect: empty slots take no time.
    used = jnp.max(jnp.where(kind > 0, jnp.arange(kind.size) + 1, 0))

    def acting(
        names: Sequence[str],
        slot: Array,
        acts: Callable[[Any, Conditions, Array], Array],
        value: Array,
    ) -> Array:
        """What the effect in a slot makes of a value, if it is one of these; else the value."""

        def branch(name: str) -> Callable[[Array], Array]:
            def act(value: Array) -> Array:
                named, own = KINDS[name], parameters[slot]
                numbers = {key: own[place] for place, key in enumerate(named.FACTS.parameters)}
                words = dict(zip(words_of(named), ("first", "second"), strict=False))
                effect: Any = named(**numbers, **words)
                first, second = (columns[model.column[slot, place]] for place in (0, 1))
                return acts(effect, {**conditions, "first": first, "second": second}, value)

            return act

        which = layout().branches(names)[kind[slot]]
        return jax.lax.switch(which, [lambda value: value, *map(branch, names)], value)

    def shape(slot: Array, sums: Array) -> Array:
        nothing = jnp.zeros_like(slip)
        # A constant has no shape of its own.
        own = acting(places.shapes, slot, lambda one, seen, to: to + one.log_factor(seen), nothing)
        return sums.at[model.column[slot, 2]].add(own)

    def before(turn: Array, bent: Array) -> Array:
        slot = used - 1 - turn
        return acting(places.bending, slot, lambda one, seen, bent: one.before(bent, seen), bent)

    def after(slot: Array, adhesion: Array) -> Array:
        return acting(
            places.causes, slot, lambda one, seen, mu: one.after(mu, slip, seen), adhesion
        )

    def curve(slip: Array) -> Array:
        return _curve(model, span, slip, conditions)

    sums = jax.lax.fori_loop(0, used, shape, jnp.zeros((len(ACTS_ON), slip.size)))
    level, stretch, fall, offset, shift = sums
    bent = jax.lax.fori_loop(0, used, before, slip) * jnp.exp(stretch) + shift
    adhesion = jax.lax.cond(
        _falls(model),
        lambda adhesion: fallen(curve, bent, adhesion, fall, peak),
        lambda plain: plain,
        curve(bent),
    )
    return jax.lax.fori_loop(0, used, after, adhesion * jnp.exp(level) + offset)


def _curve(model: Model, span: Array, slip: Array, conditions: Conditions) -> Array:
    """The prediction of the curve without effects, for each point; `slip` may be one for all."""
    departure = _departures(slip, _factors(model.values), span)
    bend = departure[..., 0] + jnp.where(slip < 0, departure[..., 1], 0.0)
    return _straight(model, slip, conditions) * (1 + bend)


def _straight(model: Model, slip: Array, conditions: Conditions) -> Array:
    """The prediction of the curve without effects and without its departure."""
    shape = jnp.broadcast_shapes(slip.shape, *map(jnp.shape, conditions.values()))

    def branch(curve: Curve) -> Callable[[Array], Array]:
        return lambda slip: with_free_values(curve, model.values[: len(curve.free)])(
            jnp.broadcast_to(slip, shape), conditions
        )

    return jax.lax.switch(model.base, [branch(curve) for curve in BASES.values()], slip)


def _factors(values: Array) -> Float[Array, "two functions"]:
    return values[layout().curve : layout().base].reshape(2, BELOW_EFFECTS)


@jax.custom_jvp
def _departures(
    slip: Float[Array, "*shape"], factors: Float[Array, "two functions"], span: Float[Array, " two"]
) -> Float[Array, "*shape two"]:
    """The departure, and what braking adds to it."""
    return functions(slip, span[0], span[1], BELOW_EFFECTS) @ factors.T


@_departures.defjvp
def _(
    primals: tuple[Array, Array, Array], tangents: tuple[Array, Array, Array]
) -> tuple[Array, Array]:
    """With the slopes over slip summed before they meet a tangent.

    A tangent of the slip has then one product a point and not one for each function, which took
    four fifths of the time of a fit.
    """
    slip, factors, span = primals
    along, of_factors, _ = tangents
    shape, slopes = jax.jvp(
        lambda slip: functions(slip, span[0], span[1], BELOW_EFFECTS),
        (slip,),
        (jnp.ones_like(slip),),
    )
    change = (slopes @ factors.T) * along[..., None] + shape @ of_factors.T
    return shape @ factors.T, change


def _falls(models: Model) -> Bool[Array, ""]:
    """Whether a term acts on the fall of the curve, of one model or of any of several."""
    return jnp.any((models.kind > 0) & (models.column[..., 2] == ACTS_ON.index("fall")))


def _peaks(
    model: Model, data: Data, asked: Bool[Array, ""], others: Float[Array, "runs points"]
) -> Float[Array, "runs points"]:
    """The slip of the curve's peak if it is asked for, else the others."""
    return jax.lax.cond(
        asked,
        lambda _: peak_slips(
            lambda slip: _curve(model, data.span, slip, data.conditions), data.slip
        ),
        lambda others: others,
        others,
    )


def _predict(
    model: Model, data: Data, peaks: Float[Array, "runs points"]
) -> Float[Array, "runs points"]:
    run = partial(_adhesion, model, data.span)
    return jax.vmap(run, in_axes=(0, 0, 1, 0))(data.slip, data.conditions, data.columns, peaks)


def _with_jacobian(
    model: Model, data: Data, root: Float[Array, "runs points"]
) -> tuple[Array, Array, Array]:
    """Prediction, residual, and Jacobian [free, runs, points], the last two times `root`."""
    if not model.kind.size:
        adhesion, jacobian = _of_curve_alone(model, data)
        return adhesion, root * (adhesion - data.adhesion), root * jacobian
    peaks = _peaks(model, data, _falls(model), jnp.full_like(data.slip, jnp.inf))
    values = model.values

    def push(tangent: Array) -> tuple[Array, Array]:
        adhesion, change = jax.jvp(
            lambda v: _predict(model._replace(values=v), data, peaks), (values,), (tangent,)
        )
        return adhesion, root * change

    def some(turn: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
        first = turn * _TOGETHER
        places = jax.lax.dynamic_slice_in_dim(model.free, first, _TOGETHER)
        tangents = jax.nn.one_hot(places, values.size)
        adhesion, changes = jax.vmap(push, out_axes=(None, 0))(tangents)
        return adhesion, jax.lax.dynamic_update_slice_in_dim(found[1], changes, first, 0)

    # Some parameters at a time, so that the arrays stay in the cache, and without the padding.
    free = jnp.sum(model.free != values.size - 1)
    nothing = jnp.zeros_like(data.slip), jnp.zeros((model.free.size, *data.slip.shape))
    adhesion, jacobian = jax.lax.fori_loop(0, -(-free // _TOGETHER), some, nothing)
    return adhesion, root * (adhesion - data.adhesion), jacobian


def _of_curve_alone(model: Model, data: Data) -> tuple[Array, Array]:
    """Prediction and Jacobian of a curve without effects, linear in the factors of a departure."""
    count = layout().curve
    straight, push = jax.linearize(
        lambda v: _straight(model._replace(values=v), data.slip, data.conditions),
        model.values[:count],
    )
    shape = jnp.moveaxis(functions(data.slip, data.span[0], data.span[1], BELOW_EFFECTS), -1, 0)
    both = jnp.stack([shape, jnp.where(data.slip < 0, shape, 0.0)])
    bent = 1 + jnp.einsum("bk,bkrt->rt", _factors(model.values), both)
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
    falls = _falls(models)

    def change(place: Array, known: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        found, before, peaks = known
        model = jax.tree.map(lambda leaf: leaf[place], models)
        # Models of one curve share its peak, which takes longer than all the rest.
        curve = model.values[: layout().base]
        peaks = _peaks(model, data, falls & jnp.any(curve != before), peaks)
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
