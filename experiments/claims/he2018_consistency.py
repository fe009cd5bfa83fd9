"""Eq. 15 of He et al. 2018: the RMSE of the estimate against the number of points."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray
from numpy.typing import NDArray

from adhesion_jax.campaign.keys import noise_keys
from adhesion_jax.identifiers import IDENTIFIERS, identify
from adhesion_jax.metrics.information import cramer_rao_bound, quantities, quantity_names
from adhesion_jax.metrics.moments import Moments
from adhesion_jax.optim.box import on_bound
from adhesion_jax.records import Record
from adhesion_jax.scenarios import Scenario
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rails import RAILS
from experiments.claims.claim import HE2018, REPAIRED, Claim, equal, judged
from experiments.claims.he2018_convergence import CONVERGED_BY
from experiments.claims.tiled import over_runs

Numbers = NDArray[np.float64]

#: Number of points in a block of the consistency experiment.
SIZES = (125, 250, 500, 1000, 2000, 4000, 8000)


class Fit(NamedTuple):
    """A power law fitted to RMSE against the number of points."""

    slope: float
    slope_error: float
    intercept: float


def power_law(points: Numbers, rmse: Numbers, rmse_error: Numbers) -> Fit:
    """The line log RMSE = intercept + slope log n by least squares.

    Weighted with the errors of log RMSE. The RMSEs are independent of each other, so the slope's
    error follows from theirs alone.
    """
    weight = (rmse / rmse_error) ** 2
    x, y = np.log(points), np.log(rmse)
    x_mean, y_mean = np.average(x, weights=weight), np.average(y, weights=weight)
    spread = np.sum(weight * (x - x_mean) ** 2)
    slope = np.sum(weight * (x - x_mean) * (y - y_mean)) / spread
    return Fit(float(slope), float(spread**-0.5), float(y_mean - slope * x_mean))


def sized_blocks(sizes: tuple[int, ...], slip_max: float) -> tuple[Numbers, NDArray[np.bool_]]:
    """Slip and mask of a block of each size, all as long as the largest: [sizes, points].

    One shape for all sizes, because the solver takes longer to compile than to run.
    """
    slip, mask = np.zeros((2, len(sizes), max(sizes)))
    for i, points in enumerate(sizes):
        slip[i, :points] = np.linspace(0.0, slip_max, points)
        mask[i, :points] = 1
    return slip, mask.astype(bool)


def consistency_table(
    scenario: Scenario,
    seed: int,
    runs: int,
    progress: Callable[[str], None],
    sizes: tuple[int, ...] = SIZES,
    slip_max: float = 0.2,
) -> pd.DataFrame:
    """RMSE, its error and the bound of the exact optimum on blocks of different sizes.

    The noise of the sizes is independent, and so are their errors. One row a size and quantity.
    """
    slip, mask = map(jnp.asarray, sized_blocks(sizes, slip_max))
    curve, known, sigma = RAILS[scenario.rails[0]], scenario.known, scenario.noise.sigma
    clean = curve(slip, {})

    @jax.jit
    def tile(noise: Key[Array, " runs"]) -> Float[Array, "runs sizes values"]:
        def one_run(key: PRNGKeyArray) -> Float[Array, "sizes values"]:
            adhesion = clean + Noise(sigma).draw(key, clean.shape)
            estimate = identify(
                IDENTIFIERS["ml-exact"], known, Record(slip, adhesion, mask, mask, {}), key
            )
            return jnp.stack(list(estimate.values.values()), axis=-1)

        return jax.vmap(one_run)(noise)

    def of_tile(chosen: Int[Array, " runs"]) -> Float[Array, "runs sizes values"]:
        return tile(noise_keys(seed, "claims-consistency", chosen))

    estimates = over_runs(runs, of_tile, partial(progress, "consistency"))
    truth = np.asarray(quantities(curve, known))
    free = estimates[..., : len(known.curve.free)]
    on_box = np.asarray(on_bound(jnp.asarray(free), known.lower, known.upper)).any(axis=-1)
    moments = Moments.of(
        {"squared_error": (estimates - truth) ** 2, "on_box": on_box.astype(float)}
    )
    rmse = np.sqrt(moments.mean("squared_error"))
    bounds = jax.vmap(lambda slip, mask: cramer_rao_bound(curve, slip, mask, {}, sigma, known))
    names = quantity_names(known.curve)
    return pd.DataFrame(
        {
            "points": np.repeat(sizes, len(names)),
            "quantity": np.tile(names, len(sizes)),
            "truth": np.tile(truth, len(sizes)),
            "rmse": rmse.ravel(),
            "rmse_se": (moments.standard_error("squared_error") / (2 * rmse)).ravel(),
            "crlb": np.ravel(jax.jit(bounds)(slip, mask)),
            "at_bound_share": np.repeat(moments.mean("on_box"), len(names)),
        }
    )


def consistency_fits(table: pd.DataFrame) -> dict[str, Fit]:
    return {
        quantity: power_law(
            *(rows[column].to_numpy(dtype=float) for column in ("points", "rmse", "rmse_se"))
        )
        for quantity in CONVERGED_BY
        for rows in [table[table["quantity"] == quantity]]
    }


def consistency_claims(table: pd.DataFrame) -> list[Claim]:
    """The estimate converges to the truth (Eq. 15); its RMSE then falls as n^(-1/2)."""
    found = []
    for quantity, fit in consistency_fits(table).items():
        rows = table[table["quantity"] == quantity]
        ends = rows.iloc[[0, -1]]
        share = 100 * (ends["rmse"] / ends["truth"]).to_numpy()
        found.append(
            judged(
                HE2018,
                f"Eq. 15, consistency: slope of log RMSE of {quantity} over log points, "
                "exact optimum (-1/2 by asymptotic theory)",
                fit.slope,
                "1",
                equal(fit.slope, fit.slope_error, -0.5),
                REPAIRED,
                f"RMSE falls from {share[0]:.3g} to {share[1]:.3g} % of the truth from "
                f"{ends['points'].iloc[0]} to {ends['points'].iloc[1]} points, "
                f"{(ends['rmse'] / ends['crlb']).iloc[0]:.3f} and "
                f"{(ends['rmse'] / ends['crlb']).iloc[1]:.3f} times the Cramér-Rao bound; at most "
                f"{100 * rows['at_bound_share'].max():.1f} % of the runs touch the box. Eq. 14 is "
                "read as the arg min that it must be.",
                -0.5,
                fit.slope_error,
            )
        )
    return found
