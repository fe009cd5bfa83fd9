"""The results of a measured record: a row for each curve, the printed table, the verdict."""

import textwrap
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from adhesion_jax.data import Measured
from adhesion_jax.identifiers.base import Status
from adhesion_jax.measured.fit import EXACT, MeasuredFit
from adhesion_jax.measured.residual import Residual
from adhesion_jax.wording import plus_minus

#: Smallest differences of BIC and the words for that evidence (Kass and Raftery 1995, J. Am. Stat.
#: Assoc. 90).
_EVIDENCE = ((10.0, "very strong"), (6.0, "strong"), (2.0, "positive"), (0.0, "hardly any"))

#: The residual is said to have structure if the likeness of its neighbours exceeds this number of
#: standard deviations.
_LIKENESS = 2.0

_WIDTH = 96


def curve_rows(
    fits: Mapping[str, MeasuredFit], not_fitted: Mapping[str, Sequence[str]]
) -> pd.DataFrame:
    """One row for each curve; NaN where a quantity does not apply.

    Columns: curve, rms, bic, slip_opt, slip_opt_se, mu_max, mu_max_lo, mu_max_hi (95 %), status,
    then each parameter with its standard error (`_se`). `not_fitted` names the columns that a curve
    needs and the data lack.
    """
    rows: list[dict[str, object]] = []
    for name, fit in fits.items():
        mu_max, half = float(fit.peak.adhesion), fit.quantile * fit.mu_max_se
        row: dict[str, object] = {
            "curve": name,
            "rms": fit.rms,
            "bic": fit.bic,
            "slip_opt": float(fit.peak.slip),
            "slip_opt_se": fit.slip_opt_se,
            "mu_max": mu_max,
            "mu_max_lo": mu_max - half,
            "mu_max_hi": mu_max + half,
            "status": f"{fit.status.name}: {' '.join(reasons(fit))}",
        }
        for parameter, value, error in zip(
            fit.curve.free, fit.parameters, fit.standard_errors, strict=True
        ):
            row[parameter] = value
            row[f"{parameter}_se"] = error
        rows.append(row)
    rows += [
        {"curve": name, "status": f"NOT_FITTED: it needs the column {' and '.join(columns)}."}
        for name, columns in not_fitted.items()
    ]
    return pd.DataFrame(rows)


