"""One compiled program for every model: a curve and some slots, each of which any effect may fill.

Which curve and which effects are numbers to the program, so that hundreds of candidate models are
fitted without compiling one of them anew. Models are padded to a number of slots, their free
parameters to a number of columns of the Jacobian; what is padded is held.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from adhesion_jax.curves import BASES, Conditions, Curve, with_free_values
from adhesion_jax.discovery.model.noise import Whitening, whitened
from adhesion_jax.effects import KINDS, Effect, ShapeTerm
from adhesion_jax.effects.shape import ACTS_ON, fallen, peak_slips, prior_precision
from adhesion_jax.effects.slip_noise import SlipNoise

#: `changes` takes this many models at a time, so that every campaign uses the same program.
PROBES = 16

_BASE_SIZE = max(len(curve.free) for curve in BASES.values())
_EFFECT_SIZE = max(len(kind.PARAMETERS) for kind in KINDS.values())
_NAMES = tuple(KINDS)

# Each effect has one of three branches; what is not written out need not be compiled. The slip is
# corrected for its noise before it is handed to a program.
_SHAPES = tuple(name for name in _NAMES if issubclass(KINDS[name], ShapeTerm))
_CAUSES = tuple(name for name in _NAMES if name not in _SHAPES and KINDS[name] is not SlipNoise)
_BENDING = tuple(name for name in _CAUSES if KINDS[name].ORDER == 0)


_PLACES = {kind: place for place, kind in enumerate(KINDS.values())}


@cache
def words_of(kind: type[Effect]) -> tuple[str, ...]:
    """The fields of an effect that name columns."""
    names = (field.name for field in dataclasses.fields(kind))
    return tuple(name for name in names if name not in (*kind.PARAMETERS, "acts_on"))


def _branches(names: Sequence[str]) -> Array:
    """By kind, the place of a branch; 0 for none."""
    return jnp.asarray([0, *(names.index(name) + 1 if name in names else 0 for name in _NAMES)])


#: Levenberg-Marquardt: largest number of steps.
_STEPS = 40

#: The damping at first, at least, and at least where a step has failed; the share of what was
#: promised from which on the loss is taken for quadratic.
_FIRST_DAMPING, _LEAST_DAMPING, _RETRIED, _AS_PROMISED = 1e-2, 1e-12, 1e-4, 0.9

#: In each step so many turns to find which parameters stop at a bound.
_CUT_OFF = 4

#: So many steps in succession that bring next to nothing are the end, whatever the next promises.
_CRAWLING = 3

# Parameters whose derivatives are taken together: these share the transcendental functions.
_TOGETHER = 8

# Compiling takes longer than running; by the older emitters it takes two thirds as long, and the
# program runs as fast.
_QUICKLY = {"xla_cpu_use_fusion_emitters": False}


# Arrays of NumPy before they go into a program, of jax inside.


class Data(NamedTuple):
    """The runs of a campaign, padded; conditions hold every column that any effect needs."""

    slip: Float[Any, "runs points"]
    adhesion: Float[Any, "runs points"]
    conditions: Mapping[str, Float[Any, "runs points"]]
    columns: Float[Any, "columns runs points"]  # what a column of its own may act through


class Model(NamedTuple):
    """A curve and its effects as numbers, in the order in which effects are applied."""

    base: Int[Any, ""]
    values: Float[Any, " flat"]  # curve, then slots, then one that nothing reads
    kind: Int[Any, " slots"]  # 0: empty, else 1 + place in KINDS
    column: Int[Any, "slots three"]  # two places in Data.columns, and one of ACTS_ON
    free: Int[Any, " free"]  # places in `values`; padded with the last
    lower: Float[Any, " free"]
    upper: Float[Any, " free"]
    precision: Float[Any, "free free"]  # of the prior of the free parameters, about zero


class Fit(NamedTuple):
    """A model at its least squares, and what each run says of its neighbourhood.

    In units of the noise; hessian and gradient are those of the loss. What the prior adds is shared
    out to the runs evenly.
    """

    values: Float[Array, " flat"]
    loss: Float[Array, " runs"]  # half the sum of squares of each run
    gradient: Float[Array, "runs free"]
    hessian: Float[Array, "runs free free"]
    adhesion: Float[Array, "runs points"]  # as predicted
    residual: Float[Array, "runs points"]  # prediction less data, whitened
    jacobian: Float[Array, "free runs points"]  # of the prediction, whitened
    steps: Int[Array, ""]


class _Step(NamedTuple):
    """A model on its way to the least squares, sums taken over all runs."""

    values: Float[Array, " flat"]
    loss: Float[Array, ""]
    gradient: Float[Array, " free"]
    hessian: Float[Array, "free free"]
    adhesion: Float[Array, "runs points"]
    residual: Float[Array, "runs points"]
    jacobian: Float[Array, "free runs points"]
    steps: Int[Array, ""]


def base_places(base: str) -> range:
    """Where the parameters of a curve stand in `Model.values`."""
    return range(len(BASES[base].free))


def effect_places(slot: int, effect: Effect) -> Mapping[str, int]:
    """Where the parameters of an effect stand that are found rather than given."""
    start = _BASE_SIZE + slot * _EFFECT_SIZE
    return {
        name: start + place
        for place, name in enumerate(effect.PARAMETERS)
        if name not in effect.REFERENCES
    }


def pack(
    base: str,
    base_values: Sequence[float],
    effects: Sequence[Effect],
    columns: Sequence[str],
    slots: int,
    free: int,
) -> Model:
    """The model as numbers; effects must come in the order of their ORDER."""
    values = np.zeros(_BASE_SIZE + slots * _EFFECT_SIZE + 1)
    values[: len(base_values)] = base_values
    kind, column = np.zeros(slots, int), np.zeros((slots, 3), int)
    precision = np.zeros((free, free))
    places = list(base_places(base))
    described = [BASES[base].PARAMETERS[name] for name in BASES[base].free]
    lower, upper = [one.lower for one in described], [one.upper for one in described]
    for slot, effect in enumerate(effects):
        kind[slot] = 1 + _PLACES[type(effect)]
        named = [getattr(effect, name) for name in words_of(type(effect))]
        column[slot, : len(named)] = [columns.index(name) for name in named]
        if isinstance(effect, ShapeTerm):
            column[slot, 2] = ACTS_ON.index(effect.acts_on)
        start = _BASE_SIZE + slot * _EFFECT_SIZE
        numbers = [float(getattr(effect, name)) for name in effect.PARAMETERS]
        values[start : start + len(numbers)] = numbers
        for name, place in effect_places(slot, effect).items():
            places.append(place)
            lower.append(effect.PARAMETERS[name].lower)
            upper.append(effect.PARAMETERS[name].upper)
        if isinstance(effect, ShapeTerm):
            held = [places.index(effect_places(slot, effect)[name]) for name in effect.STRENGTHS]
            precision[np.ix_(held, held)] = prior_precision(type(effect))
    padding = free - len(places)
    return Model(
        np.asarray(list(BASES).index(base)),
        values,
        kind,
        column,
        np.array([*places, *[values.size - 1] * padding]),
        np.array([*lower, *[0.0] * padding]),
        np.array([*upper, *[0.0] * padding]),
        precision,
    )


def unpack(values: np.ndarray, effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects with the parameters of a fit."""
    found = []
    for slot, effect in enumerate(effects):
        start = _BASE_SIZE + slot * _EFFECT_SIZE
        numbers = dict(zip(effect.PARAMETERS, values[start:].tolist(), strict=False))
        found.append(dataclasses.replace(effect, **numbers))
    return tuple(found)


