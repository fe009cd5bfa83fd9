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
from experiments.claims.claim import Claim, Numbers, of_settings
from experiments.claims.qian2024_settings import PAPER, Outcomes

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
        others = 100 * drawn.readings[quantity][1:]
        facts = {"quantity": quantity, "k": k, "bound": bound, "peer": peer}
        facts |= {"median": np.median(others), "printed": percent}
        found.append(PAPER.judged("reading", ours, of_settings(others < percent), error, **facts))
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
        told = (_number(outcome, row[outcome]) for row in (first, second))
        facts = {"words": words, **dict(zip(("first", "second"), told, strict=True))}
        found.append(_smaller("algorithms", ratio, values[:, -1] / values[:, 0], error, **facts))
    for factor, (before, after) in FACTORS.items():
        sign = np.where(table[factor] == 1, 1.0, -1.0) / (len(table) / 2)
        for outcome, words in OUTCOMES.items():
            ratio, error = effect(table, factor, outcome)
            ratios = np.exp(np.log(getattr(drawn, outcome)) @ sign)
            facts = {"factor": factor, "before": before, "after": after, "words": words}
            found.append(_smaller("factor", ratio, ratios, error, **facts))
    return found


def other_claims(drawn: Outcomes) -> list[Claim]:
    """The fluctuation of the estimate, the filter that is announced, and S as printed."""
    fluctuation, filtered = drawn.fluctuation, drawn.filtered / drawn.waving
    calmer, acts = fluctuation[:, -1] / fluctuation[:, 0], 100 * drawn.acts
    deviations, share = acts[0, 1], 100 * np.mean(acts[1:, 1] > 0)
    variances = acts[:, 0]
    facts = {"deviations": deviations, "share": share}
    return [
        _smaller("fluctuation", calmer[0], calmer),
        _smaller("filter", filtered[0], filtered),
        PAPER.over_settings("redistribution", variances, variances > 0, **facts),
    ]


def _smaller(
    key: str, ratio: float, drawn: Numbers, error: float = np.nan, **facts: object
) -> Claim:
    """Whether a ratio is below 1 in the settings drawn, whatever it is at ours with many runs."""
    low, high = np.quantile(drawn[1:], (0.1, 0.9))
    return PAPER.judged(key, ratio, of_settings(drawn[1:] < 1), error, low=low, high=high, **facts)


def _number(outcome: str, value: float) -> str:
    return f"{value:.3g} samples" if outcome.startswith("delay") else f"{100 * value:.3g} %"
