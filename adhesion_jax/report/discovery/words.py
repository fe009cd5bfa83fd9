"""Names, numbers and phrases that all reports of a discovery share."""

import numpy as np

from adhesion_jax.data.columns import COLUMNS
from adhesion_jax.discovery.types import Errors, Findings, FoundEffect, Interval
from adhesion_jax.effects import KINDS
from adhesion_jax.report.text import one_line
from adhesion_jax.wording import listed, number, p_is

#: What is found beside the effects and is none.
_NOISE = {"slip_noise": "noise in the slip signal"}

#: What an effect does to the curve, by what it acts on.
_ACTS_ON = {
    "level": "acts on the level of the curve",
    "slip": "stretches the slip scale: the initial slope and the place of the peak move, the "
    "maximum stays",
    "fall": "deepens or flattens the fall beyond the peak",
    "offset": "adds to the adhesion, whatever the slip is",
    "shift": "adds to the slip at which the curve is read",
}

#: Columns that are not measured but follow from the file.
_DERIVED = {"run_order": "order of the runs (1)", "campaign_time": "time in the campaign (1)"}
_SUFFIXES = ("per_m", "mps2", "mps", "pct", "rad", "deg", "s", "N", "C", "m")


def humanised(name: str) -> str:
    """An effect's name in words; names of columns stay as they are in the file."""
    kind, _, column = name.partition(":")
    if kind not in KINDS:
        words = _NOISE.get(kind, kind.replace("_", " "))
        return one_line(words + (f" of {column}" if column else ""))
    return KINDS[kind].FACTS.phrase.replace("{}", one_line(column))


def decision(words: str) -> str:
    """What became of a candidate, the name of a class in words."""
    start = "in the class of "
    return start + humanised(words[len(start) :]) if words.startswith(start) else one_line(words)


def column_label(name: str, unit: str = "") -> str:
    """A column with its unit; an unknown column is labelled with its name as it is in the file."""
    if name in _DERIVED:
        return _DERIVED[name]
    if name not in COLUMNS:
        return f"{one_line(name)} ({unit})" if unit else one_line(name)
    words = next(
        (name.removesuffix(f"_{end}") for end in _SUFFIXES if name.endswith(f"_{end}")), ""
    )
    return f"{(words or name).replace('_', ' ')} ({COLUMNS[name].unit})"


def error(value: float) -> str:
    """An error of adhesion with five decimals, below .001 four digits; empty if not finite."""
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


def _bracketed(value: str, low: str, high: str) -> str:
    return f"{value} [{low}, {high}]" if low and high else value


def evidence(findings: Findings, effect: FoundEffect) -> str:
    if not np.isfinite(effect.p_adjusted):
        return "stated, and not tested"
    return f"adjusted {p_is(effect.p_adjusted, findings.least_p)}"


def candidates(effect: FoundEffect) -> tuple[str, ...]:
    """The class of an effect, itself first."""
    return (effect.name, *(name for name in effect.candidates if name != effect.name))


def class_sentence(effect: FoundEffect) -> str:
    """A sentence on the names that the data cannot tell from the effect; empty if there is none."""
    first, *others = (humanised(name) for name in candidates(effect))
    return f"the data cannot tell {first} from {listed(others, 'or')}" if others else ""


def axis(effect: FoundEffect) -> str:
    """The column, or columns, that a structure without a known cause lies along."""
    return " x ".join(effect.covariates) or effect.name.partition(":")[2] or effect.name


def acts_on(effect: FoundEffect) -> str:
    """What the effect does to the curve; empty for an effect of signals or of time."""
    signals = not effect.covariates or {"time_s", "slip_ratio"} & {*effect.covariates}
    return "" if effect.acts_on == "level" and signals else _ACTS_ON[effect.acts_on]


def errors_by_data(findings: Findings) -> dict[str, Errors]:
    """The errors before and after, by the data that they are of."""
    errors = {
        "training": findings.train,
        "cross-validation": findings.validation,
        "test": findings.test,
        "test, trees on top": findings.with_trees,
    }
    return {data: of for data, of in errors.items() if of is not None}


def kind_of_run(findings: Findings) -> str:
    """`run`, or `block` where one run was cut: blocks bear that name (`adhesion_jax.data`)."""
    names = findings.points["run"].astype(str)
    return "block" if names.str.startswith("block ").all() else "run"
