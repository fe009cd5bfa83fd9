"""How a discovery is spoken of: names, numbers and the sentences all its reports share."""

from collections.abc import Sequence

import numpy as np

from adhesion_jax.data.columns import COLUMNS
from adhesion_jax.discovery.findings import Errors, Findings, FoundEffect, Interval
from adhesion_jax.discovery.screening import SIGNIFICANT

#: Where a name in words is not just the name without its underscores.
_NAMES = {
    "speed": "vehicle speed",
    "slip_speed": "exponential loss with slip velocity",
    "load_peak": "normal load on the peak",
    "load_slope": "normal load on the slope",
    "patch": "a patch on the rail",
    "cleaning": "cleaning by slip",
    "axle_position": "position of the axle",
    "relaxation": "relaxation of the contact",
    "delay": "a delay between the signals",
    "lag": "a lag of the adhesion signal",
    "curve": "curvature of the track",
    "mode_asymmetry": "a difference between traction and braking",
    "slip_bias": "a bias of the slip",
    "torque_offset": "an offset of the force",
    "inertia": "inertia of the wheel",
    "wheel_order": "a wave of the wheel's turns",
    "rail_joint": "rail joints or corrugation",
    "drift": "a drift over the campaign",
    "slip_noise": "noise in the slip signal",
}

#: Effects of a column: `covariate:wind_mps`.
_KINDS = {
    "covariate": "a dependence on {}",
    "spline": "a smooth dependence on {}",
    "periodic": "a wave along {}",
    "product": "a joint dependence on {}",
}

#: Columns that are not measured but follow from the file.
_DERIVED = {"run_order": "order of the runs (1)", "campaign_time": "time in the campaign (1)"}
_SUFFIXES = ("per_m", "mps2", "mps", "pct", "rad", "deg", "s", "N", "C", "m")


def one_line(text: str) -> str:
    """A file may name its columns with anything: line breaks would break tables and labels."""
    return " ".join(text.split())


def humanised(name: str) -> str:
    """An effect's name in words; names of columns stay as they are in the file."""
    kind, _, column = name.partition(":")
    if column:
        words = _KINDS.get(kind, kind.replace("_", " ") + " of {}")
        return words.replace("{}", one_line(column))
    return _NAMES.get(name, one_line(name.replace("_", " ")))


def decision(words: str) -> str:
    """What became of a candidate, the name of a class in words."""
    start = "in the class of "
    return start + humanised(words[len(start) :]) if words.startswith(start) else one_line(words)


def column_label(name: str, unit: str = "") -> str:
    """A column with its unit; of one the project does not know the name says what it can."""
    if name in _DERIVED:
        return _DERIVED[name]
    if name not in COLUMNS:
        return f"{one_line(name)} ({unit})" if unit else one_line(name)
    words = next(
        (name.removesuffix(f"_{end}") for end in _SUFFIXES if name.endswith(f"_{end}")), ""
    )
    return f"{(words or name).replace('_', ' ')} ({COLUMNS[name].unit})"


def number(value: float) -> str:
    """Four digits; nothing where there is no number."""
    if not np.isfinite(value):
        return ""
    return f"{value:.0f}" if 1e4 <= abs(value) < 1e7 else f"{value:.4g}"


def error(value: float) -> str:
    """Five decimals, so that errors can be compared by eye; four digits of very small ones."""
    if not np.isfinite(value):
        return ""
    return f"{value:.5f}" if value >= 1e-3 else f"{value:.4g}"


def percent(value: float) -> str:
    return f"{100 * value:.1f} %" if np.isfinite(value) else ""


def in_brackets(interval: Interval) -> str:
    """A parameter as `value [low, high]`, or the value alone."""
    return _bracketed(*(number(part) for part in interval))


def error_in_brackets(interval: Interval) -> str:
    return _bracketed(*(error(part) for part in interval))


def percent_in_brackets(interval: Interval) -> str:
    value, *bounds = (percent(part) for part in interval)
    return _bracketed(value, *(bound.removesuffix(" %") for bound in bounds))


def plus_minus(value: float, standard_error: float) -> str:
    """A value to the digits that its standard error leaves, and the error to two."""
    if not np.isfinite(value):
        return ""
    if not np.isfinite(standard_error):
        return number(value)
    if standard_error <= 1e-9 * abs(value) or standard_error == 0:
        return f"{value:.6g}"
    decimals = max(0, 1 - int(np.floor(np.log10(standard_error))))
    return f"{value:.{decimals}f} ± {standard_error:.{decimals}f}"


