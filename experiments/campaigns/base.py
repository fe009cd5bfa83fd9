"""A base law on all runs of a simulated set: its adhesion, and its misfit after a refit."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import (
    Conditions,
    Curve,
    adhesion_of,
    free_values,
    physical_box,
    with_free_values,
)
from adhesion_jax.effects.conditions import Calendar, completed_runs
from adhesion_jax.optim import levenberg_marquardt
from experiments.campaigns.plantable import Bend
from experiments.campaigns.runs import Runs

#: Largest number of steps of a refit.
_STEPS = 60


def conditions_of(truth: Runs) -> Conditions:
    """The conditions that effects are given, as a law found in these data would have them."""
    time = truth.columns["time_s"]
    calendar = Calendar("time_s", float(time.min()), float(time.max()))
    measured = {name: np.asarray(values, float) for name, values in truth.columns.items()}
    return completed_runs(truth.slip, measured, calendar)


def on_runs(law: Curve, conditions: Conditions) -> Bend:
    arrays = jax.tree.map(jnp.asarray, law)
    return lambda slip: np.asarray(adhesion_of(arrays, jnp.asarray(slip), conditions))


def misfit(
    law: Curve, slip: np.ndarray, clean: np.ndarray, conditions: Conditions, rows: np.ndarray
) -> float:
    """Rms difference of the clean adhesion of some runs from the base law refitted to them."""
    needed = {name: jnp.asarray(conditions[name])[rows] for name in law.NEEDS}
    return refitted(law, slip[rows], clean[rows], needed)[1]


def refitted(
    law: Curve, slip: np.ndarray, adhesion: np.ndarray, conditions: Conditions
) -> tuple[Curve, float]:
    """The law refitted by bounded least squares from its present parameters, and the rms residual.

    All arrays have one shape; `conditions` holds the columns that the law needs.
    """
    arrays = jax.tree.map(jnp.asarray, law)
    box = jnp.stack(physical_box(law))
    values, squares = _refitted(arrays, jnp.asarray(slip), jnp.asarray(adhesion), conditions, box)
    return with_free_values(law, values), float(np.sqrt(squares / np.size(slip)))


@jax.jit
def _refitted(
    law: Curve,
    slip: Float[Array, "*shape"],
    adhesion: Float[Array, "*shape"],
    conditions: Conditions,
    box: Float[Array, "two free"],
) -> tuple[Float[Array, " free"], Float[Array, ""]]:
    def residual(values: Float[Array, " free"]) -> Float[Array, " rows"]:
        return jnp.ravel(with_free_values(law, values)(slip, conditions) - adhesion)

    lower, upper = box
    found = levenberg_marquardt.fit(residual, free_values(law), lower, upper, _STEPS)
    return found.x, found.objective


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
