"""A plan in words and tables: the noise, the errors, what they rest on, what would be enough."""

import numpy as np
import pandas as pd

from adhesion_jax.planning.own_log import OwnLog
from adhesion_jax.planning.plan import ROUGH, UNDETERMINED, Plan, Present, Wanted
from adhesion_jax.planning.truth import curve_of
from adhesion_jax.report.rendering import text_of
from adhesion_jax.wording import number

#: Half the width of a 95 % interval in standard errors.
_QUANTILE = 1.96

#: A smaller misfit than this share of the adhesion is not worth a word.
_SLIGHT = 5e-4

QUANTITIES = ("mu_max", "slip_opt")

#: What a relative standard error is worth.
DETERMINED, ROUGHLY, NOT_DETERMINED = "determined", "rough", "not determined"


def plan_rows(plan: Plan) -> pd.DataFrame:
    """One row for each largest slip and number of samples.

    Columns: largest_slip, samples, runs, the relative standard error of mu_max and of slip_opt
    (`_relative_se`; infinite where the samples do not determine it) with what it is worth, and
    whether the peak lies beyond the slips.
    """
    rows = []
    for i, largest in enumerate(plan.largest_slips):
        for j, samples in enumerate(plan.samples):
            excitation = plan.planner.design(samples)
            row: dict[str, object] = {
                "largest_slip": largest,
                "samples": round(excitation.samples),
                "runs": excitation.runs,
            }
            for name, error in zip(QUANTITIES, plan.errors[i, j], strict=True):
                row[f"{name}_relative_se"] = error
                row[name] = worth(error, plan.errors[i, j, 1])
            row["peak_beyond_slips"] = largest < plan.planner.peak.slip_opt
            rows.append(row)
    return pd.DataFrame(rows)


def wanted_rows(plan: Plan, wanted: Wanted) -> pd.DataFrame:
    """One row for each largest slip: the fewest samples for the error that is wanted."""
    return pd.DataFrame(
        {
            "largest_slip": plan.largest_slips,
            "mu_max_relative_se": wanted.error,
            "samples": wanted.samples,
        }
    )


def worth(error: float, slip_opt_error: float) -> str:
    """What a relative standard error is worth, in a word."""
    if not error <= UNDETERMINED:
        return NOT_DETERMINED
    return ROUGHLY if slip_opt_error > ROUGH else DETERMINED


def per_cent(share: float) -> str:
    """A share in per cent with two digits."""
    value = 100 * share
    decimals = max(0, 1 - int(np.floor(np.log10(value)))) if 0 < value < np.inf else 0
    return f"{value:.{decimals}f}"


def told(
    source: str, plan: Plan, log: OwnLog | None, present: Present | None, wanted: Wanted | None
) -> str:
    """The whole plan for a terminal."""
    errors, planner = plan.errors, plan.planner
    values = (planner.peak.mu_max, planner.peak.slip_opt)
    quantities = (
        [
            (name, value, _QUANTILE * error * value, error, further)
            for name, value, error, further in zip(
                QUANTITIES, values, present.errors, present.further, strict=True
            )
        ]
        if present
        else []
    )
    return text_of(
        "plan.txt",
        source=source,
        plan=plan,
        log=log,
        present=present,
        wanted=wanted,
        free=curve_of(planner.truth.law).free,
        tables={name: _table(plan, place) for place, name in enumerate(QUANTITIES)},
        some_undetermined=np.any(~(errors <= UNDETERMINED)),
        some_rough=np.any((errors[..., 1] > ROUGH) & (errors[..., 0] <= UNDETERMINED)),
        quantities=quantities,
        reached=wanted and np.isfinite(wanted.cheapest),
        wanted_table=wanted and _wanted_table(plan, wanted),
        per_cent=per_cent,
        slight=_SLIGHT,
        undetermined=UNDETERMINED,
        rough=ROUGH,
    )


def _table(plan: Plan, quantity: int) -> str:
    unit = plan.planner.truth.slip_unit.strip()
    heading = f"largest slip{f' ({unit})' if unit else ''}"
    cells = {heading: [number(slip) for slip in plan.largest_slips]}
    for j, samples in enumerate(plan.samples):
        column = plan.errors[:, j]
        cells[f"{samples:,.0f}"] = [_cell(row[quantity], row[1]) for row in column.tolist()]
    lines = pd.DataFrame(cells).to_string(index=False).splitlines()
    return "\n".join([f"{'':{len(heading)}}  number of samples", *lines])


def _cell(error: float, slip_opt_error: float) -> str:
    word = worth(error, slip_opt_error)
    if word == NOT_DETERMINED:
        return "n.d."
    return f"({per_cent(error)})" if word == ROUGHLY else per_cent(error)


def _wanted_table(plan: Plan, wanted: Wanted) -> str:
    cells = {
        "largest slip": [number(slip) for slip in plan.largest_slips],
        "samples": [
            f"{samples:,.0f}" if np.isfinite(samples) else "not reached"
            for samples in wanted.samples
        ],
    }
    return pd.DataFrame(cells).to_string(index=False)
