"""Planting an effect in simulated runs: the runs, and the effect with its strength left open."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions
from adhesion_jax.effects.base import Effect
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

    @property
    def step(self) -> float:
        """Seconds between two points."""
        return float(np.median(np.diff(self.columns["time_s"], axis=1)))

    @property
    def speed(self) -> np.ndarray:
        """Vehicle speed, m/s."""
        return self.columns["vehicle_speed_mps"]

    @property
    def slip_velocity(self) -> np.ndarray:
        """Size of the slip velocity, m/s."""
        return np.abs(self.slip) * self.speed

    def middle(self, column: str) -> float:
        """Median of a column."""
        return float(np.median(self.columns[column]))

    def rate(self, signal: np.ndarray) -> np.ndarray:
        """Central differences in time, per second."""
        return np.gradient(signal, self.step, axis=1)

    def lagged(self, signal: np.ndarray, time_constant: np.ndarray | float) -> np.ndarray:
        """First-order lag by the exact response to steps, in s; it starts settled."""
        kept = np.exp(-self.step / np.maximum(np.broadcast_to(time_constant, signal.shape), 1e-6))
        out = signal.copy()
        for k in range(1, signal.shape[1]):
            out[:, k] = kept[:, k] * out[:, k - 1] + (1 - kept[:, k]) * signal[:, k]
        return out


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
    """How an effect is planted in simulated runs.

    `exact` plants it by its own formula; None for noise, which has no formula to be varied.
    `otherwise` plants it by another formula, because a real rail follows none of the catalogue.
    `extra` gives the columns that runs have only where it is planted.
    """

    exact: Form | None
    otherwise: Form
    extra: Extra = chosen()


def of_strength(kind: type[Effect], limit: float, **fixed: float) -> Form:
    """An effect of one strength by its own formula, its references the medians of the runs."""
    (strength,) = kind.FACTS.strengths

    def exact(runs: CleanRuns) -> OpenEffect:
        medians = kind.medians(runs.columns)
        return by_its_formula(lambda a: kind(**{strength: a}, **medians, **fixed), limit, runs)

    return exact


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


def by_factor(factor: Callable[[float], np.ndarray], limit: float) -> OpenEffect:
    """Adhesion times `factor(amount)`, [runs, points]."""

    def make(amount: float) -> Planted:
        values = factor(amount)
        return planted(amount, 1, after=lambda adhesion: adhesion * values)

    return OpenEffect(make, limit)


def planted(
    amount: float, order: int, before: Bend = unchanged, after: Bend = unchanged
) -> Planted:
    """A form that has no parameter but its amount."""
    return Planted(order, before, after, unchanged, {"amount": amount})


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
