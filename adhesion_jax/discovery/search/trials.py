"""What is tried in one round: the most telling causes refitted jointly, and the choice of one."""

from collections.abc import Sequence
from itertools import compress
from typing import NamedTuple

import numpy as np

from adhesion_jax.discovery.model.fitting import (
    Fitted,
    Gain,
    best_stretch,
    expected_loss,
    gain,
    least_gain,
    nearly_fitted,
    side_by_side,
    squares,
    with_own_noise,
)
from adhesion_jax.discovery.search.screening import SIGNIFICANT, Score
from adhesion_jax.discovery.types import Candidate
from adhesion_jax.effects import EFFECTS, Covariate, Spline

#: An effect is accepted from this share of the loss on, and this many standard errors above zero:
#: nine times in ten it then predicts runs better that nobody has seen; nineteen times in twenty
#: where it is a plain column, for which no physics speaks.
_LEAST_GAIN, _SURE, _SURE_OF_COLUMN = 0.003, 1.28, 1.645

#: How many causes and how many forms of plain columns are refitted in each round.
_CAUSES, _COLUMNS = 6, 5

#: A candidate contends if it gains this share of what the best one gains, before its own noise.
_CONTENDS = 0.1

#: A plain column is preferred to a cause, and two columns to one, only by so many standard errors,
#: this share of the loss and this share of the gain.
_COLUMN_ERRORS, _COLUMN_LOSS, _COLUMN_GAIN = 2.0, 0.01, 0.15

#: A cause that explains this share of what a plain column on it does, has the wrong form only.
_SAME_CAUSE = 0.5

#: Causes within so many standard errors and this share of the gain are one class.
_CLASS_ERRORS, _CLASS_GAIN = 2.0, 0.10

#: Formulas of one family differ by more than this share of the gain, or are one class.
_KIN_GAIN = 0.25

#: Causes of one class change the prediction alike, by this cosine at least.
_ALIKE = 0.5

#: A likelihood ratio below exp(2) decides nothing, however small the gain.
_CLASS_LEAST = 2.0

#: Errors of the signals: for Burckhardt's curve no data separate them, for others hardly any.
OF_SIGNALS = tuple(name for name, cause in EFFECTS.items() if cause.OF_SLIP_ALONE)


class Trial(NamedTuple):
    """A candidate refitted together with the model, with a noise of its own."""

    score: Score
    fitted: Fitted
    loss: float  # expected, over all runs


def trial_of(fitted: Fitted, score: Score) -> Trial:
    """A model as it is, to hold others against."""
    return Trial(score, fitted, float(expected_loss(fitted).sum()))


def shortlisted(scores: Sequence[Score], significant: float) -> Sequence[Score]:
    """The most telling causes and columns, where the best of all is significant."""
    if not scores or min(score.p for score in scores) > significant:
        return []
    causes = [score for score in scores if not score.entry.generic][:_CAUSES]
    columns = [score for score in scores if score.entry.generic][:_COLUMNS]
    return [score for score in (*causes, *columns) if score.p <= 10 * significant]


def tried(fitted: Fitted, shortlist: Sequence[Score]) -> Sequence[Trial]:
    """Joint refits, each contender under the noise that it leaves itself."""
    # From where each was seen and from where the model is: noise and fit may stand in two places.
    starts = [
        (score, start)
        for score in shortlist
        for start in ([fitted] if score.seen_in is fitted else [score.seen_in, fitted])
    ]

    def begun(one: tuple[Score, Fitted]) -> Fitted:
        score, start = one
        values = start.base_values.tolist()
        return nearly_fitted(start.setting, start.base, values, (*start.effects, score.start))

    first = side_by_side(begun, starts)
    gains = [start.total - more.total for (_, start), more in zip(starts, first, strict=True)]
    most = max((one for one in gains if np.isfinite(one)), default=0.0)
    # A noise of its own may treble what a cause that acts from run to run gains, but seldom makes
    # ten times of it: what gains less than a tenth of the best stays under the noise there is.
    contends = [one > _CONTENDS * most for one in gains]
    own = iter(side_by_side(with_own_noise, list(compress(first, contends))))
    last = [next(own) if one else more for one, more in zip(contends, first, strict=True)]
    best: dict[int, Trial] = {}
    for (score, _), more in zip(starts, last, strict=True):
        # A noise that whitens strongly may prefer what follows the fastest changes alone.
        if not np.isfinite(more.total) or squares(more) >= squares(fitted):
            continue
        if id(score) not in best or more.total < best[id(score)].fitted.total:
            best[id(score)] = trial_of(more, score)
    return list(best.values())


