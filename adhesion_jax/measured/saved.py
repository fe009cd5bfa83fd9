"""Curves from the tables that an identification has written."""

from pathlib import Path

import numpy as np
import pandas as pd

from adhesion_jax.curves import CURVES, Curve, with_free_values
from adhesion_jax.errors import InputError


def load_curve(path: Path, name: str | None = None) -> Curve:
    """The curve of this name in a curves.csv, or the best by log_density that has a peak there.

    Its parameters stand in parameters.csv beside it. InputError if the files hold no such curve.
    """
    try:
        table = pd.read_csv(path)
        parameters = pd.read_csv(path.with_name("parameters.csv"))
    except FileNotFoundError as error:
        raise InputError(f"{error.filename} does not exist; name a curves.csv.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); name a curves.csv.") from None
    except ValueError:  # no text, or no table
        raise _no_table(path) from None
    told = {"curve", "log_density", "slip_opt_se"} <= {*table.columns}
    if not told or not {"curve", "parameter", "value"} <= {*parameters.columns}:
        raise _no_table(path)
    rows = table[table["log_density"].notna() & table["curve"].isin(CURVES)]
    if name is None:
        rows = rows[np.isfinite(rows["slip_opt_se"])]  # empty where there is no peak
        if rows.empty:
            raise InputError(f"{path} has no curve with a peak; identify one from other data.")
        name = str(rows.loc[rows["log_density"].idxmax(), "curve"])
    row = rows[rows["curve"] == name]
    if row.empty:
        fitted = ", ".join(rows["curve"]) or "none"
        raise InputError(f"{path} has no fitted curve {name}; the curves there are {fitted}.")
    known = CURVES[name]
    try:
        own = parameters[parameters["curve"] == name].set_index("parameter")["value"]
        values = own[[*known.free]].to_numpy(float)
    except (KeyError, ValueError):
        raise _no_table(path) from None
    if not np.all(np.isfinite(values)):
        raise _no_table(path)
    return with_free_values(known, values)


def _no_table(path: Path) -> InputError:
    return InputError(
        f"{path} is not a table of curves written by adhesion identify; name its curves.csv."
    )
