"""One round of the search: the candidates of largest score are refitted, and one is chosen."""

import dataclasses
from bisect import bisect_right
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from adhesion_jax.discovery.model.fitting import Fitted, refitted, side_by_side
from adhesion_jax.discovery.model.prediction import (
    Gain,
    expected_loss,
    gain,
    gain_of,
)
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.screening import Score
from adhesion_jax.discovery.types import Candidate
from adhesion_jax.effects import (
    EFFECTS,
    Cause,
    Covariate,
    Effect,
    Interaction,
    Labels,
    Memory,
    ShapeTerm,
    Spline,
)


def of_signals() -> tuple[str, ...]:
    """Errors of the signals: with Burckhardt's curve no data separate them, with others hardly."""
    return tuple(name for name, cause in EFFECTS.items() if cause.FACTS.of_slip_alone)


class Trial(NamedTuple):
    """A candidate refitted together with the model."""

    score: Score
    fitted: Fitted
    loss: float  # expected on runs left out, summed over all runs


def trial_of(fitted: Fitted, score: Score) -> Trial:
    """A model as it is, as a trial that others are compared with."""
    return Trial(score, fitted, float(expected_loss(fitted).sum()))


def fitted_start(trial: Trial) -> Effect:
    """The effect that a trial has added, with the parameters of its fit."""
    return trial.fitted.effects[new_slot(trial)]


def new_slot(trial: Trial) -> int:
    """Where the effect that a trial has added stands: the last of those of its ORDER."""
    orders = [effect.ORDER for effect in trial.fitted.effects]
    return bisect_right(orders, trial.score.start.ORDER) - 1


def shortlisted(scores: Sequence[Score], significant: float) -> Sequence[Score]:
    """The causes and the plain columns of largest score; none if no p is at most `significant`."""
    if not scores or min(score.p for score in scores) > significant:
        return []
    most = rules.SHORTLISTED_TIMES * significant
    first = sorted((one for one in scores if one.p <= most), key=lambda one: -one.gains.sum())
    causes = [score for score in first if not score.entry.generic][: rules.TRIED_CAUSES]
    columns = [score for score in first if score.entry.generic][: rules.TRIED_COLUMNS]
    return [*causes, *columns]


def tried(fitted: Fitted, shortlist: Sequence[Score]) -> Sequence[Trial]:
    """Each candidate refitted together with the model, if that lowers its loss."""
    fits = side_by_side(
        lambda score: refitted(fitted, (*fitted.effects, _small(score.start))), shortlist
    )
    return [
        trial_of(more, score)
        for score, more in zip(shortlist, fits, strict=True)
        if np.isfinite(more.total) and more.total < fitted.total
    ]


def _small(start: Effect) -> Effect:
    """The start itself; a term that is linear in its strengths begins at zero."""
    if not isinstance(start, ShapeTerm):
        return start
    nothing: dict[str, Any] = dict.fromkeys(start.FACTS.strengths, 0.0)
    return dataclasses.replace(start, **nothing)


def choose(trials: Sequence[Trial], now: Trial) -> Trial:
    """The candidate that explains the residual of the model `now`.

    The best physical cause whose sign is possible, unless the best plain column is clearly ahead of
    it, or the cause reaches but a small part of what the column gains. A line over a column that
    the cause does not rest on is as plain as any formula: it need not be ahead by much.
    """
    causes = [trial for trial in trials if not trial.score.entry.generic]
    columns = [trial for trial in trials if trial.score.entry.generic]
    if not columns:
        return min(causes, key=lambda trial: trial.loss)
    column = _best_column(columns, now)
    causes = [trial for trial in causes if _of_possible_sign(trial)]
    if not causes:
        return column
    cause = min(causes, key=lambda trial: trial.loss)
    much = rules.CAUSE_SHARE_OF_GAIN * (now.loss - column.loss)
    rests_on = {*cause.score.entry.covariates}
    lines = (one for one in columns if isinstance(one.score.start, Covariate))
    others = (line for line in lines if not rests_on & {*line.score.entry.covariates})
    behind = clearly_ahead(cause, column, now) or any(_surely_ahead(cause, one) for one in others)
    fits = now.loss - cause.loss > much and not behind
    return cause if fits else column


def _of_possible_sign(trial: Trial) -> bool:
    """Whether no strength of a cause is below 0 that would have to be above it."""
    found = fitted_start(trial)
    if not isinstance(found, Cause) or not found.FACTS.one_sided:
        return True
    return all(getattr(found, name) >= 0 for name in found.FACTS.strengths)


