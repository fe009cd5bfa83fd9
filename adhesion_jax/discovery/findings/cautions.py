"""Cautions about a result: absent columns, untested effects, extrapolation, kinds of noise."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
import scipy

from adhesion_jax.curves import BASES
from adhesion_jax.data.columns import COLUMNS
from adhesion_jax.data.condensing import condensed
from adhesion_jax.data.runs import RunSet
from adhesion_jax.discovery.findings.dependence import at_medians
from adhesion_jax.discovery.model.fitting import nearly_fitted
from adhesion_jax.discovery.model.packing import columns_of
from adhesion_jax.discovery.model.problem import Problem, conditions_of
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import NO_TIME, why_untested
from adhesion_jax.discovery.search.state import Selection
from adhesion_jax.discovery.types import Interval
from adhesion_jax.effects import EFFECTS, in_words
from adhesion_jax.effects.dynamic import Dynamic
from adhesion_jax.effects.labels import MOST as MOST_LABELS
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.inference.noise import RunNoise
from adhesion_jax.wording import listed, percent

#: A run is named that differs from the others by this many times their scatter and by this share of
#: the adhesion, if no more than this share of the runs do; at most three of them. By hand.
_FAR_TIMES, _FAR_LEVEL, _FAR_SHARE, _FAR_TOLD = 6.0, 0.05, 0.1, 3

#: Stretches of slip in which the departure of the curve is looked at.
_STRETCHES = 20

#: The quantiles between which nine in ten values lie.
_MIDDLE = (0.05, 0.95)

#: Two neighbouring values of a column that are further apart than this share of its range have a
#: gap between them. By hand.
_GAP = 0.2

#: Trees are ahead of the law where they remove this share of what it leaves of the squared error of
#: a test. By hand.
AHEAD = 0.01

#: A law is not believed that is this many times the largest adhesion of the points. By hand.
_BEYOND = 3.0

#: Columns that an engineer may have measured, each with the columns that can replace it.
_EXPECTED: Mapping[str, tuple[str, ...]] = {
    "vehicle_speed_mps": (),
    "normal_load_N": (),
    "temperature_C": ("rail_temperature_C", "tread_temperature_C"),
    "relative_humidity_pct": (),
    "position_m": (),
    "curvature_per_m": ("angle_of_attack_deg", "slip_angle_deg", "lateral_creepage"),
    "sanding": (),
    "time_s": (),
    "axle": (),
    "wheel_angle_rad": (),
}


def ahead_words(removed: Interval) -> list[str]:
    """How much of the squared error of a test that the law leaves trees remove, if they do."""
    if removed.value < AHEAD:
        return []
    share, low, high = map(percent, removed)
    follows = (
        "adhesion depends on the columns in a way that the law lacks."
        if removed.low > 0
        else "adhesion may depend on the columns in a way that the law lacks, or this is chance; "
        "more test runs would show."
    )
    return [
        f"Boosted trees on top of the law, fitted to the same training runs, remove {share} "
        f"[{low}, {high}] of the squared error that it has on the test runs: {follows}"
    ]


def absent(runs: RunSet) -> str:
    """A sentence on the known columns that are absent from the data."""
    there = runs.whole.conditions
    missing = [
        f"{name} (left out)" if name in {*runs.left_out, *runs.same} else name
        for name, others in _EXPECTED.items()
        if name not in there and not any(other in there for other in others)
    ]
    if not missing:
        return "No known column is absent; a cause without a column may still act through a proxy."
    return (
        f"Absent from the data: {', '.join(missing)}. If one of them acts, a column that varies "
        "with it (a proxy) may have been named in its place."
    )


def untested(problem: Problem, runs: RunSet) -> tuple[str, ...]:
    """Sentences on the effects that the data cannot test, by reason, and on narrow columns."""
    reasons: dict[str, list[str]] = {}
    for name in EFFECTS:
        why = why_untested(name, problem, {*runs.left_out, *runs.same})
        if why:
            reasons.setdefault(why, []).append(in_words(name))
    if not problem.in_time:
        reasons.setdefault(NO_TIME, []).append(in_words("slip_noise"))
    for name in runs.covariates:
        count = len(runs.named.get(name, ()))
        if count > MOST_LABELS and name not in problem.constant:
            why = f"it has {count} labels, and at most {MOST_LABELS} of a column are tested"
            reasons.setdefault(f"{why}; join those that belong together", []).append(name)
    sentences = [f"Not tested: {', '.join(names)} ({why})." for why, names in reasons.items()]
    for name, values in problem.flat.items():
        limits = _NARROW.get(name)
        if limits is not None and np.ptp(values) < limits:
            unit = COLUMNS[name].unit
            sentences.append(
                f"{name} varies by only {np.ptp(values):.3g} {unit}: an effect of it would be "
                "seen only if it were strong."
            )
    constant = [name for name in runs.covariates if name in problem.constant]
    if constant:
        sentences.append(
            "These columns are constant in the data, so no effect of them can be tested: "
            f"{', '.join(constant)}."
        )
    return tuple(sentences)


#: A column whose range is below this is reported as too narrow to show an effect of usual strength.
#: By hand, in the unit of the column.
_NARROW: Mapping[str, float] = {
    "vehicle_speed_mps": 3.0,
    "temperature_C": 5.0,
    "relative_humidity_pct": 15.0,
    "normal_load_N": 0.0,
}


def extrapolated(
    state: Selection,
    law: CorrectedLaw,
    runs: RunSet,
    test: RunSet | None,
) -> list[tuple[float, str]]:
    """The share of test points that training hardly covers, and a sentence on it, largest first.

    Of the columns of the effects and of the curve, and of the slip: points outside the range of the
    training data, else those outside the middle of it if the middles of both do not touch, else, of
    the columns alone, those in the widest gap between training values. And of traction or braking,
    where the training data have none.
    """
    if test is None:
        return []
    record = condensed(test).record
    whole = conditions_of(record, law.calendar)
    inside = np.asarray(record.mask)
    problem = state.setting.problem
    used = {name for effect in state.accepted for name in effect.covariates}
    used |= {*BASES[state.base].NEEDS}
    # A covariate is what was measured: that of a drift is the time or the run, as is that of a lag.
    used |= {name for part in law.effects for name in part.FACTS.needs}
    used |= {column for part in law.effects for column in columns_of(part)}
    found = []
    for condition in sorted(used & set(law.ranges) & set(whole)):
        name, start, length = condition, 0.0, 1.0
        if condition == "campaign_time":
            name, start = law.calendar.column, float(law.calendar.start)
            length = float(law.calendar.end) - start
        low, high = (start + length * one for one in law.ranges[condition])
        judged = start + length * whole[condition][inside]
        share = float(np.mean((judged < low) | (judged > high)))
        cyclic = condition in law.cyclic
        if (cyclic or share <= rules.MUCH_OUTSIDE) and condition in problem.flat:
            both = judged, start + length * problem.flat[condition]
            found += _apart(name, *both) or _in_gap(name, *both)
        if cyclic:
            continue
        found.append(
            (
                share,
                f"{percent(share)} of the test points have {name} outside {low:.4g} to "
                f"{high:.4g}, where it was measured: there the law keeps its value at the edge.",
            )
        )
    slip, judged = runs.whole.slip, test.whole.slip
    # Traction and braking may have reached different slips, and the curve of each is its own.
    reach = {side: np.abs(slip[np.sign(slip) == side]).max(initial=0.0) for side in (1, -1)}
    reach = {side: largest or max(reach.values()) for side, largest in reach.items()}
    share = float(np.mean(np.abs(judged) > np.where(judged < 0, reach[-1], reach[1])))
    if share <= rules.MUCH_OUTSIDE:
        found += _apart("a slip", np.abs(judged), np.abs(slip))
    if share > rules.FEW_OUTSIDE:
        found.append(
            (
                share,
                f"{percent(share)} of the test points have a larger slip than any training "
                f"point ({_reaches(reach)}): there the curve is extrapolated.",
            )
        )
    for words, side in (("traction", 1), ("braking", -1)):
        if not np.any(np.sign(slip) == side):
            share = float(np.mean(np.sign(judged) == side))
            found.append(
                (
                    share,
                    f"{percent(share)} of the test points are of {words}, of which the training "
                    "data have no point: there the law is the curve of the other side.",
                )
            )
    return sorted((one for one in found if one[0] > 0), reverse=True)


def _reaches(reach: Mapping[int, float]) -> str:
    """The largest slips of traction and braking, in words."""
    if reach[1] == reach[-1]:
        return f"{reach[1]:.4g}"
    return f"{reach[1]:.4g} in traction, {reach[-1]:.4g} in braking"


def _apart(what: str, test: np.ndarray, training: np.ndarray) -> list[tuple[float, str]]:
    """A sentence if the middle nine tenths of the values do not touch, both [points]."""
    first, last = np.quantile(test, _MIDDLE)
    low, high = np.quantile(training, _MIDDLE)
    if first <= high and low <= last:
        return []
    share = float(np.mean((test < low) | (test > high)))
    return [
        (
            share,
            f"Nine in ten test points have {what} from {first:.4g} to {last:.4g}, nine in ten "
            f"training points one from {low:.4g} to {high:.4g}: the law is judged where hardly "
            "any data are that it was fitted to.",
        )
    ]


def _in_gap(name: str, test: np.ndarray, training: np.ndarray) -> list[tuple[float, str]]:
    """A sentence on the test points in the widest gap of the training ones, both [points]."""
    values = np.unique(training)
    widths = np.diff(values, append=values[-1])
    place = int(np.argmax(widths))
    if widths[place] <= _GAP * np.ptp(values):
        return []
    low, high = values[place : place + 2]
    share = float(np.mean((test > low) & (test < high)))
    return [
        (
            share,
            f"{percent(share)} of the test points have {name} between {low:.4g} and {high:.4g}, "
            "where no training point is: what the law says there is a guess.",
        )
    ]


def shape_words(state: Selection) -> tuple[str, ...]:
    """How far the curve departs from the formula that it is named after, if that is seen."""
    fitted = state.fitted
    problem = fitted.setting.problem
    inside = problem.points > 0
    slip = np.asarray(problem.data.slip)[inside]
    plain = fitted.setting._replace(problem=problem._replace(branches=0))
    values = fitted.base_values[: len(BASES[fitted.base].free)].tolist()
    bare = nearly_fitted(plain, fitted.base, values, fitted.effects)
    top = float(np.quantile(np.abs(fitted.adhesion[inside]), 0.98))
    away = (np.abs(fitted.adhesion) - np.abs(bare.adhesion))[inside] / top
    middle = [
        (float(np.median(away[some])), float(np.median(np.abs(slip[some]))))
        for some in np.array_split(np.argsort(np.abs(slip), kind="stable"), _STRETCHES)
        if some.size
    ]
    share, at = max(middle, key=lambda one: abs(one[0]))
    if not abs(share) >= rules.REPORTED_DEPARTURE:
        return ()
    return (
        f"The shape of the curve: near slip {at:.2g} it is {abs(share) * 100:.2g} % of the largest "
        f"adhesion {'above' if share > 0 else 'below'} the best curve of {fitted.base}; it bends "
        "as the points do, and no column is named for that.",
    )


def beyond_points(state: Selection) -> tuple[str, ...]:
    """A sentence where the law is far beyond all points at a slip between theirs; mostly none."""
    problem, effects = state.setting.problem, state.fitted.effects
    inside, shape = problem.points > 0, problem.points.shape
    slip, adhesion = (np.asarray(of)[inside] for of in (problem.data.slip, problem.data.adhesion))
    grid = np.linspace(slip.min(), slip.max(), inside.size)
    steady = [slot for slot, part in enumerate(effects) if not isinstance(part, Dynamic)]
    values, columns = state.fitted.values[None], {"slip_ratio": grid.reshape(shape)}
    law = at_medians(state, steady, values, columns).ravel()
    place, largest = int(np.argmax(np.abs(law))), float(np.abs(adhesion).max())
    if not np.abs(law[place]) > _BEYOND * largest:
        return ()
    return (
        f"With all columns at their medians the law has an adhesion of {law[place]:.3g} at slip "
        f"{grid[place]:.2g}, where no point is: the largest of the points is {largest:.3g}. "
        "Between their slips the law is not to be believed.",
    )


def outlying(levels: pd.DataFrame | None) -> tuple[str, ...]:
    """A sentence on the few runs whose level is far from that of all others; mostly none."""
    if levels is None or len(levels) < rules.FEWEST_RUNS:
        return ()
    after = levels["after"].to_numpy()
    apart = after - np.median(after)
    spread = max(1.4826 * float(np.median(np.abs(apart))), float(levels["error"].median()))
    far = np.flatnonzero(np.abs(apart) > max(_FAR_TIMES * spread, _FAR_LEVEL))
    if not 0 < far.size <= _FAR_SHARE * len(levels):
        return ()
    runs = [
        f"run {levels['run'].iloc[place]} by {percent(after[place])}"
        for place in far[np.argsort(-np.abs(apart[far]))][:_FAR_TOLD]
    ]
    return (
        f"The level of adhesion differs from the law in {listed(runs)}, where the other runs "
        f"scatter by {percent(spread)}: the errors contain it, and it may hide what acts in the "
        "others. Look at it, or leave it out.",
    )


def noise_words(state: Selection, noise: RunNoise) -> tuple[str, ...]:
    """Sentences on the structure of the noise, none of which is an effect."""
    fitted = state.fitted
    weight = state.setting.root > 0
    runs = int(weight.any(1).sum())
    sentences = []
    adhesion = np.asarray(state.setting.problem.data.adhesion)
    if noise.autocorrelation > rules.REPORTED_AUTOCORRELATION:
        sentences.append(
            "Noise: neighbouring points of a run are correlated by "
            f"{noise.autocorrelation:.2f}; intervals and p hold for any correlation within runs."
        )
    if noise.run_scatter > rules.REPORTED_RUN_SCATTER and runs > 2:
        sentences.append(
            f"Noise: the level of adhesion differs from run to run by "
            f"{100 * noise.run_scatter:.1f} % beyond what the effects explain."
        )
    if noise.slow_level > rules.REPORTED_RUN_SCATTER:
        sentences.append(
            f"Noise: the level of adhesion varies slowly by {100 * noise.slow_level:.1f} %; it "
            f"keeps its value over about {noise.slow_rows:.0f} points."
        )
    white = fitted.error[weight]
    if white.size < rules.FEWEST_POINTS_OF_NOISE:
        return tuple(sentences)
    spread = 1.4826 * float(np.median(np.abs(white)))
    outliers = float(np.mean(np.abs(white) > rules.OUTLIER_DEVIATIONS * spread))
    if outliers > 0:
        sentences.append(
            f"Noise: {100 * outliers:.2g} % of the points are outliers, beyond five times the "
            "usual deviation."
        )
    calm = np.abs(white) < rules.OUTLIER_DEVIATIONS * spread
    for what, against in (
        ("the adhesion", np.abs(fitted.adhesion)[weight]),
        ("the slip", np.abs(np.asarray(state.setting.problem.data.slip))[weight]),
    ):
        if np.ptp(against) == 0:
            continue
        rank, p = scipy.stats.spearmanr(np.abs(white)[calm], against[calm])
        if p < rules.NOISE_SIGNIFICANT:
            more = "grows" if rank > 0 else "falls"
            sentences.append(
                f"Noise: its spread {more} with {what} (rank correlation {rank:.2f}); the errors "
                "given are averages over all points."
            )
            break
    levels = np.unique(adhesion[weight])
    if levels.size > 2 and levels.size < rules.STEPPED_SHARE * white.size:
        step = float(np.median(np.diff(levels)))
        if step > rules.REPORTED_STEP * noise.sigma:
            sentences.append(f"Noise: adhesion is given in steps of about {step:.2g}.")
    return tuple(sentences)
