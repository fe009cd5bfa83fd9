"""The verdict on a measured record in words."""

from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from adhesion_jax.data import Measured
from adhesion_jax.identifiers.base import Status
from adhesion_jax.inference.cosines import COSINES
from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.inference.slip import SlipNoise
from adhesion_jax.inference.weighing import EXACT
from adhesion_jax.measured.answer import Answer
from adhesion_jax.measured.comparison import Comparison
from adhesion_jax.measured.groups import Group
from adhesion_jax.measured.residual import Residual
from adhesion_jax.measured.vetoes import Judgement
from adhesion_jax.report.text import filled
from adhesion_jax.wording import listed, percent, plus_minus

#: The residual is said to have structure if the likeness of its neighbours exceeds this number of
#: standard deviations.
_LIKENESS = 2.0

#: Least weight at which a curve is named as part of the answer.
_LEAST_NAMED = 0.005

#: Curves are told apart if their log densities differ by this multiple of its standard error.
_APART = 2.0

#: Autocorrelation, run scatter, slow level and departure below this are not worth a number.
_SLIGHT = 5e-4


Sections = Sequence[tuple[str, Sequence[str]]]


def verdict(
    measured: Measured,
    citation: str,
    fits: Mapping[str, MeasuredFit],
    not_fitted: Mapping[str, Sequence[str]],
    left: Residual,
    answer: Answer,
    judgement: Judgement,
    slip: SlipNoise,
    runs: int,
    comparisons: Sequence[Comparison],
    groups: Mapping[str, Group],
    in_vain: Sequence[str] | None,
    mixed: Comparison | None,
) -> Sections:
    """The verdict in sentences under titles: what forbids an answer comes first.

    `left` is the residual of the curve with the largest log density, and `in_vain` are the columns
    whose groups were looked at without one that predicts; `mixed` are the levels by a column that
    nobody named and that predicts them.
    """
    ranked = best_first(fits)
    best = fits[ranked[0]]
    peak = [] if judgement.vetoes else _peak_sentences(answer, judgement, best, measured)
    warnings = [different_rails(None, {}, mixed), judgement.warning]
    sections = [
        ("Warning", [*filter(None, warnings)]),
        ("No answer", list(judgement.vetoes)),
        ("Data", _data_sentences(measured, citation)),
        ("Curve", _curve_sentences(fits, ranked, answer)),
        ("Peak", peak),
        ("Noise", _noise_sentences(best, slip, runs, measured)),
        ("Residual", _residual_sentences(best, left)),
        *(("Groups", _group_sentences(one, groups)) for one in comparisons),
        ("Groups", [] if in_vain is None else [_no_groups(in_vain)]),
        ("Not to be trusted", _doubts(fits, ranked, not_fitted, answer, slip, measured)),
    ]
    return [(title, sentences) for title, sentences in sections if sentences]


def best_first(fits: Mapping[str, MeasuredFit]) -> list[str]:
    """The names of the curves, the one that predicts best first."""
    return sorted(fits, key=lambda name: -fits[name].log_density)


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
    sentences = []
    if fit.status in (Status.NOT_FINITE, Status.INADMISSIBLE):
        sentences.append(fit.status.sentence)
    if not fit.peak.found:
        sentences.append(
            f"Adhesion has no peak between slip 0 and {fit.slip_limit:g}{fit.slip_unit}; "
            "mu_max is the largest adhesion in that range."
        )
    if not np.isfinite(fit.mu_max_se):
        sentences.append("The data do not determine all parameters: there are no standard errors.")
    elif not fit.converged:
        sentences.append(Status.NOT_CONVERGED.sentence)
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
        sentences.append(f"Further columns: {', '.join(measured.covariates)}.")
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
    by_part = best.left_out - second.left_out
    gain, error = best.log_density - second.log_density, np.sqrt(by_part.size) * np.std(by_part)
    apart = gain > _APART * error
    return [
        _departure_sentence(ranked[0], best),
        f"{ranked[0]} predicts best the points that are left out of its fit: their log density, "
        "less what the departure costs, is "
        f"{plus_minus(gain, float(error))} above that by {ranked[1]} (rms {best.rms:.4f} "
        f"against {second.rms:.4f}), so the points "
        + ("speak for it." if apart else "do not tell these two apart."),
        f"The weights in the answer by all curves, after the same density: {weights_of(answer)}.",
    ]


