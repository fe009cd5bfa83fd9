"""Qian et al. 2024: accuracy at three moments, Algorithm 1 against 2, and which change does it.

The paper draws its curves without their parameters, and prints neither its noise nor the gain and
the critical interval of its method: each claim is judged over settings of these.
"""

from collections.abc import Callable
from itertools import product

import numpy as np
import pandas as pd

from adhesion_jax.campaign.job import Config
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.identifiers.qp_qian2024 import QuadraticProgram, variant
from adhesion_jax.scenarios import Options
from experiments.claims.claim import ASSUMED, Claim, judged, of_settings
from experiments.claims.qian2024_settings import Outcomes
from experiments.claims.settings import Numbers

QIAN2024 = "Qian et al. 2024"

#: Quantity, samples seen, and the paper's error in per cent.
READINGS = (("p1", 30, 1.0), ("p2", 250, 1.0), ("mu_max", 230, 0.1))

#: The three things in which Algorithm 1 differs from 2: the setting of 2, that of 1.
FACTORS = {
    "weight": ("1", "(2-eta)/2"),
    "eta from": ("0.971", "0.251"),
    "redistribution": ("no", "yes"),
}

#: The outcomes, by column of the table of variants.
OUTCOMES = {
    "rmse": "RMSE of mu_max before the switch",
    "delay": "mean delay after the switch",
    "rmse_outliers": "RMSE of mu_max before the switch, 3 % outliers",
}


def variants() -> dict[str, QuadraticProgram]:
    """All eight combinations of the factors; a name has 1 where the setting is Algorithm 1's."""
    found = {}
    for weight, low, shared in product((0, 1), repeat=3):
        name = f"qp-{weight}{low}{shared}"
        found[name] = variant(bool(weight), (0.971, 0.251)[low], 1.0, bool(shared))
    return found


def reading_config(runs: int, seed: int) -> Config:
    return Config("qian2024", ("qp-qian2024-1", "riv"), Options(), runs, seed)


def reading_claims(config: Config, drawn: Outcomes, progress: Callable[[str], None]) -> list[Claim]:
    """The errors that are printed for three moments, against Algorithm 1 and the bound."""
    table = run_campaign(config, lambda _: None, progress).tables["checkpoints"]
    found = []
    for quantity, k, percent in READINGS:
        rows = table[(table["quantity"] == quantity) & (table["k"] == k)].set_index("identifier")
        share = 100 * rows[["rmse", "rmse_se", "crlb"]].div(rows["truth"], axis=0)
        ours, error, bound = map(float, share.loc["qp-qian2024-1"].to_numpy())
        peer = share["rmse"].to_dict()["riv"]
        of_settings_drawn = 100 * drawn.readings[quantity][1:]
        found.append(
            judged(
                QIAN2024,
                f"{quantity} is known to {percent:g} % after {k} samples (RMSE of Algorithm 1)",
                float(ours),
                "% of truth",
                of_settings(of_settings_drawn < percent),
                ASSUMED,
                f"At our setting no unbiased estimate can have less than {bound:.3g} %; riv has "
                f"{peer:.3g} %. The median of the settings is "
                f"{np.median(of_settings_drawn):.3g} %.",
                percent,
                float(error),
            )
        )
    return found


def factorial_configs(runs: int, seed: int) -> tuple[Config, Config]:
    """The switching stream without outliers and with."""
    names = tuple(variants())
    return (
        Config("qian2024-switch", names, Options(), runs, seed),
        Config("qian2024-switch", names, Options(outliers=0.03), runs, seed),
    )


def factorial_table(runs: int, seed: int, progress: Callable[[str], None]) -> pd.DataFrame:
    """A row for each variant: its settings, and each outcome with its standard error."""
    rows = pd.DataFrame(list(product((0, 1), repeat=3)), columns=list(FACTORS))
    rows.insert(0, "variant", list(variants()))
    for config, suffix in zip(factorial_configs(runs, seed), ("", "_outliers"), strict=True):
        campaign = run_campaign(config, lambda _: None, progress, identifiers=variants())
        summary = campaign.tables["summary"].query("quantity == 'mu_max'")
        dry = summary[summary["rail"] == "dry"].set_index("identifier").loc[rows["variant"]]
        rows[f"rmse{suffix}"] = (dry["rmse"] / dry["truth"]).to_numpy()
        rows[f"rmse{suffix}_se"] = (dry["rmse_se"] / dry["truth"]).to_numpy()
        tracking = campaign.tables["tracking"].query("rail == 'common'")
        tracking = tracking.set_index("identifier").loc[rows["variant"]]
        rows[f"delay{suffix}"] = tracking["delay_mean"].to_numpy()
        rows[f"delay{suffix}_se"] = tracking["delay_mean_se"].to_numpy()
    return rows


