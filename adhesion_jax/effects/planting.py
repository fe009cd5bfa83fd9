"""Planting an effect in simulated runs: the runs, and the effect with its strength left open."""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import ClassVar, NamedTuple

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
    """Runs without any effect, arrays [runs, points]; braking runs have negative slip."""

    slip: np.ndarray  # the true slip ratio
    columns: Mapping[str, np.ndarray]  # every other column of the simulated runs
    conditions: Conditions  # the columns, completed by what follows from them
    curve: Bend  # the base curve of these runs, slip to adhesion

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


class Plan(NamedTuple):
    """An effect whose strength is open: `make(amount)`, amount from 0 to `limit`."""

    make: Callable[[float], Planted]
    limit: float


class Plantable(eqx.Module):
    """What can be planted in simulated runs, and how a study judges what is found of it.

    FAMILY is shared by causes whose formulas resemble each other: a second one of a family that
    adds little is a matter of form. SAME_AS holds the names that say the same: a plain column, a
    wave along a column, or a cause that no data can tell from it; one that ends in a colon stands
    for all that begin with it. SEEN_IN holds the columns in which a method without physics sees
    it, the one that stands for it first: columns of a table, or beginnings of the names of
    features made of them. ONE_FORM: it is noise, which has no formula to be varied, and always
    planted by `planted_otherwise`.
    """

    FAMILY: eqx.AbstractClassVar[str]
    SAME_AS: eqx.AbstractClassVar[tuple[str, ...]]
    SEEN_IN: eqx.AbstractClassVar[tuple[str, ...]]
    ONE_FORM: ClassVar[bool] = False

    @classmethod
    def extra_columns(
        cls, columns: Mapping[str, np.ndarray], generator: np.random.Generator
    ) -> Mapping[str, np.ndarray]:
        """Columns [runs, points] that simulated runs are given only where the cause is planted.

        `columns` are those that every run has; a column among them is chosen, any other drawn.
        """
        return {}

    @classmethod
    @abstractmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        """The cause by its own formula in simulated runs: its strength is open, the rest drawn.

        `phase` in rad is that of a cause that is a wave.
        """

    @classmethod
    @abstractmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """The same cause by another formula, because a real rail follows none of the catalogue."""


def by_its_formula(build: Callable[[float], Effect], limit: float, runs: CleanRuns) -> Plan:
    """The effect itself, `build(amount)`, on the runs."""
    true_slip = jnp.asarray(runs.slip)

    def make(amount: float) -> Planted:
        effect = build(amount)
        arrays = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), effect)
        values = {
            field: float(getattr(effect, field))
            for field in effect.PARAMETERS
            if isinstance(getattr(effect, field), float)
        }

        def before(slip: np.ndarray) -> np.ndarray:
            return np.asarray(_before(arrays, jnp.asarray(slip), runs.conditions))

        def after(adhesion: np.ndarray) -> np.ndarray:
            return np.asarray(_after(arrays, jnp.asarray(adhesion), true_slip, runs.conditions))

        if effect.ORDER > 0:  # no effect of the adhesion bends the slip as well
            return Planted(effect.ORDER, unchanged, after, unchanged, values)
        return Planted(effect.ORDER, before, after, unchanged, values)

    return Plan(make, limit)


def by_factor(factor: Callable[[float], np.ndarray], limit: float) -> Plan:
    """Adhesion times `factor(amount)`, [runs, points]."""

    def make(amount: float) -> Planted:
        values = factor(amount)
        return planted(amount, 1, after=lambda adhesion: adhesion * values)

    return Plan(make, limit)


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