def choose(trials: Sequence[Trial], now: Trial) -> Trial:
    """The best cause, unless a plain column explains clearly more that is no matter of form.

    And the best of plain columns, unless two of them together explain clearly more.
    """
    causes = [trial for trial in trials if not trial.score.entry.generic]
    columns = [trial for trial in trials if trial.score.entry.generic]
    if not columns:
        return min(causes, key=lambda trial: trial.loss)
    column = _plain(columns, now)
    if not causes:
        return column
    cause = min(causes, key=lambda trial: trial.loss)
    whole = now.loss - column.loss
    if not clearly_ahead(cause, column, now):
        return cause
    if column.score.entry.acts_on != "level":
        return column
    kin = [trial for trial in causes if trial.score.entry.family == column.score.entry.family]
    for trial in sorted(kin, key=lambda trial: trial.loss):
        if now.loss - trial.loss > _SAME_CAUSE * whole:
            return trial
    return column


def _plain(columns: Sequence[Trial], now: Trial) -> Trial:
    single = [trial for trial in columns if len(trial.score.entry.covariates) == 1]
    best = min(columns, key=lambda trial: trial.loss)
    if not single:
        return best
    one = min(single, key=lambda trial: trial.loss)
    return best if best is not one and clearly_ahead(one, best, now) else one


def clearly_ahead(plainer: Trial, other: Trial, now: Trial) -> bool:
    """Whether a candidate is better than a plainer one by more than a matter of form."""
    ahead = gain(plainer.fitted, other.fitted)
    least = max(least_gain(other.fitted, _COLUMN_LOSS), _COLUMN_GAIN * (now.loss - other.loss))
    return ahead.total > least and ahead.deviate > _COLUMN_ERRORS


def class_of(trials: Sequence[Trial], chosen: Trial, now: Trial) -> tuple[str, ...]:
    """The names that cannot be told from the chosen one, most likely first."""
    whole = now.loss - chosen.loss
    change = chosen.fitted.adhesion - now.fitted.adhesion
    members: dict[str, None] = {}
    for trial in sorted(trials, key=lambda trial: trial.loss):
        behind = gain(trial.fitted, chosen.fitted)
        kin = trial.score.entry.family == chosen.score.entry.family
        allowed = max((_KIN_GAIN if kin else _CLASS_GAIN) * whole, _CLASS_LEAST)
        if trial.score.entry.generic != chosen.score.entry.generic:
            continue
        other = trial.fitted.adhesion - now.fitted.adhesion
        alike = (change * other).sum() > _ALIKE * np.linalg.norm(change) * np.linalg.norm(other)
        if trial is chosen or (alike and tied(behind) and behind.total <= allowed):
            members[trial.score.entry.name] = None
    name = chosen.score.entry.name
    if name in OF_SIGNALS:
        members.update(dict.fromkeys(OF_SIGNALS))
    return (name, *(member for member in members if member != name))


def is_worth(less: Fitted, more: Fitted, generic: bool = False) -> bool:
    """Whether an effect lowers the loss surely, and by more than a least share of it.

    In a log of one run in time it must do so without any one stretch of it as well: what happened
    once, at one time and place, goes with every column that was different there.
    """
    gained = gain(less, more)
    elsewhere = gained.total - (best_stretch(less, more) if less.log else 0.0)
    sure = gained._replace(total=elsewhere).deviate > (_SURE_OF_COLUMN if generic else _SURE)
    return sure and gained.total > least_gain(less, _LEAST_GAIN)


def tied(behind: Gain) -> bool:
    """Whether it is not decided that a model is behind another."""
    return behind.total <= _CLASS_LEAST or behind.deviate <= _CLASS_ERRORS


def ranked(
    number: int,
    scores: Sequence[Score],
    trials: Sequence[Trial],
    now: Trial | None,
    chosen: Trial | None,
    members: Sequence[str],
    accepted: bool,
) -> list[Candidate]:
    by_score = {id(trial.score): trial for trial in trials}
    rows = []
    for score in scores:
        trial = by_score.get(id(score))
        gained = Gain(np.nan, np.nan)
        if trial is not None and now is not None:
            gained = gain(now.fitted, trial.fitted)
        name = score.entry.name
        if trial is not None and trial is chosen:
            decision = "accepted" if accepted else "does not lower the held-out error"
        elif trial is not None and name in members:
            decision = f"in the class of {members[0]}"
        elif trial is not None:
            decision = "explains less"
        else:
            decision = "not significant" if score.p > SIGNIFICANT else "less telling"
        rows.append(
            Candidate(number, _label(score), score.z, score.p, gained.total, gained.error, decision)
        )
    return rows


def _label(score: Score) -> str:
    kinds: dict[type, str] = {Covariate: "linear", Spline: "spline"}
    said = [kinds.get(type(score.start), ""), score.entry.acts_on]
    more = ", on the ".join(word for word in said if word not in ("", "level"))
    return f"{score.entry.name} ({more})" if more else score.entry.name
