"""A plan in words and tables: the noise, the errors, what they rest on, what would be enough."""

import numpy as np
import pandas as pd

from adhesion_jax.inference.noise import RunNoise
from adhesion_jax.planning.excitation import Sweeps
from adhesion_jax.planning.own_log import OwnLog
from adhesion_jax.planning.plan import ROUGH, UNDETERMINED, Plan, Present, Wanted
from adhesion_jax.planning.truth import curve_of
from adhesion_jax.report.text import filled, with_errors
from adhesion_jax.wording import listed, number

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
    peak, unit = plan.planner.peak, plan.planner.truth.slip_unit
    free = curve_of(plan.planner.truth.law).free
    parts = [
        filled(
            f"Taken for the truth: {source}, mu_max {number(peak.mu_max)} at slip "
            f"{number(peak.slip_opt)}{unit}; unknown: {listed(free)}."
        ),
        filled(_noise_sentences(plan.planner.noise, log)),
        filled(_excitation_sentences(plan, log)),
    ]
    for place, name in enumerate(QUANTITIES):
        parts.append(f"\nRelative standard error of {name} (%)\n{_table(plan, place)}")
    parts += ["", *map(filled, _remarks(plan))]
    if log is not None and log.misfit >= _SLIGHT:
        misses = (
            f"The curve misses {per_cent(log.misfit)} % of the adhesion of this log. That is no "
            "part of the plan: the intervals of adhesion identify contain it and are wider."
        )
        parts.append(filled(misses))
    if present is not None:
        parts += ["", *map(filled, _present_sentences(plan, present))]
    if wanted is not None:
        parts += ["", filled(_wanted_sentences(plan, wanted)), _wanted_table(plan, wanted)]
    return "\n".join(parts)


def checked(cells: pd.DataFrame) -> str:
    """What simulated measurements say of a plan, as `planning.check.check_plan` tells it."""
    if cells.empty:
        return (
            "No cell of this plan knows slip_opt well enough for a check; go further in slip or "
            "plan for more samples."
        )
    shown = {
        "largest slip": cells["largest_slip"].map(number),
        "samples": cells["samples"].map("{:,}".format),
        "planned (%)": cells["planned"].map(per_cent),
        "simulated (%)": cells["simulated"].map(per_cent),
        "simulated / planned": with_errors(cells["ratio"], cells["ratio_se"]),
        "bias (standard errors)": cells["bias"].map("{:+.2f}".format),
        "fits without a peak": cells["failed"].astype(str),
    }
    table = pd.DataFrame(shown).to_string(index=False)
    measurements = f"{cells['measurements'].iloc[0]:,} simulated measurements"
    return f"Standard error of mu_max in {measurements}\n{table}"


def _noise_sentences(noise: RunNoise, log: OwnLog | None) -> str:
    if log is None:
        found = ""
    elif not log.in_time:
        found = (
            " The log has no column time_s, so that neighbouring samples are taken as independent."
        )
    else:
        found = " What was not stated is that of the fit to the log."
    parts = [
        f"standard deviation {number(noise.sigma)} in adhesion",
        f"correlation {number(noise.autocorrelation)} from sample to sample"
        if noise.autocorrelation
        else "independent from sample to sample",
        f"levels of runs that scatter by {per_cent(noise.run_scatter)} % of the adhesion"
        if noise.run_scatter
        else "no scatter between runs",
        *(
            [
                f"a level that varies within a run by {per_cent(noise.slow_level)} % of the "
                f"adhesion, with a correlation that falls to 1/e after {number(noise.slow_rows)} "
                "samples"
            ]
            if noise.slow_level
            else []
        ),
        f"standard deviation {number(noise.slip_noise)} in slip"
        if noise.slip_noise
        else "an exact slip",
    ]
    return f"Noise: {listed(parts)}.{found}"


