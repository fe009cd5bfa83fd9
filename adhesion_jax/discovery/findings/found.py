"""The effects of a finished search as they are reported: names, intervals, formulas, sentences."""

import numpy as np

from adhesion_jax.data.columns import COLUMNS
from adhesion_jax.discovery.findings.naming import intervals
from adhesion_jax.discovery.model.fitting import nearly_fitted
from adhesion_jax.discovery.model.noise import NoisySlip
from adhesion_jax.discovery.model.prediction import held_out_loss
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.scans import Torsion
from adhesion_jax.discovery.search.state import Accepted, Selection, parts_of
from adhesion_jax.discovery.types import Errors, FoundEffect, Interval
from adhesion_jax.effects import Cause, Effect, Labels, ShapeTerm, kind_of
from adhesion_jax.effects.labels import NO_LABEL

#: A parameter of which the data tell nothing, as the power of a load that they lack, has an
#: interval that is wider than the range that is searched by more than this.
_UNTOLD = 100.0


def found_effects(state: Selection, validation: Errors) -> list[FoundEffect]:
    """The effects with their intervals, and the error with each added to those before it."""
    told = intervals(state)
    values = state.fitted.base_values.tolist()
    whole = float(held_out_loss(state.fitted).sum())
    found = []
    for number, effect in enumerate(state.accepted):
        first = parts_of(state.accepted[: number + 1])
        some = nearly_fitted(state.setting, state.base, values, first)
        ratio = float(held_out_loss(some).sum()) / max(whole, 1e-300)
        parameters, units, at_bound = {}, {}, []
        for place, part in enumerate(effect.parts):
            prefix = "" if place == 0 else f"{kind_of(part)} "
            for name, described in part.FACTS.parameters.items():
                if name in part.FACTS.references or _no_label(part, name):
                    continue
                interval = told[number, place][name]
                if interval.high - interval.low > _UNTOLD * (described.upper - described.lower):
                    continue
                parameters[prefix + name] = interval
                if not described.lower < interval.value < described.upper:
                    at_bound.append(prefix + name)
                column = effect.covariates[0] if effect.covariates else ""
                unit = COLUMNS[column].unit if column in COLUMNS else "unit of the column"
                units[prefix + name] = described.unit.replace("column", unit)
        formula = _formula(effect.parts[0])
        found.append(
            FoundEffect(
                effect.name,
                effect.members,
                effect.covariates,
                formula,
                parameters,
                units,
                effect.p,
                validation.after.value * float(np.sqrt(ratio)),
                _sentence(effect),
                acts_on(effect),
                tuple(at_bound),
            )
        )
    return found


def _no_label(part: Effect, name: str) -> bool:
    """Whether a strength is that of a label that the data lack."""
    return isinstance(part, Labels) and getattr(part, f"label{name[1:]}") == NO_LABEL


#: The curve mu(l) changed by a function g of columns, by the part of the curve that g acts on.
_BENT = {
    "level": "mu exp(g)",
    "slip": "mu(l exp(g))",
    "fall": "mu_max - (mu_max - mu) exp(g) beyond the peak",
    "offset": "mu + g",
    "shift": "mu(l + g)",
}


def acts_on(effect: Accepted) -> str:
    """The part of the curve on which the effect acts: that of its first part, or the level."""
    first = effect.parts[0]
    return first.acts_on if isinstance(first, ShapeTerm) else "level"


def _formula(part: Effect) -> str:
    return (
        f"{_BENT[part.acts_on]}, {part.FACTS.formula}"
        if isinstance(part, ShapeTerm)
        else part.FACTS.formula
    )


def _sentence(effect: Accepted) -> str:
    """What the effect does, in words."""
    first = effect.parts[0]
    if effect.generic or not isinstance(first, Cause):
        return f"Structure against {' and '.join(effect.covariates)}; no physical cause is claimed."
    more = " and ".join(kind_of(part) for part in effect.parts[1:])
    refined = f" Its form is refined by {more}." if more else ""
    return f"{first.FACTS.sentence}{refined}"


def slip_noise_found(noisy: NoisySlip | None, validation: Errors) -> list[FoundEffect]:
    # Student's t takes an inexact curve for noise more often than its p says.
    if noisy is None or noisy.p > rules.SCAN_SIGNIFICANT:
        return []
    what = f"{noisy.sigma:.2g} m/s of a wheel speed"
    if not noisy.of_wheel_speed:
        what = f"{noisy.sigma:.2g} of slip"
    sentence = (
        f"The slip signal has noise of {what} that adhesion does not follow: points where the "
        "curve is steep count less."
    )
    nothing = float("nan")
    return [
        FoundEffect(
            "slip_noise",
            ("slip_noise",),
            ("slip_ratio",),
            "mu(l - error of l)",
            {"sigma": Interval(noisy.sigma, nothing, nothing)},
            {"sigma": "m/s" if noisy.of_wheel_speed else "1"},
            noisy.p,
            validation.after.value,
            sentence,
            "slip",
        )
    ]


def torsion_found(line: Torsion | None, validation: Errors) -> list[FoundEffect]:
    if line is None:
        return []
    nothing = float("nan")
    return [
        FoundEffect(
            "torsion",
            ("torsion",),
            ("time_s",),
            "mu + a sin(2 pi f t + phase of the run)",
            {
                "frequency": Interval(line.frequency, nothing, nothing),
                "amplitude": Interval(line.amplitude, nothing, nothing),
            },
            {"frequency": "Hz", "amplitude": "1"},
            line.p,
            validation.after.value,
            "An oscillation whose phase differs from run to run: it is part of the noise, and no "
            "prediction can know it.",
        )
    ]
