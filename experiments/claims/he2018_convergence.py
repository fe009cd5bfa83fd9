"""Experiment 1 of He et al. 2018: the slip from which the parameters have converged."""

from collections.abc import Callable

import jax
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from adhesion_jax.campaign.job import Config, build_scenario
from adhesion_jax.campaign.monte_carlo import run_campaign
from experiments.claims.claim import HE2018, REPAIRED, Claim, below, judged

Numbers = NDArray[np.float64]

#: A parameter has converged where its RMSE stays within this share of the truth (our reading:
#: the paper shows single runs and gives no criterion).
CONVERGED = 0.05

#: The slip by which Experiment 1 says that each quantity has converged.
CONVERGED_BY = {"c1": 0.1, "c2": 0.1, "c3": 0.4, "mu_max": 0.4}


def slip_at_convergence(slip: Numbers, rmse: Numbers, rmse_error: Numbers) -> tuple[float, float]:
    """The slip from which a relative RMSE stays within `CONVERGED`, and its standard error.

    RMSE is taken as a power of the slip between two checkpoints. Infinite where it is still
    larger at the end. Where it never is, the first checkpoint, without an error: the crossing
    may lie anywhere before.
    """
    above = np.flatnonzero(~(rmse <= CONVERGED))
    if above.size == 0:
        return float(slip[0]), float("nan")
    i = int(above[-1])
    if i == len(slip) - 1:
        return float("inf"), 0.0
    steps = np.log(rmse[i : i + 2] / CONVERGED)
    power = (steps[1] - steps[0]) / np.log(slip[i + 1] / slip[i])
    crossing = slip[i] * np.exp(-steps[0] / power)
    weight = steps / (steps[0] - steps[1])  # of the other end's error in log RMSE
    relative = rmse_error[i : i + 2] / rmse[i : i + 2]
    error = crossing * np.hypot(weight[1] * relative[0], weight[0] * relative[1]) / abs(power)
    return float(crossing), float(error)


def convergence_claims(config: Config, progress: Callable[[str], None]) -> list[Claim]:
    """c1 and c2 by slip .1, c3 and mu_max by .4, on the dry rail (Fig. 4 to 7)."""
    scenario = build_scenario(config)
    campaign = run_campaign(config, lambda _: None, progress)
    table = campaign.tables["checkpoints"]
    slip, sigma = np.asarray(scenario.draw(jax.random.key(0)).slip[0]), scenario.noise.sigma
    table = table.assign(slip=slip[table["k"].to_numpy() - 1])
    found: list[Claim] = []
    for quantity, by in CONVERGED_BY.items():
        at = {
            name: rows.set_index("slip")
            for name, rows in table[table["quantity"] == quantity].groupby("identifier")
        }
        ours, exact = at["ml-de"], at["ml-exact"]
        relative = {name: rows["rmse"] / rows["truth"] for name, rows in at.items()}
        error = ours["rmse_se"] / ours["truth"]
        reached, reached_error = slip_at_convergence(
            ours.index.to_numpy(), relative["ml-de"].to_numpy(), error.to_numpy()
        )
        censored = bool(np.isnan(reached_error))
        exact_reached, _ = slip_at_convergence(
            exact.index.to_numpy(),
            relative["ml-exact"].to_numpy(),
            (exact["rmse_se"] / exact["truth"]).to_numpy(),
        )
        slips = ours.index.to_numpy(dtype=float)
        place = float(slips[np.abs(slips - by).argmin()])
        percent = 100 * relative["ml-de"][place]
        bound = 100 * exact["crlb"][place] / exact["truth"][place]
        found.append(
            judged(
                HE2018,
                f"Exp. 1: {quantity} has converged by slip {by:g} "
                f"(RMSE of ml-de stays within {100 * CONVERGED:g} %)",
                reached,
                "slip (1)",
                below(reached, float(np.nan_to_num(reached_error)), by, config.runs),
                REPAIRED,
                ("It is so at the first estimate, and may be so before. " if censored else "")
                + f"The exact optimum is there from slip {exact_reached:.3g} (first estimate at "
                f"{slips[0]:.3g}); the noise is read as sigma = {sigma:g}, "
                f"for with variance {sigma:g} the bound on an unbiased estimate would "
                f"still be {bound * sigma**-0.5:.2g} % at slip {by:g}.",
                by,
                reached_error,
            )
        )
        found.append(
            judged(
                HE2018,
                f"Exp. 1: {quantity} at slip {by:g} is near its true value "
                f"(RMSE of ml-de below {100 * CONVERGED:g} %)",
                float(percent),
                "% of truth",
                below(percent, 100 * error[place], 100 * CONVERGED, config.runs),
                REPAIRED,
                f"The exact optimum has {100 * relative['ml-exact'][place]:.3g} %, the Cramér-Rao "
                f"bound of an estimate without a box is {bound:.3g} %; "
                f"{100 * exact['at_bound_share'][place]:.0f} % of the exact optima lie on the box "
                f"and {100 * ours['failure_share'][place]:.1f} % of the searches miss theirs.",
                error=float(100 * error[place]),
            )
        )
    found.append(_largest_error(table, config.runs))
    return found


def _largest_error(table: pd.DataFrame, runs: int) -> Claim:
    """The relative RMSE of c3 over that of c1 and c2, at the last estimate."""
    last = table[(table["identifier"] == "ml-de") & (table["k"] == table["k"].max())]
    last = last.set_index("quantity")
    share = last["rmse"] / last["truth"]
    others = share[["c1", "c2"]]
    ratio = float(others.max() / share["c3"])
    parts = [last["rmse_se"][name] / last["rmse"][name] for name in (others.idxmax(), "c3")]
    error = ratio * float(np.hypot(*parts))
    return judged(
        HE2018,
        "Exp. 1: c3 has the largest error (largest other relative RMSE over its own, below 1)",
        ratio,
        "ratio (1)",
        below(ratio, error, 1.0, runs),
        REPAIRED,
        f"After all 500 points, to slip .5: c1 {100 * share['c1']:.2g} %, c2 "
        f"{100 * share['c2']:.2g} %, c3 {100 * share['c3']:.2g} % of the truth.",
        error=error,
    )
