"""The verdict of a discovery, and the names, numbers and phrases that all its reports share."""

from collections.abc import Callable

import numpy as np

from adhesion_jax.data.columns import COLUMNS
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.state import AT_THE_ORIGIN
from adhesion_jax.discovery.types import (
    BRAKING,
    Candidate,
    Dependence,
    Errors,
    Findings,
    FoundEffect,
    Interval,
    Opinion,
)
from adhesion_jax.effects import in_words
from adhesion_jax.report.rendering import one_line, sentences_of
from adhesion_jax.wording import listed, number, p_is

#: What an effect does to the curve, by what it acts on.
_ACTS_ON = {
    "level": "acts on the level of the curve",
    "slip": "stretches the slip scale: the initial slope and the place of the peak move",
    "fall": "deepens or flattens the fall beyond the peak",
    "offset": "adds to the adhesion, whatever the slip is",
    "shift": "adds to the slip at which the curve is read",
}

#: A factor on adhesion that varies by less reads as a change of 0.0 %.
_TRIVIAL = 1e-3

#: Columns that are not measured but follow from the file.
_DERIVED = {
    "run_order": "order of the runs (1)",
    "campaign_time": "time in the campaign (1)",
    "run_time_s": "time since the run began (s)",
}
_SUFFIXES = ("per_m", "mps2", "mps", "pct", "rad", "deg", "s", "N", "C", "m")


def humanised(name: str) -> str:
    """An effect's name in words; names of columns stay as they are in the file."""
    return one_line(in_words(name))


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


def in_brackets(interval: Interval, written: Callable[[float], str] = number) -> str:
    """`value [low, high]` as its numbers are written, or the value alone."""
    value, low, high = map(written, interval)
    return (
        f"{value} [{low.removesuffix(' %')}, {high.removesuffix(' %')}]" if low and high else value
    )


def evidence(findings: Findings, effect: FoundEffect) -> str:
    if not np.isfinite(effect.p_adjusted):
        return "stated, and not tested"
    p = f"adjusted {p_is(effect.p_adjusted, findings.least_p)}"
    of_trees = " of boosted trees that predict runs left out by its columns, for which it was found"
    return p + of_trees * effect.by_trees


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
    if effect.acts_on == "level" and signals:
        return ""
    stays = effect.acts_on == "slip" and not {"level", "fall", "offset"} & {*effect.refined_on}
    return _ACTS_ON[effect.acts_on] + ", the maximum stays" * stays


def errors_by_data(findings: Findings) -> dict[str, Errors]:
    """The errors before and after, by the data that they are of."""
    unseen = "cross-validation" if findings.test is None else "test"
    errors = {
        f"{unseen}, slip smoothed": findings.smoothing,
        "training": findings.train,
        "cross-validation": findings.validation,
        "test": findings.test,
        "test, trees on top": findings.with_trees,
        "test, trees for comparison": findings.beside_trees,
    }
    return {data: of for data, of in errors.items() if of is not None}


def kind_of_run(findings: Findings) -> str:
    """`run`, or `block` where one run was cut: blocks bear that name (`adhesion_jax.data`)."""
    names = findings.points["run"].astype(str)
    return "block" if names.str.startswith("block ").all() else "run"


#: Functions that the template asks.
_WORDS = (
    *(acts_on, axis, class_sentence, error, evidence),
    *(humanised, in_brackets, kind_of_run, percent),
)

#: Effects that are claimed although they improve no prediction.
_IN_NOISE = ("torsion",)


def opinion_sentence(findings: Findings, opinion: Opinion) -> str:
    """The share of the residual that trees predict, from which columns, and what follows."""
    known = {word.__name__: word for word in (percent, error, in_brackets)}
    return sentences_of(
        "opinion.txt",
        findings=findings,
        opinion=opinion,
        hinted_above=rules.OPINION_SIGNIFICANT,
        **known,
    )[0]


def verdict(findings: Findings) -> str:
    """The verdict: what is missing, the evidence for it, and how far the error falls."""
    held_out = _held_out(findings)
    effects = [
        effect
        for effect in findings.effects
        if effect.name not in _IN_NOISE and np.isfinite(effect.p_adjusted)
    ]
    told = sentences_of(
        "discover.txt",
        findings=findings,
        effects=effects,
        stated=[one for one in findings.effects if not np.isfinite(one.p_adjusted)],
        part_of_noise=_IN_NOISE,
        open_questions=_open_questions(findings, bool(effects or findings.unexplained)),
        first=_first_of_ranking(findings),
        held_out=held_out,
        where=_where(findings),
        unlike=_unlike(findings),
        significant=rules.SIGNIFICANT,
        size_of=_size,
        braking=BRAKING,
        adds=any(
            {*AT_THE_ORIGIN} & {effect.acts_on, *effect.refined_on}
            for effect in (*findings.effects, *findings.unexplained)
        ),
        told_of=_told_of,
        values_at_bound=_values_at_bound,
        **{word.__name__: word for word in _WORDS},
    )
    return " ".join(told)


def _values_at_bound(effect: FoundEffect) -> list[str]:
    """The parameters that stand at an end of the range in which they are looked for."""
    return [
        f"{name} at {number(effect.parameters[name].value)}"
        + ("" if (unit := effect.units.get(name, "1")) == "1" else f" {one_line(unit)}")
        for name in effect.at_bound
    ]


def _unlike(findings: Findings) -> list[str]:
    """How many times the error on the test set is that of cross-validation, if clearly another."""
    if findings.test is None:
        return []
    usual, now = findings.validation, findings.test
    few = min(usual.runs, now.runs) < rules.FEWEST_RUNS
    least = rules.UNLIKE_TRAINING if few else 0.0
    return [
        f"{number(one.value / other.value)} times {when}"
        for when, one, other in (
            ("before", now.before, usual.before),
            ("after", now.after, usual.after),
        )
        if one.low > max(other.high, least * other.value) > 0
        or (when == "before" and not few and one.high < other.low)
    ]


