"""The tables of a measured record: the one answer, a row for each curve, the printed table."""

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.measured.answer import Answer, Estimate
from adhesion_jax.measured.vetoes import Judgement
from adhesion_jax.report.measured.words import best_first, reasons, weights_of
from adhesion_jax.report.text import WIDTH, flush_left
from adhesion_jax.wording import plus_minus


def answer_lines(answer: Answer, fit: MeasuredFit, judgement: Judgement) -> str:
    """The peak by all curves together, for a terminal; `fit` is that of any of them."""
    unit = fit.slip_unit
    if judgement.vetoes:
        return "\n".join(
            (
                "mu_max    not known",
                "slip_opt  not known",
                *textwrap.wrap(" ".join(judgement.vetoes), WIDTH, break_on_hyphens=False),
            )
        )
    if judgement.at_least is not None:
        return "\n".join(
            (
                f"mu_max    at least {judgement.at_least.value:.4f} "
                f"(95 %: {judgement.at_least.low:.4f})",
                "slip_opt  no peak is seen among the points",
                *textwrap.wrap(judgement.why, WIDTH, break_on_hyphens=False),
            )
        )
    said = (
        "The peak with its 95 % interval, the choice of the curve included. Weights of the curves "
        f"by cross-validation: {weights_of(answer)}."
    )
    return "\n".join(
        (
            f"mu_max    {_interval(answer.mu_max)}",
            f"slip_opt  {_interval(answer.slip_opt)}{unit}",
            *textwrap.wrap(said, WIDTH, break_on_hyphens=False),
        )
    )


def _interval(found: Estimate) -> str:
    half = 0.5 * (found.high - found.low)
    if np.isnan(half):
        return "not known"
    digits = 4 if half <= 0 else int(np.clip(1 - np.floor(np.log10(half)), 2, 7))
    return f"{found.value:.{digits}f} [{found.low:.{digits}f}, {found.high:.{digits}f}]"


def curve_rows(
    fits: Mapping[str, MeasuredFit], not_fitted: Mapping[str, Sequence[str]], answer: Answer
) -> pd.DataFrame:
    """One row for each curve; NaN where a quantity does not apply.

    Columns: curve, rms, slip_opt, slip_opt_se, mu_max, mu_max_lo, mu_max_hi (95 %), status,
    each parameter with its standard error (`_se`), then the weight in the answer, log_density (of
    what was left out, less what the departure costs), the departure (misfit, relative), the
    degrees of freedom of the interval,
    and the noise: sigma, autocorrelation, run_scatter and slow_level (both relative). `not_fitted`
    names the columns that a curve needs and the data lack.
    """
    rows: list[dict[str, object]] = []
    noises: dict[str, dict[str, float]] = {}
    for name, fit in fits.items():
        mu_max, (low, high) = float(fit.peak.adhesion), fit.interval
        row: dict[str, object] = {
            "curve": name,
            "rms": fit.rms,
            "slip_opt": float(fit.peak.slip),
            "slip_opt_se": fit.slip_opt_se,
            "mu_max": mu_max,
            "mu_max_lo": low,
            "mu_max_hi": high,
            "status": f"{fit.status.name}: {' '.join(reasons(fit))}",
        }
        for parameter, value, error in zip(
            fit.curve.free, fit.parameters, fit.standard_errors, strict=True
        ):
            row[parameter] = value
            row[f"{parameter}_se"] = error
        noises[name] = {
            "weight": answer.weights[name],
            "log_density": fit.log_density,
            "sigma": fit.noise.sigma,
            "autocorrelation": fit.noise.autocorrelation,
            "run_scatter": fit.noise.run_scatter,
            "slow_level": fit.noise.slow_level,
            "misfit": fit.misfit,
            "degrees": fit.degrees,
        }
        rows.append(row)
    rows += [
        {"curve": name, "status": f"NOT_FITTED: it needs the column {' and '.join(columns)}."}
        for name, columns in not_fitted.items()
    ]
    table, noise = pd.DataFrame(rows), pd.DataFrame.from_dict(noises, orient="index")
    return table.join(noise, on="curve")


def printed_table(fits: Mapping[str, MeasuredFit], answer: Answer) -> str:
    """The curves, the one that predicts best first, aligned for a terminal."""
    ranked = best_first(fits)
    most = fits[ranked[0]].log_density
    summary, parameters = [], []
    for name in ranked:
        fit = fits[name]
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
                "weight": f"{answer.weights[name]:.2f}",
                "peak at slip": slip_opt,
                "mu_max": f"{float(fit.peak.adhesion):.4f} [{low:.4f}, {high:.4f}]",
                "status": fit.status.name,
            }
        )
        parameters.append(
            {
                "curve": name,
                "parameters ± standard errors": "  ".join(
                    f"{parameter} {plus_minus(value, error)}"
                    + ("" if np.isfinite(error) else " (held)")
                    for parameter, value, error in zip(
                        fit.curve.free, fit.parameters, fit.standard_errors, strict=True
                    )
                ),
            }
        )
    return "\n\n".join(flush_left(pd.DataFrame(rows)) for rows in (summary, parameters))