def base_curve(base: str, values: np.ndarray) -> Curve:
    """The curve with the parameters of a fit."""
    curve = BASES[base]
    return dataclasses.replace(curve, **dict(zip(curve.free, values.tolist(), strict=False)))


def _adhesion(
    base: Array,
    values: Array,
    kind: Array,
    column: Array,
    slip: Array,
    conditions: Conditions,
    columns: Array,
    peak: Array,
) -> Float[Array, " points"]:
    """The prediction of a model for one run, as `law.with_effects` has it for named effects."""
    slots = values[_BASE_SIZE:-1].reshape(kind.size, _EFFECT_SIZE)

    def effect(name: str, parameters: Array) -> Any:
        named = KINDS[name]
        numbers = {key: parameters[place] for place, key in enumerate(named.PARAMETERS)}
        return named(**numbers, **dict(zip(words_of(named), ("first", "second"), strict=False)))

    def seen(slot: Array) -> Conditions:
        return {
            **conditions,
            "first": columns[column[slot, 0]],
            "second": columns[column[slot, 1]],
        }

    # As many turns as there are effects: empty slots at the end take no time.
    used = jnp.max(jnp.where(kind > 0, jnp.arange(kind.size) + 1, 0))

    def shape(slot: Array, sums: Array) -> Array:
        branches = [lambda: jnp.zeros_like(slip)] + [
            partial(lambda name: effect(name, slots[slot]).log_factor(seen(slot)), name=name)
            for name in _SHAPES
        ]
        term = jax.lax.switch(_branches(_SHAPES)[kind[slot]], branches)
        return sums.at[column[slot, 2]].add(term)

    def before(turn: Array, bent: Array) -> Array:
        slot = used - 1 - turn
        branches = [lambda bent: bent] + [
            partial(
                lambda bent, name: effect(name, slots[slot]).before(bent, seen(slot)), name=name
            )
            for name in _BENDING
        ]
        return jax.lax.switch(_branches(_BENDING)[kind[slot]], branches, bent)

    def after(slot: Array, adhesion: Array) -> Array:
        branches = [lambda adhesion: adhesion] + [
            partial(
                lambda adhesion, name: effect(name, slots[slot]).after(adhesion, slip, seen(slot)),
                name=name,
            )
            for name in _CAUSES
        ]
        return jax.lax.switch(_branches(_CAUSES)[kind[slot]], branches, adhesion)

    def curve(slip: Array) -> Array:
        return _curve(base, values, slip, conditions)

    level, stretch, fall = jax.lax.fori_loop(0, used, shape, jnp.zeros((3, slip.size)))
    bent = jax.lax.fori_loop(0, used, before, slip) * jnp.exp(stretch)
    adhesion = jax.lax.cond(
        _falls(kind, column),
        lambda adhesion: fallen(curve, bent, adhesion, fall, peak),
        lambda plain: plain,
        curve(bent),
    )
    return jax.lax.fori_loop(0, used, after, adhesion * jnp.exp(level))


