"""The verdict of a discovery: what is missing, the evidence for it, and how far the error falls."""

import numpy as np

from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.types import Candidate, Errors, Findings, FoundEffect, Opinion
from adhesion_jax.report.discovery.words import (
    acts_on,
    axis,
    class_sentence,
    column_label,
    decision,
    error,
    error_in_brackets,
    evidence,
    humanised,
    kind_of_run,
    percent,
    percent_in_brackets,
)
from adhesion_jax.report.rendering import sentences_of
from adhesion_jax.report.text import one_line
from adhesion_jax.wording import number

#: Functions that the template asks.
_WORDS = (
    *(acts_on, axis, class_sentence, error, error_in_brackets, evidence),
    *(humanised, kind_of_run, percent_in_brackets),
)

#: Effects that are claimed although they improve no prediction.
_IN_NOISE = ("torsion",)

#: Words that every warning of an effect that was found and dropped contains.
_DROPPED = "not counted as an effect"


def opinion_sentence(findings: Findings, opinion: Opinion) -> str:
    """The share of the residual that trees predict, from which columns, and what follows."""
    known = {word.__name__: word for word in (percent, error, error_in_brackets)}
    return sentences_of("opinion.txt", findings=findings, opinion=opinion, **known)[0]


def verdict(findings: Findings) -> str:
    """The verdict: what is missing, the evidence for it, and how far the error falls."""
    held_out = _held_out(findings)
    told = sentences_of(
        "discover.txt",
        findings=findings,
        effects=[effect for effect in findings.effects if effect.name not in _IN_NOISE],
        part_of_noise=_IN_NOISE,
        open_questions=_open_questions(findings),
        first=_first_of_ranking(findings),
        held_out=held_out,
        where=_where(findings),
        unlike=_unlike(findings),
        significant=rules.SIGNIFICANT,
        size_of=_size,
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


def _open_questions(findings: Findings) -> list[str]:
    """Sentences, without full stops, on structure in the data that is not counted as an effect."""
    told = sentences_of(
        "open_questions.txt",
        findings=findings,
        dropped=[text for text in findings.warnings if _DROPPED in text],
        first=_first_of_ranking(findings),
        significant=rules.SIGNIFICANT,
        opinion=findings.opinion and opinion_sentence(findings, findings.opinion),
        **{word.__name__: word for word in (decision, humanised, percent)},
    )
    return [sentence.rstrip(".") for sentence in told]


def _size(findings: Findings, effect: FoundEffect) -> str:
    """Size and sign of the change of adhesion over the column that changes it most."""
    own = [one for one in findings.dependences if one.effect == effect.name]
    if not own:
        return ""
    most = max(own, key=lambda one: float(np.ptp(one.factor)))
    column, factor = column_label(most.column, most.unit), most.factor
    turned = np.flatnonzero(factor < 0)
    if turned.size:  # as next to slip 0, which a bias moves
        return f"adhesion has the other sign where {column} is {number(most.values[turned[0]])}"
    if abs(factor[-1] - factor[0]) > 0.8 * np.ptp(factor) > 0:
        change = factor[-1] / factor[0] - 1
        return (
            f"adhesion {'falls' if change < 0 else 'rises'} by {percent(abs(change))} as {column} "
            f"goes from {number(most.values[0])} to {number(most.values[-1])}"
        )
    place = int(np.argmax(np.abs(factor - 1)))
    change = factor[place] - 1
    return (
        f"adhesion is {percent(abs(change))} {'lower' if change < 0 else 'higher'} where {column} "
        f"is {number(most.values[place])} than at its median"
    )


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
