"""The figures that moved since the baseline, as text."""

import numpy as np
import pandas as pd

from adhesion_jax.report.rendering import with_errors
from experiments.regression.compare import GONE, NEW, REGRESSIONS, SAME

#: Verdicts on an identifier that only one of the two tables has.
_WHOLE = {
    NEW: "is not in the baseline; --update adds it.",
    GONE: "is in the baseline but is no identifier any more; --update removes it.",
}


def moved_text(compared: pd.DataFrame) -> str:
    """An aligned table of all that is not the same, regressions first; then the count."""
    moved = compared[compared["verdict"] != SAME]
    bad = moved["verdict"].isin(REGRESSIONS)
    count = f"{bad.sum()} of {len(compared)} figures got worse."
    if not len(moved):
        return count
    moved = pd.concat([moved[bad], moved[~bad]])
    lines = pd.DataFrame(
        {
            **{name: moved[name] for name in ("verdict", "identifier", "scenario", "rail")},
            **{name: moved[name] for name in ("quantity", "statistic")},
            "baseline": with_errors(moved["baseline"], moved["baseline_se"]),
            "fresh": with_errors(moved["fresh"], moved["fresh_se"]),
            "p": [f"{p:.1g}" if np.isfinite(p) else "" for p in moved["p"]],
        }
    )
    sentences = [
        f"{name} {_WHOLE[verdict]}"
        for name, verdict, statistic in zip(
            moved["identifier"], moved["verdict"], moved["statistic"], strict=True
        )
        if statistic == ""
    ]
    return "\n".join([lines.to_string(index=False), "", *sentences, count])