def _open_questions(findings: Findings, claims: bool) -> list[str]:
    """Sentences, without full stops, on structure in the data that is not counted as an effect.

    `claims` says whether the verdict names an effect.
    """
    told = sentences_of(
        "open_questions.txt",
        findings=findings,
        claims=claims,
        first=_first_of_ranking(findings),
        significant=rules.SIGNIFICANT,
        opinion=findings.opinion and opinion_sentence(findings, findings.opinion),
        **{word.__name__: word for word in (decision, humanised, percent)},
    )
    return [sentence.rstrip(".") for sentence in told]


def _size(findings: Findings, effect: FoundEffect) -> str:
    """Size and sign of the change of adhesion over the column that changes it most.

    Empty where that is below a tenth of a per cent. What acts on a part of the curve has another
    size at every slip, and is told where it is largest; what two columns do together has another at
    every value of the other column, and is told at its median.
    """
    own = [one for one in findings.dependences if one.effect == effect.name]
    most = max(own, key=lambda one: float(np.ptp(one.factor)), default=None)
    if most is None or np.ptp(most.factor) < _TRIVIAL:
        return ""
    at_slip = f"at slip {most.at_slip:.2g} " if np.isfinite(most.at_slip) else ""
    held = beside_median(findings, most)
    at_median = f"{held}, " if held else ""
    return at_slip + at_median + (_of_labels(most) if most.labels else _over(most))


def beside_median(findings: Findings, dependence: Dependence) -> str:
    """That the other column of what two do together is at its median; empty for other effects."""
    own = [one.column for one in findings.dependences if one.effect == dependence.effect]
    others = [column for column in own if column != dependence.column]
    joint = dependence.effect.startswith("product:") and others
    return f"with {listed(others)} at its median" if joint else ""


def _of_labels(own: Dependence) -> str:
    """The one label that stands out from all others, or the lowest beside the highest."""
    factor = own.factor
    place = int(np.argmax(np.abs(factor - np.median(factor))))
    others = np.delete(factor, place)
    change = factor[place] / np.median(others) - 1
    if others.size > 1 and abs(factor[place] - np.median(others)) > 2 * np.ptp(others):
        return (
            f"adhesion is {_compared(change)} where {own.column} is {own.labels[place]} than its "
            "median over the other labels"
        )
    low, high = int(np.argmin(factor)), int(np.argmax(factor))
    return (
        f"adhesion is {_compared(factor[low] / factor[high] - 1)} where {own.column} is "
        f"{own.labels[low]} than where it is {own.labels[high]}"
    )


def _over(own: Dependence) -> str:
    """The change over a column of numbers."""
    column, values, factor = column_label(own.column, own.unit), own.values, own.factor
    turned = np.flatnonzero(factor < 0)
    if turned.size:  # as next to slip 0, which a bias moves
        return f"adhesion has the other sign where {column} is {number(values[turned[0]])}"
    if abs(factor[-1] - factor[0]) > 0.8 * np.ptp(factor):
        change = factor[-1] / factor[0] - 1
        return (
            f"adhesion {'falls' if change < 0 else 'rises'} by {percent(abs(change))} as {column} "
            f"goes from {number(values[0])} to {number(values[-1])}{_step(values, factor)}"
        )
    place = int(np.argmax(np.abs(factor - 1)))
    # Most of the column is without an effect that acts in one place, as a patch of the rail does.
    if np.mean(np.abs(factor - 1) < 0.1 * np.ptp(factor)) > 0.5:
        change, other = factor[place] - 1, "without it"
    else:
        place, top = int(np.argmin(factor)), int(np.argmax(factor))
        change, other = factor[place] / factor[top] - 1, f"where it is {number(values[top])}"
    return f"adhesion is {_compared(change)} where {column} is {number(values[place])} than {other}"


def _step(values: np.ndarray, factor: np.ndarray) -> str:
    """Where most of a change lies, if two thirds of it lie in a tenth of the column."""
    width = 0.1 * (values[-1] - values[0])
    change = np.abs(np.interp(values + width, values, factor) - factor)
    place = int(np.argmax(change))
    in_one_place = change[place] > 2 / 3 * np.ptp(factor)
    return f", most of it near {number(values[place] + width / 2)}" if in_one_place else ""


def _compared(change: float) -> str:
    return f"{percent(abs(change))} {'lower' if change < 0 else 'higher'}"


def _told_of(own: Dependence) -> Interval:
    """The factor that is told of the dependence of a curve itself."""
    return Interval(*(float(one[own.told]) for one in (own.factor, own.low, own.high)))


def _held_out(findings: Findings) -> Errors:
    """The errors on the test set; if there is none, those of cross-validation."""
    return findings.test or findings.validation


def _where(findings: Findings) -> str:
    kind = kind_of_run(findings)
    count = _held_out(findings).runs
    # The findings do not say whether a test set consists of runs or of blocks.
    parts = "run or block" if findings.test and kind == "block" else kind
    plural = " ".join(f"{word}s" if word != "or" else word for word in parts.split())
    source = "test set" if findings.test else "cross-validation"
    return f"on {kind}s not used for fitting ({source}, {count} {parts if count == 1 else plural})"


def _first_of_ranking(findings: Findings) -> Candidate | None:
    tested = [row for row in findings.ranking if np.isfinite(row.p_adjusted)]
    return min(tested, key=lambda row: (row.p_adjusted, -row.z), default=None)
