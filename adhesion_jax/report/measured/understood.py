"""How the columns of a measurement were understood, as a table for a terminal."""

import pandas as pd

from adhesion_jax.data import Measured
from adhesion_jax.wording import number


def understood(measured: Measured) -> str:
    """A line for each column: what it is taken as, its unit, range and share missing; notes."""
    table = measured.understood
    shown = pd.DataFrame(
        {
            "column": table["column"],
            "taken as": table["taken_as"],
            "unit": table["unit"],
            "range": [
                f"{number(lowest)} to {number(highest)}" if number(lowest) else ""
                for lowest, highest in zip(table["lowest"], table["highest"], strict=True)
            ],
            "missing": [f"{100 * share:.3g} %" for share in table["missing"]],
        }
    )
    used = f"{measured.name}: {len(measured.table):,} rows are used."
    return "\n".join([used, shown.to_string(index=False), *measured.notes])