def _best_column(columns: Sequence[Trial], now: Trial) -> Trial:
    """The best plain column, unless a pair of columns is clearly ahead of it."""
    single = [trial for trial in columns if len(trial.score.entry.covariates) == 1]
    best = min(columns, key=lambda trial: trial.loss)
    if not single:
        return best
    one = min(single, key=lambda trial: trial.loss)
    return best if clearly_ahead(one, best, now) else one


def clearly_ahead(plainer: Trial, other: Trial, now: Trial) -> bool:
    """Whether a candidate gains so much more than a plainer one that it is preferred."""
    ahead = gain(plainer.fitted, other.fitted)
    much = ahead.total > rules.COLUMN_SHARE_OF_GAIN * (now.loss - other.loss)
    return much and ahead.deviate > rules.AHEAD_ERRORS


def _surely_ahead(plainer: Trial, other: Trial) -> bool:
    """Whether a candidate gains more than another one, however little."""
    return gain(plainer.fitted, other.fitted).deviate > rules.AHEAD_ERRORS


def class_of(scores: Sequence[Score], chosen: Score) -> tuple[str, ...]:
    """The names that the data cannot tell from the chosen one: its own, then what gains most.

    Each is judged by what it would gain on runs left out to first order, all in the same way.
    """
    name = chosen.entry.name
    members: dict[str, None] = {}
    if not chosen.change.size:
        return (name,)
    for score in sorted(scores, key=lambda score: -score.gains.sum()):
        same_columns = score.entry.covariates == chosen.entry.covariates
        if not score.change.size or (same_columns and score.entry.generic):
            # The plain form of a cause's columns is no other name.
            continue
        size = np.linalg.norm(chosen.change) * np.linalg.norm(score.change)
        alike = abs(chosen.change @ score.change) > rules.CLASS_COSINE * size
        if alike and tied(gain_of(chosen.gains - score.gains)):
            members[score.entry.name] = None
    if name in of_signals():
        members.update(dict.fromkeys(of_signals()))
    return (name, *(member for member in members if member != name))


def is_worth(less: Fitted, more: Fitted, generic: bool = False) -> bool:
    """Whether the effects that `more` has beyond `less` lower the expected loss surely and enough.

    In a log of one run in time they must do so without any one stretch of it as well: what happened
    once, at one time and place, goes with every column that was different there.
    """
    gains = expected_loss(less) - expected_loss(more)
    gained, stretch = gain_of(gains), 0.0
    if less.log:
        stretch = float(np.convolve(gains, np.ones(rules.STRETCH_BLOCKS)).max())
    needed = rules.SURE_ERRORS_OF_COLUMN if generic else rules.SURE_ERRORS
    sure = gained._replace(total=gained.total - stretch).deviate > needed
    noise = 0.5 * float((less.setting.root > 0).sum())
    return sure and gained.total > min(rules.LEAST_SHARE_OF_LOSS * noise, rules.LEAST_GAIN)


def tied(behind: Gain) -> bool:
    """Whether the data leave open which of two models is better; `behind` is the gain of one."""
    return behind.total <= rules.UNDECIDED_GAIN or behind.deviate <= rules.AHEAD_ERRORS


def ranked(
    number: int,
    scores: Sequence[Score],
    trials: Sequence[Trial],
    now: Trial | None,
    chosen: Trial | None,
    members: Sequence[str],
    accepted: bool,
) -> list[Candidate]:
    """The rows of the ranking of round `number`, one a score.

    `chosen` is one of the trials, or None where none of them was chosen; `members` is its class,
    and `accepted` says whether it became an effect.
    """
    by_form = {trial.score.form: trial for trial in trials}
    rows = []
    for score in scores:
        trial = by_form.get(score.form)
        gained = Gain(np.nan, np.nan)
        if trial is not None and now is not None:
            gained = gain(now.fitted, trial.fitted)
        if trial is None:
            decision = "not significant" if score.p > rules.SIGNIFICANT else "less telling"
        elif chosen is not None and score.form == chosen.score.form:
            decision = "accepted" if accepted else "does not lower the held-out error"
        elif score.entry.name in members:
            decision = f"in the class of {members[0]}"
        else:
            decision = "not significant" if score.p > rules.SIGNIFICANT else "explains less"
        rows.append(
            Candidate(number, _label(score), score.z, score.p, gained.total, gained.error, decision)
        )
    return rows


def _label(score: Score) -> str:
    """The name of an entry with its form and the part of the curve that it acts on."""
    kinds = {Covariate: "linear", Spline: "spline", Labels: "labels", Memory: "memory"}
    kinds[Interaction] = "mixed terms"
    said = [kinds.get(type(score.start), ""), score.entry.acts_on]
    more = ", on the ".join(word for word in said if word not in ("", "level"))
    return f"{score.entry.name} ({more})" if more else score.entry.name