def _excitation_sentences(plan: Plan, log: OwnLog | None) -> str:
    design = plan.planner.design
    if log is None:
        assert isinstance(design, Sweeps)
        return (
            f"Samples: runs of {design.samples_per_run} samples, in each of which the slip rises "
            "from 0 to the largest in equal steps; fewer samples than that are one run."
        )
    runs = "one run" if log.runs == 1 else f"{log.runs} runs"
    return (
        f"Samples: those of the log ({log.samples:,} in {runs}, up to slip "
        f"{number(log.largest_slip)}{log.truth.slip_unit}), as often as needed; to reach another "
        "largest slip, all slips are stretched by one factor."
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


def _remarks(plan: Plan) -> list[str]:
    """What the figures of the tables rest on."""
    errors, peak = plan.errors, plan.planner.peak
    unit = plan.planner.truth.slip_unit
    remarks = []
    if np.any(~(errors <= UNDETERMINED)):
        remarks.append(
            f"n.d.: not determined, the standard error is above {100 * UNDETERMINED:g} % of the "
            "value: so few samples, or such small slips, leave the parameters of the curve open."
        )
    if np.any((errors[..., 1] > ROUGH) & (errors[..., 0] <= UNDETERMINED)):
        remarks.append(
            f"In parentheses: slip_opt is known to no better than {100 * ROUGH:g} %. The figures "
            "are those of small errors; there they are rough, and some fits find no peak at all."
        )
    short = plan.largest_slips < peak.slip_opt
    if short.any():
        remarks.append(
            f"Largest slips below that of the peak, {number(peak.slip_opt)}{unit}, extrapolate: "
            "their figures hold only if the form of the curve is right, which such samples cannot "
            "show."
        )
    remarks.append(
        "The figures are the errors of a fit by least squares that weights samples as adhesion "
        "identify does: by the noise of the slip, not by what neighbours have in common. Errors of "
        "the slip are taken to the first order, and the curve is assumed to be of the right form; "
        "where adhesion identify lets it bend, its intervals are wider."
    )
    if plan.planner.noise.slip_noise > 0:
        remarks.append(
            "A fit that takes the noisy slip as exact is biased beside this, for the mean of a "
            "bent curve is not the curve of the mean; --check shows by how much. adhesion identify "
            "corrects for it where it knows the noise."
        )
    return remarks


def _present_sentences(plan: Plan, present: Present) -> list[str]:
    unit = plan.planner.truth.slip_unit
    values = (plan.planner.peak.mu_max, plan.planner.peak.slip_opt)
    sentences = []
    for name, value, error, further in zip(
        QUANTITIES, values, present.errors, present.further, strict=True
    ):
        if not error <= UNDETERMINED:
            sentences.append(f"{name}: the log does not determine it.")
            continue
        half = _QUANTILE * error * value
        slip = f"{number(present.largest_slip)}{unit}"
        sentences.append(
            f"To halve the 95 % interval of {name} (now {number(value)} ± {half:.2g}, "
            f"{per_cent(error)} % standard error), take four times as many samples at the same "
            f"slips ({4 * present.runs:,} runs like these)"
            + (
                f", or go on to a slip of {further:.2g}{unit} instead of {slip} with as many."
                if further is not None
                else f"; with as many, no slip beyond {slip} does it."
            )
        )
    return sentences


def _wanted_sentences(plan: Plan, wanted: Wanted) -> str:
    aim = (
        f"A standard error of {per_cent(wanted.error)} % of mu_max, with one of at most "
        f"{100 * ROUGH:g} % of slip_opt,"
    )
    if not np.isfinite(wanted.cheapest):
        return f"{aim} is not reached by any number of samples up to these slips."
    runs = plan.planner.design(wanted.cheapest).runs
    return (
        f"{aim} takes at least {wanted.cheapest:,.0f} samples ({runs:.3g} "
        f"run{'s' if runs != 1 else ''}), with slips up to {wanted.cheapest_slip:.2g}"
        f"{plan.planner.truth.slip_unit}. The fewest samples for each largest slip:"
    )


def _wanted_table(plan: Plan, wanted: Wanted) -> str:
    cells = {
        "largest slip": [number(slip) for slip in plan.largest_slips],
        "samples": [
            f"{samples:,.0f}" if np.isfinite(samples) else "not reached"
            for samples in wanted.samples
        ],
    }
    return pd.DataFrame(cells).to_string(index=False)
