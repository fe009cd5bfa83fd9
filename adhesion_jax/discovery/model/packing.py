"""A model as numbers: where its parameters stand, and how they are packed and unpacked.

The choice of curve and effects is numbers to the program (`program`), so that hundreds of candidate
models are fitted without compiling any of them. Models are padded to a number of slots, and their
free parameters to a number of columns of the Jacobian; padded parameters do not move.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from adhesion_jax.curves import BASES, CURVES, Law
from adhesion_jax.curves.bent import BELOW_EFFECTS, Bent
from adhesion_jax.discovery.model.problem import Problem
from adhesion_jax.effects import EFFECTS, KINDS, Effect, ShapeTerm
from adhesion_jax.effects.shape import ACTS_ON, prior_precision

#: Prior standard deviation of what braking adds to a factor of the departure, relative to that of
#: the factor, and of the factors relative to the first.
_APART = 0.5
_SMOOTH = 1 / (2 * np.arange(BELOW_EFFECTS) + 1.0)

#: Largest prior standard deviation of a factor. Were a slow departure free to be as large as the
#: curve, the parameters of the curve would drift along it to their bounds, and beyond the largest
#: slip of the points, where the departure ends, the law would be a line or a pole.
_LARGEST = 0.1


class Layout(NamedTuple):
    """Where numbers stand in a model, and the branches of the program."""

    curve: int  # places of the parameters of a curve
    base: int  # and with the factors of its departure
    effect: int  # places of a slot
    # An effect is a term of the shape, bends the slip before the curve, or changes adhesion after
    # it: only these branches are compiled for it.
    shapes: tuple[str, ...]
    causes: tuple[str, ...]
    bending: tuple[str, ...]

    def branches(self, names: Sequence[str]) -> Array:
        """The number of the branch of each kind; 0 for an empty slot or a kind without."""
        places = [names.index(name) + 1 if name in names else 0 for name in KINDS]
        return jnp.asarray([0, *places])


def parts() -> tuple[object, ...]:
    """The curves and effects that there are now: what the program is made of."""
    return *CURVES.values(), *EFFECTS.values()


@lru_cache(maxsize=1)
def _of_parts(_: tuple[int, ...]) -> Layout:
    curve = max(len(curve.free) for curve in BASES.values())
    shapes = tuple(name for name, kind in KINDS.items() if issubclass(kind, ShapeTerm))
    causes = tuple(name for name in KINDS if name not in shapes)
    return Layout(
        curve,
        curve + 2 * BELOW_EFFECTS,
        max(len(kind.FACTS.parameters) for kind in KINDS.values()),
        shapes,
        causes,
        tuple(name for name in causes if KINDS[name].ORDER == 0),
    )


def layout() -> Layout:
    return _of_parts(tuple(map(id, parts())))


def columns_of(effect: Effect) -> list[str]:
    """The columns that an effect names."""
    return [getattr(effect, name) for name in words_of(type(effect))]


@cache
def words_of(kind: type[Effect]) -> tuple[str, ...]:
    """The fields of an effect that name columns."""
    names = (field.name for field in dataclasses.fields(kind))
    return tuple(name for name in names if name not in (*kind.FACTS.parameters, "acts_on"))


# The model holds NumPy arrays outside a program and jax arrays inside it (hence `Any`).


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
    return [*range(len(BASES[base].free)), *range(layout().curve, layout().base)]


def _place_of(slot: int) -> int:
    return layout().base + slot * layout().effect


def effect_places(slot: int, effect: Effect) -> Mapping[str, int]:
    """Where the fitted parameters of an effect in a slot stand in `Model.values`, by name."""
    start = _place_of(slot)
    return {
        name: start + place
        for place, name in enumerate(effect.FACTS.parameters)
        if name not in effect.held
    }


def pack(
    problem: Problem,
    base: str,
    base_values: Sequence[float],
    effects: Sequence[Effect],
    size: tuple[int, int],
) -> Model:
    """The model as numbers, padded to that number of slots and of free parameters.

    `effects` must be in the order of their ORDER. With two `branches` the departure of braking is
    another one; a level has none. `base_values` are those of `base_places`, or of the curve alone.
    """
    slots, free = size
    values = np.zeros(_place_of(slots) + 1)
    values[base_places(base)[: len(base_values)]] = base_values
    kind, column = np.zeros(slots, int), np.zeros((slots, 3), int)
    precision = np.zeros((free, free))
    described = [BASES[base].PARAMETERS[name] for name in BASES[base].free]
    bends = 0 if base == "level" else problem.branches * BELOW_EFFECTS
    places = base_places(base)[: len(described) + bends]
    lower = [*(one.lower for one in described), *[-9.0] * bends]
    upper = [*(one.upper for one in described), *[9.0] * bends]
    sizes = np.minimum(problem.bend * np.concatenate([_SMOOTH, _APART * _SMOOTH]), _LARGEST)[:bends]
    bent = range(len(described), len(places))
    precision[bent, bent] = sizes**-2.0
    for slot, effect in enumerate(effects):
        kind[slot] = 1 + [*KINDS.values()].index(type(effect))
        named = columns_of(effect)
        column[slot, : len(named)] = [(*problem.columns, "").index(name) for name in named]
        if isinstance(effect, ShapeTerm):
            column[slot, 2] = ACTS_ON.index(effect.acts_on)
        start = _place_of(slot)
        numbers = [float(getattr(effect, name)) for name in effect.FACTS.parameters]
        values[start : start + len(numbers)] = numbers
        own = effect_places(slot, effect)
        facts = [effect.FACTS.parameters[name] for name in own]
        if isinstance(effect, ShapeTerm):
            held = [len(places) + [*own].index(name) for name in effect.FACTS.strengths]
            precision[np.ix_(held, held)] = prior_precision(type(effect), effect.acts_on)
        places += own.values()
        lower += [one.lower for one in facts]
        upper += [one.upper for one in facts]
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
