"""The verdict of a discovery: what is missing, the evidence for it, and how far the error falls."""

from collections.abc import Sequence

import numpy as np

from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.types import Candidate, Errors, Findings, FoundEffect, Interval, Opinion
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
    one_line,
    percent,
    percent_in_brackets,
)
from adhesion_jax.wording import listed, number, p_is

#: Effects that are claimed although they improve no prediction.
_IN_NOISE = ("torsion",)

#: Words that every warning of an effect that was found and dropped contains.
_DROPPED = "not counted as an effect"


def opinion_sentence(findings: Findings, opinion: Opinion) -> str:
    """The share of the residual that trees predict, from which columns, and what follows."""
    source = "the slip itself, or columns that go together"
    if opinion.columns:
        source = listed([one_line(name) for name in opinion.columns])
    more = ""
    if findings.test and findings.with_trees:
        usual, now = findings.test.after.value, findings.with_trees.after
        more = (
            f". On top of the law they take its error on the test set from {error(usual)} to "
            f"{error_in_brackets(now)}: "
            "a correction without a formula, from these columns, which is not in law.json"
        )
    elif opinion.correction is not None:
        more = (
            ". To have a test set predicted with the trees on top of the law, a correction without "
            "a formula, add --correct and --test (in Python correct=True and test)"
        )
    return (
        f"Boosted trees predict {percent(opinion.explained)} ± {percent(opinion.error)} of the "
        f"squared residual (outliers cut) of runs that they were not fitted to, from {source} "
        f"({p_is(opinion.p)}): something is missing that the law has no form for"
        f"{more}"
    )


def verdict(findings: Findings) -> str:
    """The verdict: what is missing, the evidence for it, and how far the error falls."""
    effects = [effect for effect in findings.effects if effect.name not in _IN_NOISE]
    sentences = []
    if effects:
        sentences.append(f"What {findings.base} lacks here: {_missing(findings, effects)}.")
        if findings.unexplained:
            sentences.append(
                f"Unexplained structure against {_axes(findings)} is corrected as well, by a "
                "non-parametric term; no physical cause is claimed for it."
            )
    elif findings.unexplained:
        sentences.append(
            "No known cause is found to be missing, but there is unexplained structure against "
            f"{_axes(findings)}; it is corrected by a non-parametric term, and no physical cause "
            "is claimed."
        )
    open_questions = _open_questions(findings)
    if sentences:
        sentences += [f"{_change(findings)}.", _by_chance(findings), *_at_bounds(findings)]
        sentences += [f"{words}." for words in open_questions]
    elif open_questions:
        first, *others = open_questions
        sentences = [
            f"No effect is claimed, but {first[0].lower()}{first[1:]}.",
            *(f"{words}." for words in others),
            _error_alone(findings),
        ]
    else:
        sentences = [
            f"Nothing that these data could show is missing from {findings.base}"
            f"{_strongest(findings)}.",
            _error_alone(findings),
        ]
    return " ".join([*sentences, *_in_noise(findings), *_unlike(findings)])


def _by_chance(findings: Findings) -> str:
    """How many of the effects may be there by chance, and the smallest p that there can be."""
    rare, least = rules.SIGNIFICANT, findings.least_p
    floor = ""
    if least:
        floor = (
            f", and {least:.2g} is the smallest p that {1 / least - 1:,.0f} patterns of signs of "
            f"the {kind_of_run(findings)}s can show"
        )
    return (
        "Each p is adjusted for everything that was looked at, and an effect is reported only if "
        f"it is at most {rare}: at most about 1 in {1 / rare:.0f} of the effects reported is there "
        f"by chance{floor}."
    )


def _at_bounds(findings: Findings) -> list[str]:
    """Sentences on parameters that stand at an end of the range in which they are looked for."""
    sentences = []
    for effect in (*findings.effects, *findings.unexplained):
        if effect.at_bound:
            values = [
                f"{name} at {number(effect.parameters[name].value)}"
                + ("" if (unit := effect.units.get(name, "1")) == "1" else f" {one_line(unit)}")
                for name in effect.at_bound
            ]
            sentences.append(
                f"Of {humanised(effect.name)} {listed(values)} "
                f"{'stands' if len(values) == 1 else 'stand'} at an end of the range that is "
                "searched: the data ask for more than that or do not determine it, and no interval "
                "can be given for it."
            )
    return sentences


def _unlike(findings: Findings) -> list[str]:
    """Sentences on test data that are unlike the training data."""
    sentences = [one_line(sentence) for sentence in findings.outside]
    if findings.test is None:
        return sentences
    usual, now = findings.validation, findings.test
    few = min(usual.runs, now.runs) < rules.FEWEST_RUNS_TO_COMPARE
    least = rules.UNLIKE_TRAINING if few else 0.0
    ratios = {
        when: one.value / other.value
        for when, one, other in (
            ("before", now.before, usual.before),
            ("after", now.after, usual.after),
        )
        if one.low > max(other.high, least * other.value) > 0
        or (when == "before" and not few and one.high < other.low)
    }
    if ratios:
        what = listed([f"{number(ratio)} times {when}" for when, ratio in ratios.items()])
        sentences.append(
            f"Of that on training {kind_of_run(findings)}s left out, the error on the test set is "
            f"{what}, and their intervals do not touch: the test data are unlike the training "
            "data, or something acts in them that did not act there."
        )
    return sentences


