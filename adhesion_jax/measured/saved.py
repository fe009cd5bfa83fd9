"""Curves from the tables that an identification has written."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from adhesion_jax.curves import CURVES, Curve, with_free_values
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed


class SavedCurve(NamedTuple):
    """The curve nearest to a fitted law, and how far that law leaves it, relative (rms)."""

    curve: Curve
    misfit: float


def load_curve(path: Path, names: Sequence[str] = ()) -> SavedCurve:
    """The best curve by log_density in a curves.csv, of these names or of all that have a peak.

    Its parameters stand in parameters.csv beside it. InputError if the files hold no such curve.
    """
    beside = path.with_name("parameters.csv")
    try:
        table, parameters = pd.read_csv(path), pd.read_csv(beside)
    except FileNotFoundError:
        if not path.exists():
            raise InputError(f"{path} does not exist; name a curves.csv.") from None
        raise InputError(
            f"{beside} does not exist, which adhesion identify writes beside {path.name} with the "
            "parameters of the curves; identify anew, or copy both."
        ) from None
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); name a curves.csv.") from None
    except ValueError:  # no text, or no table
        raise _no_table(path) from None
    told = {"curve", "log_density", "slip_opt_se", "misfit"} <= {*table.columns}
    if not told or not {"curve", "parameter", "value"} <= {*parameters.columns}:
        raise _no_table(path)
    rows = table[table["log_density"].notna() & table["curve"].isin(CURVES)]
    lacking = [name for name in names if name not in {*rows["curve"]}]
    if lacking:
        fitted = ", ".join(rows["curve"]) or "none"
        raise InputError(
            f"{path} has no fitted curve {listed(lacking)}; the curves there are {fitted}."
        )
    # An empty error of the slip says that there is no peak.
    rows = rows[rows["curve"].isin(names) if names else np.isfinite(rows["slip_opt_se"])]
    if rows.empty:
        raise InputError(f"{path} has no curve with a peak; identify one from other data.")
    name = str(rows.set_index("curve")["log_density"].idxmax())
    known, misfit = CURVES[name], rows.set_index("curve")["misfit"].loc[name]
    try:
        own = parameters[parameters["curve"] == name].set_index("parameter")["value"]
        values = own[[*known.free]].to_numpy(float)
    except (KeyError, ValueError):
        raise _no_table(path) from None
    if not np.all(np.isfinite(values)):
        raise _no_table(path)
    return SavedCurve(with_free_values(known, values), float(misfit))


def _no_table(path: Path) -> InputError:
    return InputError(
        f"{path} is not a table of curves written by adhesion identify; name its curves.csv."
    )
