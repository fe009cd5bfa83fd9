"""One compiled program for every model: a curve and slots for effects, each of any kind.

The choice of curve and effects is numbers to the program, so that hundreds of candidate models are
fitted without compiling any of them. Models are padded to a number of slots, and their free
parameters to a number of columns of the Jacobian; padded parameters do not move.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from adhesion_jax.curves import BASES, CURVES, Conditions, Law, with_free_values
from adhesion_jax.curves.bent import BELOW_EFFECTS, Bent, functions
from adhesion_jax.effects import EFFECTS, KINDS, Effect, ShapeTerm
from adhesion_jax.effects.shape import ACTS_ON, fallen, peak_slips, prior_precision
from adhesion_jax.effects.slip_noise import SlipNoise
from adhesion_jax.programs import kept

#: `changes` takes this many models at a time, whatever their number: one program for all data.
PROBES = 16

#: Number of parameters whose derivatives are taken together, sharing the transcendental functions;
#: the numbers of parameters of the program's sizes are multiples of it.
_TOGETHER = 24

#: Prior standard deviation of what braking adds to a factor of the departure, relative to that of
#: the factor, and of the factors relative to the first.
_APART = 0.5
_SMOOTH = 1 / (2 * np.arange(BELOW_EFFECTS) + 1.0)

#: Means of the functions of a departure over its range, and the prior standard deviation of the
#: mean of what braking adds where an effect tells that mean.
_MEANS, _NO_MEAN = 1 / (np.pi * (np.arange(BELOW_EFFECTS) + 0.5)), 0.01


class _Layout(NamedTuple):
    """Where numbers stand in a model, and the branches of the program."""

    curve: int  # places of the parameters of a curve
    base: int  # and with the factors of its departure
    effect: int  # places of a slot
    kinds: Mapping[type[Effect], int]
    names: tuple[str, ...]
    # An effect is a term of the shape, bends the slip before the curve, or changes adhesion after
    # it: only these branches are compiled for it. Noise of the slip is no effect of a program,
    # because the slip is corrected for it beforehand.
    shapes: tuple[str, ...]
    causes: tuple[str, ...]
    bending: tuple[str, ...]

    def branches(self, names: Sequence[str]) -> Array:
        """The number of the branch of each kind; 0 for an empty slot or a kind without."""
        places = [names.index(name) + 1 if name in names else 0 for name in self.names]
        return jnp.asarray([0, *places])


def parts() -> tuple[object, ...]:
    """The curves and effects that there are now: what the program is made of."""
    return *CURVES.values(), *EFFECTS.values()


@lru_cache(maxsize=1)
def _of_parts(_: tuple[int, ...]) -> _Layout:
    curve, names = max(len(curve.free) for curve in BASES.values()), tuple(KINDS)
    shapes = tuple(name for name in names if issubclass(KINDS[name], ShapeTerm))
    causes = tuple(name for name in names if name not in shapes and KINDS[name] is not SlipNoise)
    return _Layout(
        curve,
        curve + 2 * BELOW_EFFECTS,
        max(len(kind.FACTS.parameters) for kind in KINDS.values()),
        {kind: place for place, kind in enumerate(KINDS.values())},
        names,
        shapes,
        causes,
        tuple(name for name in causes if KINDS[name].ORDER == 0),
    )


def _layout() -> _Layout:
    return _of_parts(tuple(map(id, parts())))


def apart() -> range:
    """Where the factors stand that braking adds."""
    layout = _layout()
    return range(layout.curve + BELOW_EFFECTS, layout.base)


@cache
def words_of(kind: type[Effect]) -> tuple[str, ...]:
    """The fields of an effect that name columns."""
    names = (field.name for field in dataclasses.fields(kind))
    return tuple(name for name in names if name not in (*kind.FACTS.parameters, "acts_on"))


# The tuples below hold NumPy arrays outside a program and jax arrays inside it (hence `Any`).


class Data(NamedTuple):
    """The measured runs, padded; conditions hold every column that any effect needs."""

    slip: Float[Any, "runs points"]
    adhesion: Float[Any, "runs points"]
    span: Float[Any, " two"]  # of the departure: its reach, and the largest slip of the points
    conditions: Mapping[str, Float[Any, "runs points"]]
    columns: Float[Any, "columns runs points"]  # columns that a term may be a function of


class Model(NamedTuple):
    """A curve and its effects as numbers, in the order in which effects are applied."""

    base: Int[Any, ""]
    values: Float[Any, " flat"]  # of the curve, then of the slots, then one for the padding
    kind: Int[Any, " slots"]  # 0: empty, else 1 + place in KINDS
    column: Int[Any, "slots three"]  # two places in Data.columns, and one of ACTS_ON
    free: Int[Any, " free"]  # places in `values`; padded with the last
    lower: Float[Any, " free"]
    upper: Float[Any, " free"]
    precision: Float[Any, "free free"]  # of the prior of the free parameters, about zero


def base_places(base: str) -> list[int]:
    """Where the parameters of a curve, then the factors of its departure, stand in the values."""
    return [*range(len(BASES[base].free)), *range(_layout().curve, _layout().base)]


def _place_of(slot: int) -> int:
    return _layout().base + slot * _layout().effect


def effect_places(slot: int, effect: Effect) -> Mapping[str, int]:
    """Where the fitted parameters of an effect in a slot stand in `Model.values`, by name."""
    start = _place_of(slot)
    return {
        name: start + place
        for place, name in enumerate(effect.FACTS.parameters)
        if name not in effect.FACTS.references
    }


def pack(
    base: str,
    base_values: Sequence[float],
    effects: Sequence[Effect],
    columns: Sequence[str],
    slots: int,
    free: int,
    branches: int,
    bend: float,
) -> Model:
    """The model as numbers, padded to that number of slots and of free parameters.

    `effects` must be in the order of their ORDER; `columns` names those of `Data.columns`. With two
    `branches` the departure of braking is another one; a level has none. `bend` is the prior
    standard deviation of the first factor. `base_values` are those of
    `base_places`, or of the curve alone.
    """
    values = np.zeros(_place_of(slots) + 1)
    values[base_places(base)[: len(base_values)]] = base_values
    kind, column = np.zeros(slots, int), np.zeros((slots, 3), int)
    precision = np.zeros((free, free))
    described = [BASES[base].PARAMETERS[name] for name in BASES[base].free]
    bends = 0 if base == "level" else branches * BELOW_EFFECTS
    places = base_places(base)[: len(described) + bends]
    lower = [*(one.lower for one in described), *[-9.0] * bends]
    upper = [*(one.upper for one in described), *[9.0] * bends]
    sizes = bend * np.concatenate([_SMOOTH, _APART * _SMOOTH])[:bends]
    bent = range(len(described), len(places))
    precision[bent, bent] = sizes**-2.0
    if branches == 2 and any("mode" in effect.FACTS.needs for effect in effects):
        # The departure is 0 at slip 0, so that the effect would otherwise fit the least slips alone
        # and leave the difference of traction and braking to the departure.
        braking = bent[BELOW_EFFECTS:]
        precision[np.ix_(braking, braking)] += np.outer(_MEANS, _MEANS) / _NO_MEAN**2
    for slot, effect in enumerate(effects):
        kind[slot] = 1 + _layout().kinds[type(effect)]
        named = [getattr(effect, name) for name in words_of(type(effect))]
        column[slot, : len(named)] = [columns.index(name) for name in named]
        if isinstance(effect, ShapeTerm):
            column[slot, 2] = ACTS_ON.index(effect.acts_on)
        start = _place_of(slot)
        numbers = [float(getattr(effect, name)) for name in effect.FACTS.parameters]
        values[start : start + len(numbers)] = numbers
        for name, place in effect_places(slot, effect).items():
            places.append(place)
            lower.append(effect.FACTS.parameters[name].lower)
            upper.append(effect.FACTS.parameters[name].upper)
        if isinstance(effect, ShapeTerm):
            held = [
                places.index(effect_places(slot, effect)[name]) for name in effect.FACTS.strengths
            ]
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
        start = _place_of(slot)
        numbers = dict(zip(effect.FACTS.parameters, values[start:].tolist(), strict=False))
        found.append(dataclasses.replace(effect, **numbers))
    return tuple(found)


def base_curve(base: str, values: np.ndarray, span: np.ndarray) -> Law:
    """The curve with the parameters of a fit, and with its departure."""
    curve, count = BASES[base], len(BASES[base].free)
    known = dataclasses.replace(curve, **dict(zip(curve.free, values.tolist(), strict=False)))
    factors, braking = values[count : count + BELOW_EFFECTS], values[count + BELOW_EFFECTS :]
    if not np.any(values[count:]):
        return known
    reach, largest = span.tolist()
    return Bent(known, factors, reach, largest, braking if np.any(braking) else None)


class _Slots(NamedTuple):
    """The effects of a model, one in each slot, and what they see of one run."""

    parameters: Array
    kind: Array
    column: Array
    conditions: Conditions
    columns: Array

    def acting(
        self,
        names: Sequence[str],
        slot: Array,
        acts: Callable[[Any, Conditions, Array], Array],
        value: Array,
    ) -> Array:
        """What the effect in a slot makes of a value, if it is one of these; else the value."""

        def branch(name: str) -> Callable[[Array], Array]:
            return lambda value: acts(self._effect(name, slot), self._seen(slot), value)

        which = _layout().branches(names)[self.kind[slot]]
        return jax.lax.switch(which, [lambda value: value, *map(branch, names)], value)

    def _effect(self, name: str, slot: Array) -> Any:
        named, own = KINDS[name], self.parameters[slot]
        numbers = {key: own[place] for place, key in enumerate(named.FACTS.parameters)}
        return named(**numbers, **dict(zip(words_of(named), ("first", "second"), strict=False)))

    def _seen(self, slot: Array) -> Conditions:
        first, second = (self.columns[self.column[slot, place]] for place in (0, 1))
        return {**self.conditions, "first": first, "second": second}


def _adhesion(
    base: Array,
    values: Array,
    kind: Array,
    column: Array,
    slip: Array,
    span: Array,
    conditions: Conditions,
    columns: Array,
    peak: Array,
) -> Float[Array, " points"]:
    """The prediction of a model for one run, equal to that of `law.with_effects`."""
    if not kind.size:
        return _curve(base, values, span, slip, conditions)
    layout = _layout()
    slots = _Slots(
        values[layout.base : -1].reshape(kind.size, layout.effect),
        kind,
        column,
        conditions,
        columns,
    )
    # The loops end at the last effect: empty slots take no time.
    used = jnp.max(jnp.where(kind > 0, jnp.arange(kind.size) + 1, 0))

    def shape(slot: Array, sums: Array) -> Array:
        def term(effect: Any, seen: Conditions, _: Array) -> Array:
            return effect.log_factor(seen)

        own = slots.acting(layout.shapes, slot, term, jnp.zeros_like(slip))
        return sums.at[column[slot, 2]].add(own)

    def before(turn: Array, bent: Array) -> Array:
        def bend(effect: Any, seen: Conditions, bent: Array) -> Array:
            return effect.before(bent, seen)

        return slots.acting(layout.bending, used - 1 - turn, bend, bent)

    def after(slot: Array, adhesion: Array) -> Array:
        def change(effect: Any, seen: Conditions, adhesion: Array) -> Array:
            return effect.after(adhesion, slip, seen)

        return slots.acting(layout.causes, slot, change, adhesion)

    def curve(slip: Array) -> Array:
        return _curve(base, values, span, slip, conditions)

    sums = jax.lax.fori_loop(0, used, shape, jnp.zeros((len(ACTS_ON), slip.size)))
    level, stretch, fall, offset, shift = sums
    bent = jax.lax.fori_loop(0, used, before, slip) * jnp.exp(stretch) + shift
    adhesion = jax.lax.cond(
        _falls(kind, column),
        lambda adhesion: fallen(curve, bent, adhesion, fall, peak),
        lambda plain: plain,
        curve(bent),
    )
    return jax.lax.fori_loop(0, used, after, adhesion * jnp.exp(level) + offset)


def _curve(base: Array, values: Array, span: Array, slip: Array, conditions: Conditions) -> Array:
    """The prediction of the curve without effects."""
    departure = _departures(slip, _factors(values), span)
    bend = departure[..., 0] + jnp.where(slip < 0, departure[..., 1], 0.0)
    return _straight(base, values, slip, conditions) * (1 + bend)


def _straight(base: Array, values: Array, slip: Array, conditions: Conditions) -> Array:
    """The prediction of the curve without effects and without its departure."""
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


def _factors(values: Array) -> Float[Array, "two functions"]:
    return values[_layout().curve : _layout().base].reshape(2, BELOW_EFFECTS)


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


def _falls(kind: Array, column: Array) -> Bool[Array, ""]:
    """Whether a term acts on the fall of the curve."""
    return jnp.any((kind > 0) & (column[:, 2] == ACTS_ON.index("fall")))


def _peaks(model: Model, data: Data, values: Array) -> Float[Array, "runs points"]:
    """The slip of the curve's peak if a term acts on the fall beyond it, else infinity."""
    if not model.kind.size:
        return jnp.full_like(data.slip, jnp.inf)
    return jax.lax.cond(
        _falls(model.kind, model.column),
        lambda slip: peak_slips(
            lambda slip: _curve(model.base, values, data.span, slip, data.conditions), slip
        ),
        lambda slip: jnp.full_like(slip, jnp.inf),
        data.slip,
    )


