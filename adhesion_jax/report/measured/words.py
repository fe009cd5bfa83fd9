"""What is said of a measured record: the answer, the verdict, rows of each curve, and the page."""

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd

from adhesion_jax.data import Measured
from adhesion_jax.data.events import Chosen
from adhesion_jax.identifiers.base import Status
from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.inference.noise import SlipNoise
from adhesion_jax.inference.sandwich import COSINES
from adhesion_jax.inference.weighing import EXACT
from adhesion_jax.measured.answer import Answer, Estimate, dependence, log_densities
from adhesion_jax.measured.comparison import Comparison
from adhesion_jax.measured.groups import Group
from adhesion_jax.measured.residual import Residual
from adhesion_jax.measured.vetoes import Judgement
from adhesion_jax.report.page import CAPTIONS, Page, Table, table_of
from adhesion_jax.report.rendering import (
    WIDTH,
    Sections,
    filled,
    flush_left,
    in_columns,
    page_of,
    sections_of,
    sentences_of,
    text_of,
)
from adhesion_jax.wording import listed, number, plus_minus

#: The residual is said to have structure if the likeness of its neighbours exceeds this number of
#: standard deviations.
_LIKENESS = 2.0

#: Least weight at which a curve is named as part of the answer.
_LEAST_NAMED = 0.005

#: Slip and adhesion are beyond their noise from this multiple of its standard deviation on.
_FAR = 4

#: Curves are told apart if their log densities differ by this multiple of its standard error.
_APART = 2.0

#: Autocorrelation, run scatter, slow level and departure below this are not worth a number.
_SLIGHT = 5e-4


@dataclass(frozen=True, eq=False, repr=False)
class Identified:
    """What measured points say of the peak, and of every curve that was fitted to them."""

    measured: Measured
    logs: Sequence[Chosen]
    citation: str
    fits: Mapping[str, MeasuredFit]
    not_fitted: Mapping[str, Sequence[str]]
    residuals: Mapping[str, Residual]
    answer: Answer
    judgement: Judgement
    slip: SlipNoise
    runs: Sequence[str]
    comparison: Comparison | None
    groups: Mapping[str, Group]
    branches: Comparison | None
    in_vain: Sequence[str] | None
    mixed: Comparison | None

    @property
    def title(self) -> str:
        return Path(self.measured.name).name

    @property
    def ranked(self) -> list[str]:
        """The names of the curves, the one that predicts best what was left out first."""
        densities = log_densities(self.fits)
        return sorted(self.fits, key=lambda name: -densities[name])

    @property
    def best(self) -> str:
        """The name of the curve that predicts best what was left out of its fit."""
        return self.ranked[0]

    @property
    def fit(self) -> MeasuredFit:
        """The fit of the best curve, with covariance, noise and status."""
        return self.fits[self.best]


def verdict(found: Identified) -> Sections:
    """The verdict in sentences under titles: what forbids an answer comes first."""
    ranked, fits, best, left = found.ranked, found.fits, found.fit, found.residuals[found.best]
    other = ranked[min(1, len(ranked) - 1)]
    second = fits[other]
    by_part = (best.left_out - second.left_out) / dependence(fits)
    densities = log_densities(fits)
    table = found.measured.table
    slips, adhesion = table[found.measured.slip], table["adhesion"]
    departure, at_slip = _departure(best, float(slips.abs().min()))
    spread = _FAR * float(np.median(best.slip_spread))
    beyond = (adhesion.abs() > _FAR * best.noise.sigma) & (slips.abs() > spread)
    mixed = different_rails(None, {}, found.mixed)
    told = {
        **vars(found),
        "citation": " ".join(filter(None, (*(log.sentence for log in found.logs), found.citation))),
        "left": left,
        "runs": len(found.runs),
        "ranked": ranked,
        "warnings": [*filter(None, [mixed, found.judgement.warning])],
        "braking": int(((slips < 0) & (adhesion < 0)).sum()),
        "apart": int((slips * adhesion < 0).sum()),
        "beyond_noise": int(((slips * adhesion < 0) & beyond).sum()),
        "departure": departure,
        "at_slip": at_slip,
        "gain": densities[found.best] - densities[other],
        "gain_se": float(np.sqrt(by_part.size) * np.std(by_part)),
        "weights": weights_of(found.answer),
        "exact_fit": best.rms <= EXACT * np.sqrt(np.mean(left.adhesion**2)),
        "compared": [(one, *_ends(one.table)) for one in (found.comparison, found.branches) if one],
        "untrusted": [
            (name, reasons(fits[name]))
            for name in ranked
            if fits[name].status is not Status.TRUSTED
        ],
        "exact": EXACT,
        "cosines": COSINES,
        "slight": _SLIGHT,
        "most_alike": _LIKENESS,
        "apart_errors": _APART,
        "far": _FAR,
    }
    return sections_of("identify.txt", **told)


def _ends(table: pd.DataFrame) -> tuple[pd.Series, pd.Series]:
    """The rows of the smallest and of the largest adhesion."""
    order = np.argsort(table["mu_max"].to_numpy())
    return table.iloc[order[0]], table.iloc[order[-1]]


def _departure(fit: MeasuredFit, smallest: float) -> tuple[float, float]:
    """How far the points leave the nearest curve where they do most, as a share; and the slip.

    `smallest` is the smallest size of a measured slip: below it there are no points.
    """
    slip = np.linspace(0.02, 1.0, 50) * fit.law.span.largest
    slip = slip[slip >= min(smallest, slip[-1])]
    alone = np.asarray(fit.curve(jnp.asarray(slip), fit.conditions))
    departure = (fit.law.at(slip).adhesion - alone) / np.abs(alone).max()
    most = int(np.argmax(np.abs(departure)))
    return float(departure[most]), float(slip[most])


def weights_of(answer: Answer) -> str:
    """The weights of the curves that are worth a name, the heaviest first."""
    weights = {name: weight for name, weight in answer.weights.items() if weight >= _LEAST_NAMED}
    heaviest = sorted(weights, key=lambda name: -weights[name])
    return listed([f"{name} {weights[name]:.2f}" for name in heaviest])


def in_lines(sections: Sections) -> str:
    """The verdict for a terminal and a text file."""
    return "\n".join(filled(f"{title}: {' '.join(sentences)}") for title, sentences in sections)


def reasons(fit: MeasuredFit) -> list[str]:
    """Every reason why a fit may not be trusted, as sentences; that of TRUSTED if there is none."""
    parameters = zip(fit.curve.free, fit.parameters, fit.on_bound, fit.no_influence, strict=True)
    told = sentences_of("reasons.txt", fit=fit, known=Status, parameters=[*parameters])
    return told or [Status.TRUSTED.sentence]


def different_rails(
    comparison: Comparison | None, groups: Mapping[str, Group], mixed: Comparison | None
) -> str:
    """What is said before one answer for rows of different rails; empty for most measurements."""
    return " ".join(sentences_of("rails.txt", comparison=comparison, groups=groups, mixed=mixed))


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
    densities = log_densities(found.fits)
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
            "log_density": densities[name],
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
    densities = log_densities(found.fits)
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
                "log density": f"{densities[name] - densities[found.best]:.1f}",
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