def printed_table(fits: Mapping[str, MeasuredFit]) -> str:
    """The curves, the most likely first, aligned for a terminal."""
    ranked = _by_bic(fits)
    least = fits[ranked[0]].bic
    summary, parameters = [], []
    for name in ranked:
        fit = fits[name]
        low, high = _mu_max_interval(fit)
        slip_opt = (
            f"{plus_minus(float(fit.peak.slip), fit.slip_opt_se)}{fit.slip_unit}"
            if fit.peak.found
            else "no peak"
        )
        summary.append(
            {
                "curve": name,
                "rms": f"{fit.rms:.5f}",
                "BIC": f"{fit.bic:.1f}",
                "above best": f"{fit.bic - least:.1f}",
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
    return "\n\n".join(_aligned(pd.DataFrame(rows)) for rows in (summary, parameters))


def verdict(
    measured: Measured,
    citation: str,
    fits: Mapping[str, MeasuredFit],
    not_fitted: Mapping[str, Sequence[str]],
    left: Residual,
) -> str:
    """The verdict in words: the best curve, its peak, the structure of its residual, and doubts.

    `left` is the residual of the curve with the lowest BIC.
    """
    ranked = _by_bic(fits)
    paragraphs = [
        ("Data", _data_sentences(measured, citation, left)),
        ("Curve", _curve_sentences(fits, ranked)),
        ("Peak", _peak_sentences(fits[ranked[0]], left)),
        ("Residual", _residual_sentences(fits[ranked[0]], left)),
        ("Not to be trusted", _doubts(fits, ranked, not_fitted, left)),
    ]
    return "\n".join(
        textwrap.fill(f"{title}: {' '.join(sentences)}", _WIDTH, subsequent_indent="  ")
        for title, sentences in paragraphs
    )


def reasons(fit: MeasuredFit) -> list[str]:
    """Every reason why a fit may not be trusted, as sentences; that of TRUSTED if there is none."""
    sentences = []
    if fit.status in (Status.NOT_FINITE, Status.INADMISSIBLE):
        sentences.append(fit.status.sentence)
    if not fit.peak.found:
        sentences.append(
            f"Adhesion has no peak between slip 0 and {fit.slip_limit:g}{fit.slip_unit}; "
            "mu_max is the largest adhesion in that range."
        )
    if not np.all(np.isfinite(fit.covariance)):
        sentences.append("The data do not determine all parameters: there are no standard errors.")
    elif not fit.converged:
        sentences.append(
            "The solver stopped before it converged; the values are those of its last step."
        )
    for name, value, bound, unfelt in zip(
        fit.curve.free, fit.parameters, fit.on_bound, fit.no_influence, strict=True
    ):
        if bound:
            sentences.append(
                f"{name} lies on its bound {value:g}: it has no standard error, and those "
                "of the other parameters hold with it fixed there."
            )
        if unfelt:
            sentences.append(
                f"{name} has no influence on this curve: it has no standard error, and those of "
                "the other parameters hold with it fixed."
            )
    return sentences or [Status.TRUSTED.sentence]


def _data_sentences(measured: Measured, citation: str, left: Residual) -> list[str]:
    unit = " m/s" if measured.slip == "slip_velocity_mps" else ""
    braking = int(left.braking.sum())
    sentences = [
        f"{measured.name} has {left.slip.size} points with slip between {left.slip[0]:.4g} and "
        f"{left.slip[-1]:.4g}{unit}"
        + (
            f", {braking} of them braking (with both signs turned, since curves are odd)."
            if braking
            else "."
        )
    ]
    if measured.covariates:
        sentences.append(f"Further numeric columns: {', '.join(measured.covariates)}.")
    if measured.left_out:
        sentences.append(
            f"Columns left out because a cell is no finite number: {', '.join(measured.left_out)}."
        )
    return [*sentences, citation] if citation else sentences


def _curve_sentences(fits: Mapping[str, MeasuredFit], ranked: Sequence[str]) -> list[str]:
    best = ranked[0]
    if len(ranked) == 1:
        return [
            f"{best}, rms {fits[best].rms:.4f}, BIC {fits[best].bic:.1f}; no other curve was "
            "fitted to compare it with."
        ]
    gap = fits[ranked[1]].bic - fits[best].bic
    word = next(word for least, word in _EVIDENCE if gap >= least)
    return [
        f"{best} describes the points best: its BIC is {gap:.1f} below that of {ranked[1]} (rms "
        f"{fits[best].rms:.4f} against {fits[ranked[1]].rms:.4f}), which is {word} evidence."
    ]


def _peak_sentences(fit: MeasuredFit, left: Residual) -> list[str]:
    low, high = _mu_max_interval(fit)
    interval = f"{float(fit.peak.adhesion):.4f} (95 % interval {low:.4f} to {high:.4f})"
    unit, largest = fit.slip_unit, left.slip[-1]
    if not fit.peak.found:
        return [
            f"there is none between slip 0 and {fit.slip_limit:g}{unit}; the largest adhesion "
            f"there is {interval}, at slip {float(fit.peak.slip):g}{unit}, "
            f"while the points end at {largest:.4g}{unit}."
        ]
    slip_opt = float(fit.peak.slip)
    reach = fit.quantile * fit.slip_opt_se
    sentences = [
        f"adhesion {interval} at slip {slip_opt:.4g}{unit} (95 % interval {slip_opt - reach:.4g} "
        f"to {slip_opt + reach:.4g}{unit})."
    ]
    if slip_opt > largest:
        sentences.append(f"It is extrapolated: the points end at slip {largest:.4g}{unit}.")
    elif slip_opt < left.slip[0]:
        sentences.append(f"It is extrapolated: the points begin at slip {left.slip[0]:.4g}{unit}.")
    elif slip_opt + reach > largest:
        sentences.append(
            f"It lies within the measured slips, but its interval reaches beyond their end at "
            f"{largest:.4g}{unit}."
        )
    else:
        sentences.append(
            f"It lies within the measured slips, with {left.points_behind} points beyond it."
        )
    return sentences


def _residual_sentences(fit: MeasuredFit, left: Residual) -> list[str]:
    if fit.rms <= EXACT * np.sqrt(np.mean(left.adhesion**2)):
        return ["none: the points lie on the curve within the rounding of numbers."]
    alike = (
        f"the likeness of neighbours in slip is {left.likeness:.1f} standard deviations above that "
        "of white noise"
    )
    sentences = [
        f"rms {fit.rms:.4f}, where neighbouring points scatter by {left.scatter:.4f};",
        f"structure is left ({alike})."
        if left.likeness > _LIKENESS
        else f"no structure is left that these points could show ({alike}).",
    ]
    unit, scale = (" per m/s", 1.0) if fit.slip_unit else (" per % of slip", 0.01)
    where = f"Beyond slip {left.behind:.4g}{fit.slip_unit}"
    if np.isnan(left.slope):
        sentences.append(f"{where} there are too few points ({left.points_behind}) for a slope.")
        return sentences
    slope, error = scale * left.slope, scale * left.slope_se
    sentences.append(
        f"{where} the residual has a slope of {slope:+.5f} ± {error:.5f}{unit}: "
        + (
            "the curve does not follow the fall of the points."
            if abs(slope) > 2 * error
            else "no slope is left there that exceeds two standard errors."
        )
    )
    return sentences


def _doubts(
    fits: Mapping[str, MeasuredFit],
    ranked: Sequence[str],
    not_fitted: Mapping[str, Sequence[str]],
    left: Residual,
) -> list[str]:
    best = fits[ranked[0]]
    doubts = []
    if best.status is not Status.TRUSTED:
        doubts += [f"{ranked[0]}: {sentence}" for sentence in reasons(best)]
    tenable = [name for name in ranked if fits[name].bic - best.bic <= 10 and fits[name].peak.found]
    if len(tenable) > 1:
        slips = [float(fits[name].peak.slip) for name in tenable]
        levels = [float(fits[name].peak.adhesion) for name in tenable]
        doubts.append(
            f"Curves within 10 of the best BIC ({', '.join(tenable)}) put the peak at slip "
            f"{min(slips):.4g} to {max(slips):.4g}{best.slip_unit} and adhesion {min(levels):.4f} "
            f"to {max(levels):.4f}: the interval of a single curve does not include this "
            "difference."
        )
    if left.likeness > _LIKENESS:
        doubts.append(
            "The residual has structure: the form of the curve is wrong, or a condition that it "
            "lacks matters, and every interval is too narrow."
        )
    if left.lag_one > 2 / np.sqrt(left.slip.size):
        longer = np.sqrt((1 + left.lag_one) / max(1 - left.lag_one, 1e-6))
        doubts.append(
            f"Consecutive points are correlated ({left.lag_one:.2f}): the standard errors are too "
            f"small, by a factor of about {longer:.1f}."
        )
    doubts += [
        f"{name}: {' '.join(reasons(fits[name]))}"
        for name in ranked[1:]
        if fits[name].status is not Status.TRUSTED
    ]
    loose = {
        name: [
            parameter
            for parameter, value, error in zip(
                fits[name].curve.free,
                fits[name].parameters,
                fits[name].standard_errors,
                strict=True,
            )
            if error > 0.5 * abs(value)
        ]
        for name in ranked
    }
    doubts += [
        f"{name}: the points hardly determine {', '.join(parameters)} (standard error above "
        "half the value), so the standard errors and intervals of this curve are rough."
        for name, parameters in loose.items()
        if parameters
    ]
    doubts += [
        f"{name} was not fitted: it needs the column {' and '.join(columns)}."
        for name, columns in not_fitted.items()
    ]
    doubts.append(
        "All standard errors assume an exact slip, and noise that is independent from point to "
        "point and equally large everywhere."
    )
    return doubts


def _by_bic(fits: Mapping[str, MeasuredFit]) -> list[str]:
    return sorted(fits, key=lambda name: fits[name].bic)


def _mu_max_interval(fit: MeasuredFit) -> tuple[float, float]:
    half = fit.quantile * fit.mu_max_se
    return float(fit.peak.adhesion) - half, float(fit.peak.adhesion) + half


def _aligned(table: pd.DataFrame) -> str:
    # pandas can set the headings flush left, the cells only by padding them.
    padded = table.apply(lambda column: column.str.ljust(column.str.len().max()))
    return padded.to_string(index=False, justify="left")
