"""The tables of a discovery as numbers, for programs; `tables` has them for a reader."""

import numpy as np
import pandas as pd

from adhesion_jax.discovery.types import Candidate, Findings
from adhesion_jax.report.discovery.tables import ranking
from adhesion_jax.report.discovery.words import errors_by_data

_EFFECT_COLUMNS = (
    *("effect", "explained", "acts_on", "parameter", "value", "lo", "hi", "unit"),
    *("p_adjusted", "rmse_after", "candidates", "columns", "sentence"),
)


def errors_frame(findings: Findings) -> pd.DataFrame:
    """A row for each kind of data: its runs, and the errors with the ends of their intervals."""
    rows: list[dict[str, object]] = []
    for kind, errors in errors_by_data(findings).items():
        row: dict[str, object] = {"data": kind, "runs": errors.runs}
        for name in ("before", "after", "removed"):
            interval = getattr(errors, name)
            row[name] = interval.value
            row[f"{name}_lo"], row[f"{name}_hi"] = interval.low, interval.high
        rows.append(row)
    return pd.DataFrame(rows)


def effects_frame(findings: Findings) -> pd.DataFrame:
    """A row for each parameter of an effect; of a structure without a cause one row in all."""
    rows: list[tuple[object, ...]] = []
    for effect in (*findings.effects, *findings.unexplained):
        explained = effect in findings.effects
        known = [
            (name, *interval, effect.units.get(name, ""))
            for name, interval in (effect.parameters if explained else {}).items()
        ] or [("", np.nan, np.nan, np.nan, "")]
        first = (effect.name, explained, effect.acts_on)
        last = (
            *(effect.p_adjusted, effect.rmse_after),
            *(", ".join(effect.candidates), ", ".join(effect.covariates), effect.sentence),
        )
        rows += [(*first, *one, *last) for one in known]
    return pd.DataFrame(rows, columns=list(_EFFECT_COLUMNS))


def ranking_frame(findings: Findings) -> pd.DataFrame:
    """A row for each candidate, in the order of `ranking`; the columns are those of Candidate."""
    return pd.DataFrame(ranking(findings), columns=list(Candidate._fields))
