"""Planting an effect in simulated runs: the runs, and the effect with its strength left open."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions
from adhesion_jax.effects.api import Effect
from adhesion_jax.effects.shape import ShapeTerm

#: Arrays [runs, points] to the like: slip to slip or to adhesion, adhesion to adhesion.
Bend = Callable[[np.ndarray], np.ndarray]


def unchanged(signal: np.ndarray) -> np.ndarray:
    return signal


class CleanRuns(NamedTuple):
    """Runs without any effect, arrays [runs, points], and the chance of one that is planted."""

    slip: np.ndarray  # the true slip ratio, negative in braking runs
    columns: Mapping[str, np.ndarray]  # every other column of the simulated runs
    conditions: Conditions  # the columns, completed by what follows from them
    curve: Bend  # the base curve of these runs, slip to adhesion
    generator: np.random.Generator  # draws what is not the strength of the effect
    phase: float = 0.0  # of an effect that is a wave, rad

    def middle(self, column: str) -> float:
        """Median of a column."""
        return float(np.median(self.columns[column]))


class Planted(NamedTuple):
    """One effect on all runs: adhesion = after(curve(before(slip))), lowest order first."""

    order: int
    before: Bend
    after: Bend
    measured: Bend  # the slip signal that the table is given for the true slip
    parameters: Mapping[str, float]


class OpenEffect(NamedTuple):
    """An effect whose strength is open: `make(amount)`, amount from 0 to `limit`."""

    make: Callable[[float], Planted]
    limit: float


#: An effect in simulated runs: its strength is open, the rest drawn.
Form = Callable[[CleanRuns], OpenEffect]

#: Columns [runs, points] from those that every run has.
Extra = Callable[[Mapping[str, np.ndarray], np.random.Generator], Mapping[str, np.ndarray]]


def chosen(*names: str) -> Extra:
    """These of the columns."""
    return lambda columns, _: {name: columns[name] for name in names}


class Planting(NamedTuple):
    """How an effect is planted in simulated runs: the form, and the columns that it needs besides.

    Noise has no formula, so that no phase of a wave is drawn for it.
    """

    form: Form
    extra: Extra = chosen()
    is_noise: bool = False


def of_strength(kind: type[Effect], limit: float, **others: float | tuple[float, float]) -> Form:
    """An effect of one strength up to a limit by its own formula, references being medians.

    The other parameters have a value, or one that is drawn between two.
    """
    (strength,) = kind.FACTS.strengths

    def form(runs: CleanRuns) -> OpenEffect:
        fixed = {
            name: runs.generator.uniform(*one) if isinstance(one, tuple) else one
            for name, one in others.items()
        }
        fixed |= kind.medians(runs.columns)
        return by_its_formula(lambda a: kind(**{strength: a}, **fixed), limit, runs)

    return form


def by_its_formula(build: Callable[[float], Effect], limit: float, runs: CleanRuns) -> OpenEffect:
    """The effect itself, `build(amount)`, on the runs."""
    true_slip = jnp.asarray(runs.slip)

    def make(amount: float) -> Planted:
        effect = build(amount)
        arrays = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), effect)
        values = {
            field: float(getattr(effect, field))
            for field in effect.FACTS.parameters
            if isinstance(getattr(effect, field), float)
        }

        def before(slip: np.ndarray) -> np.ndarray:
            return np.asarray(_before(arrays, jnp.asarray(slip), runs.conditions))

        def after(adhesion: np.ndarray) -> np.ndarray:
            return np.asarray(_after(arrays, jnp.asarray(adhesion), true_slip, runs.conditions))

        if effect.ORDER > 0:  # no effect of the adhesion bends the slip as well
            return Planted(effect.ORDER, unchanged, after, unchanged, values)
        return Planted(effect.ORDER, before, after, unchanged, values)

    return OpenEffect(make, limit)


@eqx.filter_jit
def _before(
    effect: Effect, slip: Float[Array, "runs points"], conditions: Conditions
) -> Float[Array, "runs points"]:
    return jax.vmap(lambda slip, conditions: effect.before(slip, conditions))(slip, conditions)


@eqx.filter_jit
def _after(
    effect: Effect,
    adhesion: Float[Array, "runs points"],
    slip: Float[Array, "runs points"],
    conditions: Conditions,
) -> Float[Array, "runs points"]:
    if isinstance(effect, ShapeTerm):  # those planted here act on the level
        return adhesion * jnp.exp(jax.vmap(effect.log_factor)(conditions))
    return jax.vmap(lambda *run: effect.after(*run))(adhesion, slip, conditions)