def effect(table: pd.DataFrame, factor: str, outcome: str) -> tuple[float, float]:
    """The ratio of an outcome with Algorithm 1's setting of a factor to that with 2's.

    The geometric mean over the settings of the other two factors. Its error takes the variants
    as independent; they see the same noise, so it is rather too large.
    """
    logarithm = np.log(table[outcome])
    sign = np.where(table[factor] == 1, 1.0, -1.0)
    relative = table[f"{outcome}_se"] / table[outcome]
    half = len(table) / 2
    ratio = float(np.exp(np.sum(sign * logarithm) / half))
    return ratio, ratio * float(np.sqrt(np.sum(relative**2))) / half


def factorial_claims(table: pd.DataFrame, drawn: Outcomes) -> list[Claim]:
    """Algorithm 1 against 2, then the three changes one by one."""
    first, second = table.iloc[-1], table.iloc[0]
    found = []
    for outcome, words in OUTCOMES.items():
        ratio = float(first[outcome] / second[outcome])
        error = ratio * float(
            np.hypot(*(row[f"{outcome}_se"] / row[outcome] for row in (first, second)))
        )
        values = getattr(drawn, outcome)
        found.append(
            _smaller(
                f"Algorithm 1 against 2: {words}",
                ratio,
                values[:, -1] / values[:, 0],
                f"{_number(outcome, first[outcome])} against {_number(outcome, second[outcome])} "
                "at our setting.",
                error,
            )
        )
    for factor, (before, after) in FACTORS.items():
        sign = np.where(table[factor] == 1, 1.0, -1.0) / (len(table) / 2)
        for outcome, words in OUTCOMES.items():
            ratio, error = effect(table, factor, outcome)
            found.append(
                _smaller(
                    f"{factor} {after} instead of {before}: {words}",
                    ratio,
                    np.exp(np.log(getattr(drawn, outcome)) @ sign),
                    "The paper changes weight, range and redistribution at once; this is the "
                    "geometric mean over the settings of the other two.",
                    error,
                )
            )
    return found


def other_claims(drawn: Outcomes) -> list[Claim]:
    """The fluctuation of the estimate, the filter that is announced, and S as printed."""
    fluctuation, filtered = drawn.fluctuation, drawn.filtered / drawn.waving
    acts = 100 * drawn.acts
    return [
        _smaller(
            "Algorithm 1 against 2: fluctuation of mu_max from sample to sample before the switch",
            float(fluctuation[0, -1] / fluctuation[0, 0]),
            fluctuation[:, -1] / fluctuation[:, 0],
            "Mean size of the change of the estimate from one sample to the next.",
        ),
        _smaller(
            "With an FIR filter of the signals (announced as the next step): RMSE of mu_max before "
            "the switch",
            float(filtered[0]),
            filtered,
            "Moving means over five samples of slip and of adhesion, before Algorithm 1, where "
            "slip goes up and down in 100 samples. Slips drawn anew at every sample cannot be "
            "filtered: the mean of the adhesion is not that at the mean of the slips.",
        ),
        judged(
            QIAN2024,
            "Weights are redistributed where S says so (Eq. 14 to 17 with variances as printed)",
            float(acts[0, 0]),
            "% of samples",
            of_settings(acts[1:, 0] > 0),
            ASSUMED,
            "S over variances has another unit than the interval; with standard deviations the "
            f"test acts in {acts[0, 1]:.1f} % of the samples at our setting, and in "
            f"{100 * np.mean(acts[1:, 1] > 0):.0f} % of the settings at all.",
        ),
    ]


def _smaller(words: str, ratio: float, drawn: Numbers, remark: str, error: float = np.nan) -> Claim:
    return judged(
        QIAN2024,
        f"{words} is smaller (ratio below 1)",
        ratio,
        "ratio (1)",
        of_settings(drawn[1:] < 1),
        ASSUMED,
        f"{remark} The settings have {np.quantile(drawn[1:], 0.1):.2g} to "
        f"{np.quantile(drawn[1:], 0.9):.2g}, from tenth to tenth.",
        error=error,
    )


def _number(outcome: str, value: float) -> str:
    return f"{value:.3g} samples" if outcome.startswith("delay") else f"{100 * value:.3g} %"