def _axes(findings: Findings) -> str:
    return " and ".join(
        f"{one_line(axis(effect))} ({evidence(findings, effect)})"
        for effect in findings.unexplained
    )


def _open_questions(findings: Findings) -> list[str]:
    """Sentences, without full stops, on structure in the data that is not counted as an effect."""
    return [
        *_did_not_hold(findings),
        *(one_line(doubt.sentence).rstrip(".") for doubt in findings.doubts),
        *([opinion_sentence(findings, findings.opinion)] if findings.opinion else []),
        *_scatter(findings),
    ]


def _did_not_hold(findings: Findings) -> list[str]:
    """Sentences on dropped effects; if nothing was found, on the candidate that stood out."""
    if findings.doubts:
        return []
    dropped = [one_line(text) for text in findings.warnings if _DROPPED in text]
    if dropped or findings.effects or findings.unexplained:
        return [text.rstrip(".") for text in dropped]
    first = _first_of_ranking(findings)
    if first is None or first.p_adjusted > rules.SIGNIFICANT:
        return []
    return [
        f"{humanised(first.name)} stands out among {len(findings.ranking)} candidates (adjusted "
        f"{p_is(first.p_adjusted, findings.least_p)}) and was not accepted "
        f"({decision(first.decision)}): something is missing that these data do not determine. "
        "Look at the residual against every column, and measure more runs that differ in them"
    ]


def _scatter(findings: Findings) -> list[str]:
    """A sentence on the run scatter, if no law is found and it exceeds the noise within runs."""
    sigma, scatter = (findings.noise.get(name, 0.0) for name in ("sigma", "run_scatter"))
    if findings.effects or findings.unexplained or findings.noise_floor**2 < 2 * sigma**2:
        return []
    return [
        f"The level of adhesion differs from run to run by {percent(scatter)}, which no effect "
        "explains and which is more than the noise within the runs"
    ]


def _in_noise(findings: Findings) -> list[str]:
    """Sentences on effects that no prediction can use."""
    return [
        f"{humanised(effect.name)[0].upper()}{humanised(effect.name)[1:]} "
        f"({evidence(findings, effect)}) is part of the noise: its phase differs from run to run, "
        "so that it improves no prediction."
        for effect in findings.effects
        if effect.name in _IN_NOISE
    ]


def _error_alone(findings: Findings) -> str:
    before, _ = _unseen(findings)
    return (
        f"The error of {findings.base} {_where(findings)} is {error_in_brackets(before)}, and the "
        f"noise floor is {error(findings.noise_floor)}."
    )


def _missing(findings: Findings, effects: Sequence[FoundEffect]) -> str:
    described = []
    for effect in effects:
        shape = acts_on(effect) if effect.acts_on != "level" else ""
        size = shape or _size(findings, effect)
        facts = (evidence(findings, effect), size, class_sentence(effect))
        described.append(f"{humanised(effect.name)} ({'; '.join(part for part in facts if part)})")
    return "; ".join(described)


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


def _unseen(findings: Findings) -> tuple[Interval, Interval]:
    errors = _held_out(findings)
    return errors.before, errors.after


def _where(findings: Findings) -> str:
    kind = kind_of_run(findings)
    count = _held_out(findings).runs
    # The findings do not say whether a test set consists of runs or of blocks.
    parts = "run or block" if findings.test and kind == "block" else kind
    plural = " ".join(f"{word}s" if word != "or" else word for word in parts.split())
    source = "test set" if findings.test else "cross-validation"
    return f"on {kind}s not used for fitting ({source}, {count} {parts if count == 1 else plural})"


def _change(findings: Findings) -> str:
    before, after = _unseen(findings)
    where = _where(findings)
    start = f"{where[0].upper()}{where[1:]} the error"
    floor = f"the noise floor is {error(findings.noise_floor)}"
    if error(before.value) == error(after.value):
        return f"{start} stays at {error_in_brackets(after)}: no prediction improves; {floor}"
    if after.value > before.value:
        return (
            f"{start} does not fall: it rises from {error(before.value)} to "
            f"{error_in_brackets(after)}, so that the correction is of no use there; {floor}"
        )
    removed = percent_in_brackets(_held_out(findings).removed)
    alone = f" (of {findings.base_before}, the best curve alone)" if findings.base_before else ""
    return (
        f"{start} falls from {error(before.value)}{alone} to {error_in_brackets(after)}, which "
        f"removes {removed} of the squared error; {floor}"
    )


def _first_of_ranking(findings: Findings) -> Candidate | None:
    tested = [row for row in findings.ranking if np.isfinite(row.p_adjusted)]
    return min(tested, key=lambda row: (row.p_adjusted, -row.z), default=None)


def _strongest(findings: Findings) -> str:
    """The strongest candidate and the number of candidates, in brackets."""
    first = _first_of_ranking(findings)
    if first is None:
        return ""
    return (
        f" (the strongest of {len(findings.ranking)} candidates, {humanised(first.name)}, has "
        f"adjusted {p_is(first.p_adjusted, findings.least_p)})"
    )
