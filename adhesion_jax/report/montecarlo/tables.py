"""The tables of a campaign as text."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from adhesion_jax.campaign.overview import OVERVIEW
from adhesion_jax.report.montecarlo.overview import text as overview_text
from adhesion_jax.report.rendering import with_errors
from adhesion_jax.wording import plus_minus


def _percent_pairs(table: pd.DataFrame, column: str) -> list[str]:
    return [
        f"{plus_minus(100 * value, 100 * error)} %" if np.isfinite(value) else ""
        for value, error in zip(table[column], table[f"{column}_se"], strict=True)
    ]


def _percent(value: float) -> str:
    return "" if not np.isfinite(value) else f"{100 * value:.2f} %"


def accuracy_table(table: pd.DataFrame, quantities: tuple[str, ...] = ("mu_max",)) -> str:
    """An aligned table of the errors of each identifier, relative to the truth."""
    chosen = table[table["quantity"].isin(quantities)]
    several = len(set(chosen["scenario"])) > 1
    lines = pd.DataFrame(
        {
            **({"scenario": chosen["scenario"]} if several else {}),
            "rail": chosen["rail"],
            **({"k": chosen["k"]} if "k" in chosen else {}),
            "quantity": chosen["quantity"],
            "identifier": chosen["identifier"],
            "bias": (chosen["bias"] / chosen["truth"]).map(_percent),
            "RMSE": (chosen["rmse"] / chosen["truth"]).map(_percent),
            "bound": (chosen["crlb"] / chosen["truth"]).map(_percent),
            "RMSE/bound": _pairs(chosen, "rmse_over_crlb"),
            "coverage": _pairs(chosen, "coverage95"),
            "robust": _pairs(chosen, "coverage95_robust"),
            "on box": chosen["at_bound_share"].map(_percent),
            "failed": _percent_pairs(chosen, "failure_share"),
            "delay": chosen["delay_steps"].map(lambda x: "" if np.isnan(x) else f"{x:.3g}"),
            "us each": (1e6 * chosen["seconds_per_identification"]).map(lambda x: f"{x:.0f}"),
            "evaluations": chosen["evaluations"].map(lambda x: f"{x:.0f}"),
        }
    )
    panels, _ = pd.factorize(pd.MultiIndex.from_frame(chosen[["scenario", "rail"]]))
    order = np.lexsort((chosen["k"], panels) if "k" in chosen else (panels,))
    return lines.iloc[order].to_string(index=False)


def tracking_text(table: pd.DataFrame) -> str:
    """An aligned table of delay, overshoot, resets and lag of methods on rails that change."""
    table = _on_changing(table)
    several = len(set(table["scenario"])) > 1
    return pd.DataFrame(
        {
            **({"scenario": table["scenario"]} if several else {}),
            "rail": table["rail"],
            "identifier": table["identifier"],
            "delay (median)": _pairs(table, "delay_median"),
            "unit": table["unit"],
            "never tracked": _percent_pairs(table, "never_tracked_share"),
            "overshoot": _percent_pairs(table, "overshoot"),
            "missed switches": _percent_pairs(table, "missed_share"),
            "false resets per 1000": _pairs(table, "false_resets_per_1000"),
            **({"lag": _pairs(table, "lag")} if table["lag"].notna().any() else {}),
        }
    ).to_string(index=False)


def told(tables: Mapping[str, pd.DataFrame], runs: int, scenarios: Sequence[str]) -> str:
    """The tables of a campaign for a terminal; of all scenarios that on which method when."""
    if OVERVIEW in tables:
        return overview_text(tables[OVERVIEW])
    words = f"mu_max over {runs} runs of {' and '.join(scenarios)}"
    texts = {"summary": accuracy_table, "switches": accuracy_table, "tracking": tracking_text}
    return "\n".join(
        f"\n{name}: {words}\n{text(tables[name])}"
        for name, text in texts.items()
        if name in tables and not (name == "tracking" and _on_changing(tables[name]).empty)
    )


def _on_changing(tracking: pd.DataFrame) -> pd.DataFrame:
    """The rows of rails that follow a switch, or drift."""
    return tracking[tracking["overshoot"].notna() | tracking["lag"].notna()]


def _pairs(table: pd.DataFrame, column: str) -> list[str]:
    return with_errors(table[column], table[f"{column}_se"])