def p_value(value: float) -> str:
    return f"{value:.2g}" if np.isfinite(value) else ""


def evidence(effect: FoundEffect) -> str:
    return (
        f"adjusted p = {p_value(effect.p_adjusted)}"
        if np.isfinite(effect.p_adjusted)
        else "no adjusted p"
    )


def listed(words: Sequence[str], conjunction: str = "and") -> str:
    """`a, b and c`."""
    return f" {conjunction} ".join(part for part in (", ".join(words[:-1]), words[-1]) if part)


def candidates(effect: FoundEffect) -> tuple[str, ...]:
    """The class of an effect, itself first."""
    return (effect.name, *(name for name in effect.candidates if name != effect.name))


def class_sentence(effect: FoundEffect) -> str:
    """What the data cannot tell from the effect; nothing where it stands alone."""
    first, *others = (humanised(name) for name in candidates(effect))
    return f"the data cannot tell {first} from {listed(others, 'or')}" if others else ""


def axis(effect: FoundEffect) -> str:
    """The column, or columns, that a structure without a known cause lies along."""
    return " x ".join(effect.covariates) or effect.name.partition(":")[2] or effect.name


def verdict(findings: Findings) -> str:
    """What is missing, how sure that is, and how much smaller the error becomes."""
    unexplained = " and ".join(
        f"{one_line(axis(effect))} ({evidence(effect)})" for effect in findings.unexplained
    )
    if findings.effects:
        sentences = [f"What {findings.base} lacks here: {_missing(findings.effects)}."]
        if unexplained:
            sentences.append(
                f"Unexplained structure against {unexplained} is corrected as well, by a "
                "non-parametric term; no physical cause is claimed for it."
            )
        return " ".join([*sentences, f"{_change(findings)}."])
    if unexplained:
        before, after = _unseen(findings)
        return (
            "No known cause is found to be missing. "
            f"Unexplained structure against {unexplained}; a non-parametric correction "
            f"{_moves(before, after)} the error on runs not used for fitting "
            f"({_where(findings)}) from {error(before.value)} to {error_in_brackets(after)}, "
            f"at a noise floor of {error(findings.noise_floor)}; no physical cause is claimed."
        )
    before, _ = _unseen(findings)
    return (
        f"Nothing that these data could show is missing from {findings.base}"
        f"{_strongest(findings)}. Its error on runs not used for fitting ({_where(findings)}) is "
        f"{error_in_brackets(before)}, and the noise floor is {error(findings.noise_floor)}."
    )


def _bracketed(value: str, low: str, high: str) -> str:
    return f"{value} [{low}, {high}]" if low and high else value


def _missing(effects: Sequence[FoundEffect]) -> str:
    return "; ".join(
        f"{humanised(effect.name)} ("
        + "; ".join(part for part in (evidence(effect), class_sentence(effect)) if part)
        + ")"
        for effect in effects
    )


def _held_out(findings: Findings) -> Errors:
    """The test set where there is one; the runs each left out in turn where not."""
    return findings.test or findings.validation


def _unseen(findings: Findings) -> tuple[Interval, Interval]:
    errors = _held_out(findings)
    return errors.before, errors.after


def _where(findings: Findings) -> str:
    kind = "test set" if findings.test else "cross-validation"
    runs = _held_out(findings).runs
    return f"{kind}, {runs} run{'' if runs == 1 else 's'}"


def _moves(before: Interval, after: Interval) -> str:
    return "lowers" if after.value < before.value else "does not lower"


def _change(findings: Findings) -> str:
    before, after = _unseen(findings)
    removed = _held_out(findings).removed
    falls = after.value < before.value
    return (
        f"On runs not used for fitting ({_where(findings)}) the error "
        f"{'falls' if falls else 'does not fall:'} from {error(before.value)} to "
        f"{error_in_brackets(after)}, which removes {percent_in_brackets(removed)} of the squared "
        f"error; the noise floor is {error(findings.noise_floor)}"
    )


def _strongest(findings: Findings) -> str:
    """What came closest, so that nothing is said of an effect that was never looked for."""
    tested = [row for row in findings.ranking if np.isfinite(row.p_adjusted)]
    if not tested:
        return ""
    first = min(tested, key=lambda row: (row.p_adjusted, -row.z))
    but = ", but did not hold: see the ranking" if first.p_adjusted <= SIGNIFICANT else ""
    return (
        f" (the strongest of {len(findings.ranking)} candidates, {humanised(first.name)}, has "
        f"adjusted p = {p_value(first.p_adjusted)}{but})"
    )
