"""Fang et al. 2018: the slope of the adhesion curve by recursive least squares."""

from collections.abc import Callable

import numpy as np

from adhesion_jax.campaign.config import Config
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.scenarios import Options
from experiments.claims.claim import Claim, verdict_below

FANG2018 = "Fang et al. 2018"

#: "Good agreement" of two lines in a figure, read as this share of the largest slope, in per cent.
_AGREEMENT = 5.0

#: The steep part of the rise: where the slope is above this share of its largest value.
_STEEP = 0.3


def slope_config(runs: int, seed: int) -> Config:
    return Config("fang2018-slope", ("rls-slope",), Options(), runs, seed)


def slope_claims(config: Config, progress: Callable[[str], None]) -> list[Claim]:
    """The slope follows the true one, on the steep rise and around the peak (Fig. 10)."""
    table = run_campaign(config, lambda _: None, progress).tables["checkpoints"]
    largest = table["truth"].abs().max()
    steep = table["truth"] > _STEEP * largest
    found = []
    for words, rows in (
        ("around and behind the peak", table[~steep]),
        ("on the rise", table[steep]),
    ):
        mean_square = float((rows["rmse"] ** 2).mean())
        rmse = np.sqrt(mean_square)
        # The checkpoints of a run are far apart in time, and nearly independent.
        error = np.sqrt(np.sum((rows["rmse"] * rows["rmse_se"]) ** 2)) / (len(rows) * rmse)
        ours, ours_error = 100 * rmse / largest, 100 * error / largest
        bias = 100 * rows["bias"].abs().max() / largest
        found.append(
            Claim(
                FANG2018,
                f"d mu/d v_s by Eq. 11 agrees with the true slope {words} "
                f"(RMSE below {_AGREEMENT:g} % of the largest slope)",
                float("nan"),
                float(ours),
                float(ours_error),
                "% of the largest slope",
                verdict_below(float(ours), float(ours_error), _AGREEMENT),
                f"{len(rows)} moments of a wheel that passes the peak and comes back; the largest "
                f"bias, a lag behind a slope that changes, is {bias:.3g} %. "
                "The paper prints neither gamma nor the filter; they are our reading.",
            )
        )
    return found