def _curve(base: Array, values: Array, slip: Array, conditions: Conditions) -> Array:
    """The curve alone."""
    branches = [
        partial(
            lambda slip, curve: with_free_values(curve, values[: len(curve.free)])(
                slip, conditions
            ),
            curve=curve,
        )
        for curve in BASES.values()
    ]
    return jax.lax.switch(base, branches, slip)


def _falls(kind: Array, column: Array) -> Bool[Array, ""]:
    """Whether a term acts on the fall."""
    return jnp.any((kind > 0) & (column[:, 2] == ACTS_ON.index("fall")))


def _peaks(model: Model, data: Data, values: Array) -> Float[Array, "runs points"]:
    """Where the curve has its peak, where a term acts on the fall beyond it."""
    return jax.lax.cond(
        _falls(model.kind, model.column),
        lambda slip: peak_slips(
            lambda slip: _curve(model.base, values, slip, data.conditions), slip
        ),
        lambda slip: jnp.full_like(slip, jnp.inf),
        data.slip,
    )


def _predict(
    model: Model, data: Data, values: Array, peaks: Float[Array, "runs points"]
) -> Float[Array, "runs points"]:
    def run(slip: Array, conditions: Conditions, columns: Array, peak: Array) -> Array:
        return _adhesion(
            model.base, values, model.kind, model.column, slip, conditions, columns, peak
        )

    return jax.vmap(run, in_axes=(0, 0, 1, 0))(data.slip, data.conditions, data.columns, peaks)