def _departure_sentence(name: str, fit: MeasuredFit) -> str:
    """How far the points leave the nearest curve of this name, and where most."""
    slip = np.linspace(0.02, 1.0, 50) * fit.law.span.largest
    alone = np.asarray(fit.curve(jnp.asarray(slip), fit.conditions))
    departure = (fit.law.at(slip).adhesion - alone) / np.abs(alone).max()
    most = int(np.argmax(np.abs(departure)))
    if abs(departure[most]) < _SLIGHT:
        return f"The points follow {name} itself: no departure from it is seen."
    return (
        f"The points depart from the nearest curve of {name} by {percent(fit.misfit)} (rms), most "
        f"at slip {slip[most]:.3g}{fit.slip_unit}, where they lie {percent(abs(departure[most]))} "
        f"of its largest adhesion {'above' if departure[most] > 0 else 'below'} it; the peak is "
        "that of the bent curve."
    )


def _peak_sentences(
    answer: Answer, judgement: Judgement, fit: MeasuredFit, measured: Measured
) -> list[str]:
    if judgement.at_least is not None:
        return [judgement.why]
    slip = measured.table[measured.slip].abs()
    level, place, unit = answer.mu_max, answer.slip_opt, fit.slip_unit
    behind, largest = int((slip > place.value).sum()), float(slip.max())
    return [
        f"by all curves together, adhesion {level.value:.4f} (95 % interval {level.low:.4f} to "
        f"{level.high:.4f}) at slip {place.value:.4g}{unit} (95 % interval {place.low:.4g} to "
        f"{place.high:.4g}{unit}).",
        f"It lies within the measured slips, with {behind} points beyond it."
        if place.high <= largest
        else "It lies within the measured slips, but its interval reaches beyond their end at "
        f"{largest:.4g}{unit}.",
    ]


def _noise_sentences(fit: MeasuredFit, slip: SlipNoise, runs: int, measured: Measured) -> list[str]:
    if fit.rms <= EXACT * float(fit.peak.adhesion):
        return []
    noise, in_time = fit.noise, "time_s" in measured.table
    found = [f"standard deviation of a point {noise.sigma:.4f}"]
    if in_time:
        found.append(
            f"correlation of consecutive points of a run {noise.autocorrelation:.2f}"
            if noise.autocorrelation > _SLIGHT
            else "no correlation of consecutive points"
        )
    if runs > 1:
        found.append(
            f"scatter of the levels of the {runs} runs {100 * noise.run_scatter:.2g} %"
            if noise.run_scatter > _SLIGHT
            else f"no scatter between the levels of the {runs} runs"
        )
    if noise.slow_level > _SLIGHT:
        seconds = noise.slow_rows * float(np.median(np.diff(measured.table["time_s"])))
        found.append(
            f"a level of the rail that varies within a run by {100 * noise.slow_level:.2g} % with "
            f"a correlation time of {seconds:.2g} s"
        )
    sentences = [f"{listed(found)}."]
    if noise.slip_noise > 0:
        unit = " m/s of wheel speed" if slip.of_wheel_speed else ""
        sentences.append(
            f"The slip has noise of standard deviation {noise.slip_noise:.2g}{unit} "
            f"({'given' if slip.given else 'estimated from its course in time'}): points where the "
            "curve is steep count less, and the curve is the mean over this noise."
        )
    slow = f"the {COSINES} slowest waves of the residual"
    if fit.sandwich.blocks is None:
        basis, reach = "the scatter of the points about the curve", "if points are independent"
    else:
        both = f"the scatter between runs or on {slow}, whichever is larger"
        basis = both if fit.sandwich.clusters is not None else slow
        reach = "whatever a point depends on within its run"
    sentences.append(
        f"The intervals rest on {basis}: they hold {reach} ({fit.degrees:.0f} degrees of freedom)."
    )
    return sentences


def _residual_sentences(fit: MeasuredFit, left: Residual) -> list[str]:
    if fit.rms <= EXACT * np.sqrt(np.mean(left.adhesion**2)):
        return ["none: the points lie on the curve within the rounding of numbers."]
    alike = (
        f"the likeness of neighbours in slip is {left.likeness:.1f} standard deviations above that "
        "of white noise"
    )
    noise = fit.noise
    seen = max(noise.autocorrelation, noise.run_scatter, noise.slow_level) > _SLIGHT
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


