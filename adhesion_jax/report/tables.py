"""Tables as a person reads them."""

import numpy as np
import pandas as pd


def _plus_minus(value: float, error: float) -> str:
    if not np.isfinite(value):
        return ""
    if not np.isfinite(error):
        return f"{value:.4g}"
    return f"{value:.4g} ± {error:.1g}"


def _percent_pairs(table: pd.DataFrame, column: str) -> list[str]:
    return [
        _percent(value) + (f" ± {100 * error:.1g}" if np.isfinite(error) else "")
        for value, error in zip(table[column], table[f"{column}_se"], strict=True)
    ]


def _percent(value: float) -> str:
    return "" if not np.isfinite(value) else f"{100 * value:.2f} %"


def accuracy_table(table: pd.DataFrame, quantities: tuple[str, ...] = ("mu_max",)) -> str:
    """An aligned table of how well each identifier knows some quantities, relative to the truth."""
    chosen = table[table["quantity"].isin(quantities)]
    lines = pd.DataFrame(
        {
            "rail": chosen["rail"],
            **({"k": chosen["k"]} if "k" in chosen else {}),
            "quantity": chosen["quantity"],
            "identifier": chosen["identifier"],
            "bias": (chosen["bias"] / chosen["truth"]).map(_percent),
            "RMSE": (chosen["rmse"] / chosen["truth"]).map(_percent),
            "bound": (chosen["crlb"] / chosen["truth"]).map(_percent),
            "RMSE/bound": _pairs(chosen, "rmse_over_crlb"),
            "coverage": _pairs(chosen, "coverage95"),
            "on box": chosen["at_bound_share"].map(_percent),
            "failed": _percent_pairs(chosen, "failure_share"),
            "delay": chosen["delay_blocks"].map(lambda x: "" if np.isnan(x) else f"{x:.3g}"),
            "us each": (1e6 * chosen["seconds_per_identification"]).map(lambda x: f"{x:.0f}"),
            "evaluations": chosen["evaluations"].map(lambda x: f"{x:.0f}"),
        }
    )
    order = {name: place for place, name in enumerate(dict.fromkeys(lines["rail"]))}
    keys = [lines["rail"].map(order)] + ([lines["k"]] if "k" in lines else [])
    lines = lines.iloc[np.lexsort([*reversed([k.to_numpy() for k in keys])])]
    return lines.to_string(index=False)


def _pairs(table: pd.DataFrame, column: str) -> list[str]:
    return [
        _plus_minus(value, error)
        for value, error in zip(table[column], table[f"{column}_se"], strict=True)
    ]
