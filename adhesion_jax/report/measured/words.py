"""The verdict on a measured record in words."""

from collections.abc import Mapping, Sequence

import numpy as np

from adhesion_jax.data import Measured
from adhesion_jax.identifiers.base import Status
from adhesion_jax.measured.answer import Answer
from adhesion_jax.measured.comparison import Comparison
from adhesion_jax.measured.fit import EXACT, MeasuredFit
from adhesion_jax.measured.residual import Residual
from adhesion_jax.measured.slip import SlipErrors
from adhesion_jax.report.text import filled
from adhesion_jax.wording import listed, plus_minus

#: The residual is said to have structure if the likeness of its neighbours exceeds this number of
#: standard deviations.
_LIKENESS = 2.0

#: Least weight at which a curve is named as part of the answer.
LEAST_NAMED = 0.005

#: Curves are told apart if their log densities differ by this multiple of its standard error.
_APART = 2.0

#: Autocorrelation, run scatter and misfit below this are not worth a number.
_SLIGHT = 5e-4


def verdict(
    measured: Measured,
    citation: str,
    fits: Mapping[str, MeasuredFit],
    not_fitted: Mapping[str, Sequence[str]],
    left: Residual,
    answer: Answer,
    slip: SlipErrors,
    runs: int,
    comparison: Comparison | None,
) -> str:
    """The verdict in words: the best curve, the peak, the noise, the residual, and doubts.

    `left` is the residual of the curve with the largest log density.
    """
    ranked = sorted(fits, key=lambda name: -fits[name].log_density)
    best = fits[ranked[0]]
    paragraphs = [
        ("Data", _data_sentences(measured, citation)),
        ("Curve", _curve_sentences(fits, ranked, answer)),
        ("Peak", _peak_sentences(answer, best, measured)),
        ("Noise", _noise_sentences(ranked[0], best, slip, runs, "time_s" in measured.table)),
        ("Residual", _residual_sentences(best, left)),
        *([("Runs", _run_sentences(comparison))] if comparison is not None else []),
        ("Not to be trusted", _doubts(fits, ranked, not_fitted, answer, slip, measured)),
    ]
    return "\n".join(
        filled(f"{title}: {' '.join(sentences)}") for title, sentences in paragraphs if sentences
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


def _data_sentences(measured: Measured, citation: str) -> list[str]:
    unit = " m/s" if measured.slip == "slip_velocity_mps" else ""
    slip, adhesion = measured.table[measured.slip], measured.table["adhesion"]
    braking = int(((slip < 0) & (adhesion < 0)).sum())
    apart = int((slip * adhesion < 0).sum())
    sentences = [
        f"{measured.name} {'have' if ', ' in measured.name else 'has'} {len(slip)} points with "
        f"slip between {slip.abs().min():.4g} and {slip.abs().max():.4g}{unit}"
        + (
            f", {braking} of them braking (with both signs turned, since curves are odd)."
            if braking
            else "."
        )
    ]
    if apart:
        sentences.append(
            f"In {apart} of them slip and adhesion have opposite signs, as noise makes near zero."
        )
    if measured.covariates:
        sentences.append(f"Further numeric columns: {', '.join(measured.covariates)}.")
    if measured.left_out:
        sentences.append(
            f"Columns left out because a cell is no finite number: {', '.join(measured.left_out)}."
        )
    return [*sentences, citation] if citation else sentences


def _curve_sentences(
    fits: Mapping[str, MeasuredFit], ranked: Sequence[str], answer: Answer
) -> list[str]:
    best = fits[ranked[0]]
    if len(ranked) == 1:
        return [f"{ranked[0]}, rms {best.rms:.4f}; no other curve was fitted to compare it with."]
    second = fits[ranked[1]]
    gain = best.left_out - second.left_out
    error = float(np.sqrt(gain.size) * np.std(gain))
    apart = gain.sum() > _APART * error
    heavy = {name: weight for name, weight in answer.weights.items() if weight >= LEAST_NAMED}
    by_weight = sorted(heavy, key=lambda name: -heavy[name])
    weights = listed([f"{name} {heavy[name]:.2f}" for name in by_weight])
    return [
        f"{ranked[0]} predicts best the points that are left out of its fit: their log density is "
        f"{plus_minus(float(gain.sum()), error)} above that by {ranked[1]} (rms {best.rms:.4f} "
        f"against {second.rms:.4f}), so the points "
        + ("speak for it." if apart else "do not tell these two apart."),
        f"The weights in the answer by all curves, after the same density: {weights}.",
    ]


def _peak_sentences(answer: Answer, fit: MeasuredFit, measured: Measured) -> list[str]:
    slip = measured.table[measured.slip].abs()
    level, place = answer.mu_max, answer.slip_opt
    interval = f"{level.value:.4f} (95 % interval {level.low:.4f} to {level.high:.4f})"
    unit, largest = fit.slip_unit, float(slip.max())
    if np.isnan(place.value):
        return [
            f"there is none between slip 0 and {fit.slip_limit:g}{unit}; the largest adhesion "
            f"there is {interval}, while the points end at {largest:.4g}{unit}."
        ]
    sentences = [
        f"by all curves together, adhesion {interval} at slip {place.value:.4g}{unit} (95 % "
        f"interval {place.low:.4g} to {place.high:.4g}{unit})."
    ]
    if place.value > largest:
        sentences.append(f"It is extrapolated: the points end at slip {largest:.4g}{unit}.")
    elif place.value < slip.min():
        sentences.append(f"It is extrapolated: the points begin at slip {slip.min():.4g}{unit}.")
    elif place.high > largest:
        sentences.append(
            f"It lies within the measured slips, but its interval reaches beyond their end at "
            f"{largest:.4g}{unit}."
        )
    else:
        behind = int((slip > place.value).sum())
        sentences.append(f"It lies within the measured slips, with {behind} points beyond it.")
    return sentences


def _noise_sentences(
    name: str, fit: MeasuredFit, slip: SlipErrors, runs: int, in_time: bool
) -> list[str]:
    if fit.rms <= EXACT * float(fit.peak.adhesion):
        return []
    noise = fit.noise
    found = [f"standard deviation of a point {noise.sigma:.4f}"]
    if in_time:
        found.append(
            f"correlation of consecutive points of a run {noise.autocorrelation:.2f}"
            if noise.autocorrelation > _SLIGHT
            else "no correlation of consecutive points"
        )
    if runs > 1:
        found.append(
            f"scatter of the levels of the {runs} runs {100 * fit.run_scatter:.2g} %"
            if fit.run_scatter > _SLIGHT
            else f"no scatter between the levels of the {runs} runs"
        )
    found.append(
        f"a smooth misfit of {100 * fit.misfit:.2g} % that {name} leaves"
        if fit.misfit > _SLIGHT
        else f"no smooth misfit that {name} leaves"
    )
    sentences = [f"{listed(found)}; the intervals include all of these."]
    if fit.effective < 0.95 * fit.points:
        sentences.append(
            f"For the largest adhesion the {fit.points} points tell as much as "
            f"{fit.effective:.0f} independent ones would."
        )
    if slip.sigma > 0:
        unit = " m/s of wheel speed" if slip.falls_with else ""
        interval = f"95 % interval {slip.low:.2g} to {slip.high:.2g}"
        known = "given" if slip.low == slip.high else interval
        sentences.append(
            f"The slip has noise of standard deviation {slip.sigma:.2g}{unit} ({known}): the "
            "curves follow the slip that is to be expected "
            + ("from its course in time." if in_time else "at each measured one.")
        )
    return sentences


def _residual_sentences(fit: MeasuredFit, left: Residual) -> list[str]:
    if fit.rms <= EXACT * np.sqrt(np.mean(left.adhesion**2)):
        return ["none: the points lie on the curve within the rounding of numbers."]
    alike = (
        f"the likeness of neighbours in slip is {left.likeness:.1f} standard deviations above that "
        "of white noise"
    )
    seen = fit.misfit > _SLIGHT or fit.noise.autocorrelation > _SLIGHT or fit.run_scatter > _SLIGHT
    sentences = [
        f"rms {fit.rms:.4f}, where neighbouring points scatter by {left.scatter:.4f};",
        f"structure is left ({alike})"
        + (", which the noise above accounts for." if seen else ", and no noise accounts for it.")
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


def _run_sentences(comparison: Comparison) -> list[str]:
    table, by = comparison.table, comparison.by
    order = np.argsort(table["mu_max"].to_numpy())
    low, high = table.iloc[order[0]], table.iloc[order[-1]]
    beyond = (
        f" beyond the scatter of {100 * comparison.run_scatter:.2g} % between runs of one {by}"
        if comparison.run_scatter > 0
        else ""
    )
    test = (
        f"(F = {comparison.statistic:.2f} with {comparison.differences} and "
        f"{comparison.degrees:.0f} degrees of freedom, p = {comparison.p:.2g})"
    )
    return [
        f"compared by {by}, the largest adhesion "
        + (f"changes{beyond}" if comparison.changed else f"shows no change{beyond}")
        + f" {test}; it is from {low['mu_max']:.4f} ({by} {low[by]}) to {high['mu_max']:.4f} "
        f"({by} {high[by]}). The form of the curve is taken as common to all."
    ]


def _doubts(
    fits: Mapping[str, MeasuredFit],
    ranked: Sequence[str],
    not_fitted: Mapping[str, Sequence[str]],
    answer: Answer,
    slip: SlipErrors,
    measured: Measured,
) -> list[str]:
    doubts = []
    if 0.05 < answer.without_peak < 0.95:
        doubts.append(
            f"Curves without a peak have {100 * answer.without_peak:.0f} % of the weight: whether "
            "there is a peak is not certain."
        )
    if slip.sigma == 0 and "time_s" not in measured.table:
        doubts.append(
            "The slip is taken as exact: without the column time_s its noise cannot be estimated. "
            "Where it is known, give it by --slip-noise."
        )
    doubts += [
        f"{name}: {' '.join(reasons(fits[name]))}"
        for name in ranked
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
    return doubts