def _with_jacobian(
    model: Model, data: Data, white: Whitening, values: Array
) -> tuple[Array, Array, Array]:
    """Prediction, residual, and Jacobian [free, runs, points], the last two in noise units."""
    peaks = _peaks(model, data, values)

    def push(tangent: Array) -> tuple[Array, Array]:
        adhesion, change = jax.jvp(lambda v: _predict(model, data, v, peaks), (values,), (tangent,))
        return adhesion, whitened(white, change)

    def some(turn: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
        first = turn * _TOGETHER
        places = jax.lax.dynamic_slice_in_dim(model.free, first, _TOGETHER)
        tangents = jax.nn.one_hot(places, values.size)
        adhesion, changes = jax.vmap(push, out_axes=(None, 0))(tangents)
        return adhesion, jax.lax.dynamic_update_slice_in_dim(found[1], changes, first, 0)

    # Some parameters at a time, and no more than there are: what is at work stays in the cache.
    free = jnp.sum(model.free != values.size - 1)
    nothing = jnp.zeros_like(data.slip), jnp.zeros((model.free.size, *data.slip.shape))
    adhesion, jacobian = jax.lax.fori_loop(0, -(-free // _TOGETHER), some, nothing)
    return adhesion, whitened(white, adhesion - data.adhesion), jacobian


@partial(jax.jit, compiler_options=_QUICKLY)
def fit(
    model: Model,
    data: Data,
    white: Whitening,
    near: Float[Any, ""],
) -> Fit:
    """Least squares by Levenberg-Marquardt inside the bounds.

    It has arrived where the next step does not promise to lower the loss by more than the share
    `near` of it, or where several steps in succession have not.
    """
    runs, points = data.slip.shape

    def next_trial(best: _Step, damping: Array) -> tuple[Array, Array]:
        """Where the next step leads, and by which share of the loss it promises to lower it."""
        at, hessian, gradient = best.values[model.free], best.hessian, best.gradient
        held = ((at <= model.lower) & (gradient > 0)) | ((at >= model.upper) & (gradient < 0))
        damped = hessian + damping * jnp.diag(jnp.diag(hessian))

        def within_bounds(_turn: Array, found: tuple[Array, Array]) -> tuple[Array, Array]:
            """What the last turn cut off at a bound stays there; the others make up for it."""
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

    # The model is written out once, here: compiling it is what takes time.
    def body(state: tuple) -> tuple:
        best, trial, promised, damping, least, crawled = state
        adhesion, residual, jacobian = _with_jacobian(model, data, white, trial)
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
        # Where the loss falls as promised it is as good as quadratic, and needs no damping.
        kept = best.loss - new.loss > _AS_PROMISED * promised * best.loss
        eased = jnp.maximum(damping * jnp.where(kept, 1e-4, 0.2), _LEAST_DAMPING)
        # After a failure the damping is lowered in small steps only.
        raised = jnp.maximum(damping, _RETRIED) * 8
        least = jnp.where(better, 0.5 * least, raised)
        damping = jnp.where(better, jnp.maximum(eased, least), raised)
        little = best.loss - new.loss < near * best.loss
        crawled = jnp.where(better, jnp.where(little, crawled + 1, 0), crawled)
        best = jax.tree.map(lambda n, o: jnp.where(better, n, o), new, best)
        best = best._replace(steps=best.steps + 1)
        return best, *next_trial(best, damping), damping, least, crawled

    def unfinished(state: tuple) -> Bool[Array, ""]:
        # A step cut off at a bound may promise a rise, one of a singular matrix nothing: not there.
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
    return Fit(
        best.values,
        jnp.where(jnp.isfinite(best.loss), found, jnp.inf),
        gradient + share[:, None] * pull,
        hessian + share[:, None, None] * model.precision,
        best.adhesion,
        best.residual,
        best.jacobian,
        best.steps,
    )


@partial(jax.jit, compiler_options=_QUICKLY)
def changes(models: Model, data: Data, now: Array) -> Float[Array, "models runs points"]:
    """What each of the models adds to the prediction `now`."""

    def change(model: Model) -> Array:
        return _predict(model, data, model.values, _peaks(model, data, model.values)) - now

    return jax.lax.map(change, models)


@jax.jit
def whiten(
    white: Whitening, signals: Float[Array, "signals runs points"]
) -> Float[Array, "signals runs points"]:
    """Signals in units of the noise, uncorrelated."""
    return jax.vmap(lambda signal: whitened(white, signal))(signals)
