"""The accuracy of an identifier: bias, RMSE, coverage and failures."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from adhesion_jax.metrics.moments import Moments

Array = NDArray[np.float64]

#: A fit fails if its sum of squares exceeds the optimum by more than this multiple of sigma^2.
FAILURE_GAP = 1.0

#: If more than this share of the runs touch the box, an RMSE below the bound is due to truncation.
_BOX_SHARE = 0.01

#: Two sums of squares whose gap is below this are equal within rounding (for data without noise).
_ROUNDING = 1e-12


class Outcome(NamedTuple):
    """Estimates of one identifier on some runs: arrays [runs, blocks] or [runs, blocks, values]."""

    values: Array
    standard_errors: Array
    robust: Array  # half widths of 95 % intervals that hold whatever noise and misfit, or NaN
    on_box: NDArray[np.bool_]
    unusable: NDArray[np.bool_]  # no peak, inadmissible or not finite, by status or value
    objective: Array
    optimum: Array  # objective of the exact maximum likelihood on the same data
    optimum_on_box: NDArray[np.bool_]  # whether that optimum lies on the box
    evaluations: Array
    delay: Array  # steps until the rail is tracked, [runs, stretches]


class Truth(NamedTuple):
    """The true values and bounds that the estimates are compared with."""

    names: tuple[str, ...]
    values: Array  # [blocks, values]
    bound: Array  # Cramer-Rao bound, [runs, blocks, values]
    sigma: float
    quantile: Array  # of Student's t, of the 95 % intervals, [blocks]


def run_statistics(
    outcome: Outcome, truth: Truth, blocks: tuple[int, ...], switched: int | None
) -> Mapping[str, Array]:
    """The statistics of each run, averaged over `blocks`; their means over runs are the metrics.

    Failures are part of every mean. Beside a coverage stands the share of estimates that have a
    standard error. `switched` is the stretch whose delay belongs to the row; without one it is NaN.
    """
    b = list(blocks)
    error = outcome.values[:, b] - truth.values[b]

    def covered(name: str, half_width: Array) -> dict[str, Array]:
        held, given = np.abs(error) <= half_width, np.isfinite(half_width)
        return {name: held.mean(axis=1), f"{name}_given": given.mean(axis=1)}

    gap = outcome.objective[:, b] - outcome.optimum[:, b]
    failed = outcome.unusable[:, b] | ~(gap <= FAILURE_GAP * truth.sigma**2 + _ROUNDING)
    unknown = np.full(len(outcome.delay), np.nan)
    return {
        "error": error.mean(axis=1),
        "squared_error": (error**2).mean(axis=1),
        "squared_bound": (truth.bound[:, b] ** 2).mean(axis=1),
        **covered("covered", truth.quantile[b][:, None] * outcome.standard_errors[:, b]),
        **covered("covered_robust", outcome.robust[:, b]),
        "on_box": outcome.on_box[:, b].mean(axis=1),
        "optimum_on_box": outcome.optimum_on_box[:, b].mean(axis=1),
        "failed": failed.mean(axis=1),
        "evaluations": outcome.evaluations[:, b].mean(axis=1),
        "delay": unknown if switched is None else outcome.delay[:, switched].astype(float),
    }


def table_rows(
    moments: Moments, truth: Truth, blocks: tuple[int, ...], seconds: Moments
) -> dict[str, Any]:
    """The columns of a table with one row for each quantity, in the unit of the quantity.

    A quantity of which no standard error is ever given has no coverage. `delay_steps` is the mean
    delay after a switch in steps: samples of a stream, or blocks. `seconds` are the moments of
    the time of one identification, over parts of the runs.
    """
    rmse = np.sqrt(moments.mean("squared_error"))
    rmse_se = moments.standard_error("squared_error") / (2 * np.where(rmse > 0, rmse, np.nan))
    bound = np.sqrt(moments.mean("squared_bound"))
    share = float(moments.mean("on_box"))
    # An estimate is truncated if the optimum lies on the box, even if the solver stopped inside.
    truncated = max(share, float(moments.mean("optimum_on_box")))
    comparable = (bound > 0) & (truncated <= _BOX_SHARE)

    def coverage(name: str) -> Array:
        told = [moments.mean(name), moments.standard_error(name)]
        return np.where(moments.mean(f"{name}_given") > 0, told, np.nan)

    plain, robust = coverage("covered"), coverage("covered_robust")
    with np.errstate(divide="ignore", invalid="ignore"):
        efficiency = np.where(comparable, rmse / bound, np.nan)
        efficiency_se = np.where(comparable, rmse_se / bound, np.nan)
    return {
        "quantity": truth.names,
        "truth": truth.values[list(blocks)].mean(axis=0),
        "bias": moments.mean("error"),
        "bias_se": moments.standard_error("error"),
        "rmse": rmse,
        "rmse_se": rmse_se,
        "crlb": bound,
        "rmse_over_crlb": efficiency,
        "rmse_over_crlb_se": efficiency_se,
        "coverage95": plain[0],
        "coverage95_se": plain[1],
        "coverage95_robust": robust[0],
        "coverage95_robust_se": robust[1],
        "at_bound_share": share,
        "at_bound_share_se": float(moments.standard_error("on_box")),
        "failure_share": float(moments.mean("failed")),
        "failure_share_se": float(moments.standard_error("failed")),
        "delay_steps": float(moments.mean("delay")),
        "delay_steps_se": float(moments.standard_error("delay")),
        "runs": moments.runs,
        "seconds_per_identification": float(seconds.mean("seconds")),
        "seconds_per_identification_se": float(seconds.standard_error("seconds")),
        "evaluations": float(moments.mean("evaluations")),
        "evaluations_se": float(moments.standard_error("evaluations")),
    }