def _predict(
    model: Model, data: Data, values: Array, peaks: Float[Array, "runs points"]
) -> Float[Array, "runs points"]:
    def run(slip: Array, conditions: Conditions, columns: Array, peak: Array) -> Array:
        return _adhesion(
            model.base,
            values,
            model.kind,
            model.column,
            slip,
            data.span,
            conditions,
            columns,
            peak,
        )

    return jax.vmap(run, in_axes=(0, 0, 1, 0))(data.slip, data.conditions, data.columns, peaks)


def with_jacobian(
    model: Model, data: Data, root: Float[Array, "runs points"], values: Array
) -> tuple[Array, Array, Array]:
    """Prediction, residual, and Jacobian [free, runs, points], the last two times `root`."""
    if not model.kind.size:
        adhesion, jacobian = _of_curve_alone(model, data, values)
        return adhesion, root * (adhesion - data.adhesion), root * jacobian
    peaks = _peaks(model, data, values)

    def push(tangent: Array) -> tuple[Array, Array]:
        adhesion, change = jax.jvp(lambda v: _predict(model, data, v, peaks), (values,), (tangent,))
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


def _of_curve_alone(model: Model, data: Data, values: Array) -> tuple[Array, Array]:
    """Prediction and Jacobian of a curve without effects, linear in the factors of a departure."""
    count = _layout().curve
    straight, push = jax.linearize(
        lambda v: _straight(model.base, v, data.slip, data.conditions), values[:count]
    )
    shape = jnp.moveaxis(functions(data.slip, data.span[0], data.span[1], BELOW_EFFECTS), -1, 0)
    both = jnp.stack([shape, jnp.where(data.slip < 0, shape, 0.0)])
    bent = 1 + jnp.einsum("bk,bkrt->rt", _factors(values), both)
    of_curve = bent * jax.vmap(push)(jnp.eye(count))
    of_factors = straight * both.reshape(-1, *data.slip.shape)
    padding = jnp.zeros((1, *data.slip.shape))
    jacobian = jnp.concatenate([of_curve, of_factors, padding])[model.free]
    return straight * bent, jacobian


@kept(reads=parts)
def changes(models: Model, data: Data, now: Array) -> Float[Array, "models runs points"]:
    """The prediction of each model less the prediction `now`."""

    def change(model: Model) -> Array:
        return _predict(model, data, model.values, _peaks(model, data, model.values)) - now

    return jax.lax.map(change, models)


@kept(reads=parts)
def predicted(model: Model, data: Data) -> Float[Array, "runs points"]:
    """The prediction of a model."""
    return _predict(model, data, model.values, _peaks(model, data, model.values))
