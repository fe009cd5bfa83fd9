"""A base law on all runs of a simulated campaign: its adhesion, and what it leaves unexplained."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.optimize import least_squares

from adhesion_jax.curves import Conditions, Curve, free_values, physical_box, with_free_values
from adhesion_jax.discovery.conditions import Calendar, completed
from adhesion_jax.discovery.planted import Bend
from adhesion_jax.discovery.simulated_runs import Runs


def completed_runs(truth: Runs) -> Conditions:
    """The conditions that effects are given, as a law found in these data would have them."""
    time = truth.columns["time_s"]
    calendar = Calendar("time_s", float(time.min()), float(time.max()))
    return dict(
        jax.vmap(lambda slip, measured: completed(slip, measured, calendar))(
            jnp.asarray(truth.slip),
            {name: jnp.asarray(values, dtype=float) for name, values in truth.columns.items()},
        )
    )


def on_runs(law: Curve, conditions: Conditions) -> Bend:
    arrays = jax.tree.map(jnp.asarray, law)
    return lambda slip: np.asarray(_adhesion(arrays, jnp.asarray(slip), conditions))


@eqx.filter_jit
def _adhesion(
    law: Curve, slip: Float[Array, "*shape"], conditions: Conditions
) -> Float[Array, "*shape"]:
    return law(slip, conditions)


def misfit(
    law: Curve, slip: np.ndarray, clean: np.ndarray, conditions: Conditions, rows: np.ndarray
) -> float:
    """Rms of what the base law leaves of the clean adhesion of some runs, refitted by them."""
    needed = {name: jnp.asarray(conditions[name])[rows] for name in law.NEEDS}
    seen, wanted = jnp.asarray(slip[rows]), jnp.asarray(clean[rows])
    start = np.asarray(free_values(law))
    lower, upper = (np.asarray(bound) for bound in physical_box(law))
    arrays = jax.tree.map(jnp.asarray, law)
    fitted = least_squares(
        lambda values: np.asarray(_residual(arrays, jnp.asarray(values), seen, wanted, needed)),
        start,
        jac=lambda values: np.asarray(_jacobian(arrays, jnp.asarray(values), seen, wanted, needed)),
        bounds=(lower, upper),
        x_scale=np.abs(start),
        max_nfev=60,
    )
    return rms(fitted.fun)


@eqx.filter_jit
def _residual(
    law: Curve,
    values: Float[Array, " free"],
    slip: Float[Array, "runs points"],
    adhesion: Float[Array, "runs points"],
    conditions: Conditions,
) -> Float[Array, " rows"]:
    return jnp.ravel(with_free_values(law, values)(slip, conditions) - adhesion)


@eqx.filter_jit
def _jacobian(
    law: Curve,
    values: Float[Array, " free"],
    slip: Float[Array, "runs points"],
    adhesion: Float[Array, "runs points"],
    conditions: Conditions,
) -> Float[Array, "rows free"]:
    return jax.jacfwd(lambda at: _residual(law, at, slip, adhesion, conditions))(values)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