def _group_sentences(comparison: Comparison, groups: Mapping[str, Group]) -> list[str]:
    table, by = comparison.table, comparison.by
    order = np.argsort(table["mu_max"].to_numpy())
    low, high = table.iloc[order[0]], table.iloc[order[-1]]
    sentences = [
        f"compared by {by}, the level of adhesion "
        + ("differs" if comparison.changed else "shows no difference")
        + f" (F = {comparison.statistic:.2f} with {comparison.differences} and "
        f"{comparison.degrees:.0f} degrees of freedom, p = {comparison.p:.2g}); under one curve "
        f"the largest adhesion is from {low['mu_max']:.4f} ({by} {low[by]}) to "
        f"{high['mu_max']:.4f} ({by} {high[by]}).",
        f"Its course over slip {'differs' if comparison.bent else 'shows no difference'} "
        f"(p = {comparison.p_shape:.2g}).",
    ]
    if (comparison.changed or comparison.bent) and by != "branch":
        sentences.append(
            f"One curve for all of {by} is a mean of different rails: use the answer of each"
            + (f", each fitted by itself: {_of_groups(groups)}." if groups else ".")
        )
    return sentences


def _of_groups(groups: Mapping[str, Group]) -> str:
    """What each group says by itself, as clauses."""
    return "; ".join(_of_group(name, one) for name, one in groups.items())


def different_rails(
    comparison: Comparison | None, groups: Mapping[str, Group], mixed: Comparison | None
) -> str:
    """What is said before one answer for rows of different rails; empty for most measurements."""
    if mixed is not None:
        levels, by = mixed.table["mu_max"], mixed.by
        return (
            f"The rows are of different rails: their level differs by {by} (p = {mixed.p:.1g}), so "
            f"that under one curve the largest adhesion is from {levels.min():.4f} to "
            f"{levels.max():.4f}, and one peak for all is a mean of these; the peak of each is "
            f'told by --by "{by}".'
        )
    if comparison is None or not groups or not (comparison.changed or comparison.bent):
        return ""
    return (
        f"Adhesion differs by {comparison.by}: largest adhesion {_of_groups(groups)}. What follows "
        "is of one curve for all, which is a mean of these."
    )


def _no_groups(looked_at: Sequence[str]) -> str:
    if not looked_at:
        return "There is no column of a few labels or levels by which the rows could be told apart."
    one = len(looked_at) == 1
    return (
        f"The levels of rows that are left out are not predicted by the groups of "
        f"{listed([*looked_at], 'or')}, the only column{'' if one else 's'} of a few labels or "
        "levels: no groups are compared."
    )


def _of_group(name: str, group: Group) -> str:
    level = group.mu_max
    if group.judgement.vetoes:
        return f"{name}: no answer ({group.status.rstrip('.')})"
    if group.judgement.at_least is not None:
        return f"{name}: at least {level.value:.4f}, no peak is seen"
    return f"{name}: {level.value:.4f} [{level.low:.4f}, {level.high:.4f}]"


def _doubts(
    fits: Mapping[str, MeasuredFit],
    ranked: Sequence[str],
    not_fitted: Mapping[str, Sequence[str]],
    answer: Answer,
    slip: SlipNoise,
    measured: Measured,
) -> list[str]:
    doubts = []
    if 0.05 < answer.without_peak < 0.95:
        doubts.append(
            f"Curves without a peak have {100 * answer.without_peak:.0f} % of the weight: whether "
            "there is a peak is not certain."
        )
    if slip.sigma == 0 and not slip.given and "time_s" not in measured.table:
        doubts.append(
            "The slip is taken as exact: without the column time_s its noise cannot be estimated. "
            "Where it is known, give it by --slip-noise."
        )
    doubts += [
        f"{name}: {' '.join(reasons(fits[name]))}"
        for name in ranked
        if fits[name].status is not Status.TRUSTED
    ]
    doubts += [
        f"{name} was not fitted: it needs the column {' and '.join(columns)}."
        for name, columns in not_fitted.items()
    ]
    return doubts
