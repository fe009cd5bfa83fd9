"""The tables and the page of a measured record: the one answer, and a row for each curve."""

import textwrap
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import pandas as pd

from adhesion_jax.data import Measured
from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.measured.answer import Estimate
from adhesion_jax.report.measured.words import (
    Identified,
    different_rails,
    reasons,
    verdict,
    weights_of,
)
from adhesion_jax.report.page import CAPTIONS, Page, Table, table_of
from adhesion_jax.report.rendering import page_of, text_of
from adhesion_jax.report.text import WIDTH, flush_left, in_columns
from adhesion_jax.wording import number, plus_minus


def answer_lines(found: Identified) -> str:
    """The peak by all curves together, for a terminal; before it what must be said first."""
    told = text_of(
        "answer.txt",
        answer=found.answer,
        fit=found.fit,
        judgement=found.judgement,
        weights=weights_of(found.answer),
        interval=_interval,
        wrapped=_wrapped,
    )
    first = different_rails(found.comparison, found.groups, found.mixed)
    return f"{_wrapped(first)}\n\n{told}" if first else told


def _wrapped(words: str) -> str:
    return textwrap.fill(words, WIDTH, break_on_hyphens=False)


def _interval(found: Estimate) -> str:
    half = 0.5 * (found.high - found.low)
    if np.isnan(half):
        return "not known"
    digits = 4 if half <= 0 else int(np.clip(1 - np.floor(np.log10(half)), 2, 7))
    return f"{found.value:.{digits}f} [{found.low:.{digits}f}, {found.high:.{digits}f}]"


def curve_rows(found: Identified) -> pd.DataFrame:
    """One row for each curve; NaN where a quantity does not apply.

    Columns: curve, rms, slip_opt, slip_opt_se, mu_max, mu_max_lo, mu_max_hi (95 %), status, the
    weight in the answer, log_density (of what was left out, less what the departure costs), the
    noise (sigma, autocorrelation, run_scatter and slow_level, the last two relative), the departure
    (misfit, relative), and the degrees of freedom of the interval.
    """
    rows: list[dict[str, object]] = []
    for name, fit in found.fits.items():
        mu_max, (low, high) = float(fit.peak.adhesion), fit.interval
        one: dict[str, object] = {
            "curve": name,
            "rms": fit.rms,
            "slip_opt": float(fit.peak.slip),
            "slip_opt_se": fit.slip_opt_se,
            "mu_max": mu_max,
            "mu_max_lo": low,
            "mu_max_hi": high,
            "status": f"{fit.status.name}: {' '.join(reasons(fit))}",
            "weight": found.answer.weights[name],
            "log_density": fit.log_density,
            "sigma": fit.noise.sigma,
            "autocorrelation": fit.noise.autocorrelation,
            "run_scatter": fit.noise.run_scatter,
            "slow_level": fit.noise.slow_level,
            "misfit": fit.misfit,
            "degrees": fit.degrees,
        }
        rows.append(one)
    rows += [
        {"curve": name, "status": f"NOT_FITTED: it needs the column {' and '.join(columns)}."}
        for name, columns in found.not_fitted.items()
    ]
    return pd.DataFrame(rows)


def parameter_rows(fits: Mapping[str, MeasuredFit]) -> pd.DataFrame:
    """One row for each parameter of each curve: curve, parameter, value, se, unit, meaning.

    The standard error is NaN where the parameter is held, on its bound or without influence.
    """
    rows = [
        (name, parameter, value, error, known.unit, known.meaning)
        for name, fit in fits.items()
        for parameter, value, error in _parameters(fit)
        for known in [fit.curve.PARAMETERS[parameter]]
    ]
    return pd.DataFrame(rows, columns=["curve", "parameter", "value", "se", "unit", "meaning"])


def _parameters(fit: MeasuredFit) -> Iterator[tuple[str, float, float]]:
    """The name, the value and the standard error of each."""
    values, errors = fit.parameters.tolist(), fit.standard_errors.tolist()
    return zip(fit.curve.free, values, errors, strict=True)


def short_report(found: Identified) -> str:
    """The lines of the answer and, of the best curve, what it is worth and its parameters."""
    fit = found.fit
    lines = [
        answer_lines(found),
        f"{found.best}: rms {fit.rms:.3g} over {fit.points} points, {fit.status.name}",
    ]
    for parameter, value, error in _parameters(fit):
        known = fit.curve.PARAMETERS[parameter]
        told = _with_error(value, error) + (f" {known.unit}" if known.unit != "1" else "")
        lines.append(f"  {parameter:<12} {told:<24} {known.meaning}")
    return "\n".join(lines)


def _with_error(value: float, error: float) -> str:
    return plus_minus(value, error) + ("" if np.isfinite(error) else " (held)")


def printed_table(found: Identified) -> str:
    """The curves, the one that predicts best first, aligned for a terminal."""
    most = found.fit.log_density
    summary, parameters = [], []
    for name in found.ranked:
        fit = found.fits[name]
        low, high = fit.interval
        slip_opt = (
            f"{plus_minus(float(fit.peak.slip), fit.slip_opt_se)}{fit.slip_unit}"
            if fit.peak.found
            else "no peak"
        )
        summary.append(
            {
                "curve": name,
                "rms": f"{fit.rms:.5f}",
                "departure": f"{100 * fit.misfit:.1f} %",
                "log density": f"{fit.log_density - most:.1f}",
                "weight": f"{found.answer.weights[name]:.2f}",
                "peak at slip": slip_opt,
                "mu_max": f"{float(fit.peak.adhesion):.4f} [{low:.4f}, {high:.4f}]",
                "status": fit.status.name,
            }
        )
        parameters.append(
            {
                "curve": name,
                "parameters ± standard errors": "  ".join(
                    f"{parameter} {_with_error(value, error)}"
                    for parameter, value, error in _parameters(fit)
                ),
            }
        )
    return "\n\n".join(flush_left(pd.DataFrame(rows)) for rows in (summary, parameters))


def understood(measured: Measured) -> str:
    """How many rows are used, the table of the columns, and the notes."""
    used = f"{measured.name}: {len(measured.table):,} rows are used."
    return "\n".join([used, columns_table(measured.understood), *measured.notes])


def columns_table(understood: pd.DataFrame) -> str:
    """A line for each column: what it is taken as, its unit, range and share missing.

    The range is in the unit beside it, which is that of the file.
    """
    rows = []
    for column, taken_as, unit, lowest, highest, missing in understood.to_numpy():
        span = f"{number(lowest)} to {number(highest)}" if number(lowest) else ""
        rows.append((column, taken_as, unit, span, f"{100 * missing:.3g} %"))
    return in_columns(Table(("column", "taken as", "unit", "range", "missing"), rows))


#: Columns of the table of curves that the page shows; the others are in curves.csv.
_SHOWN = ("curve", "rms", "slip_opt", "mu_max", "mu_max_lo", "mu_max_hi", "weight", "status")


def page(found: Identified, files: Sequence[str]) -> Page:
    """The answer, what forbids it, the pictures in files, the verdict, and the curves."""
    curves = curve_rows(found)
    return page_of(
        "identify_page.txt",
        f"Adhesion of {found.title}",
        answer_lines(found),
        CAPTIONS["identify"],
        sections=verdict(found),
        curves=table_of(curves[[name for name in _SHOWN if name in curves]]),
        files=files,
    )
