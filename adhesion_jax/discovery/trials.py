"""What is tried in one round: the most telling causes refitted jointly, and the choice of one."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from adhesion_jax.discovery.effects import Covariate, Spline
from adhesion_jax.discovery.findings import Candidate
from adhesion_jax.discovery.fitting import (
    Fitted,
    Gain,
    Setting,
    expected_loss,
    fit_models,
    gain,
    squares,
)
from adhesion_jax.discovery.screening import SIGNIFICANT, Score
from adhesion_jax.discovery.state import Selection, with_noise

#: How many causes and how many plain columns are refitted in each round.
_CAUSES, _COLUMNS = 6, 3

#: A plain column is preferred to a cause only by so many standard errors, this share of the loss
#: and this share of the gain.
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

#: For Burckhardt's curve no data separate these two, for the others hardly any.
_THE_SAME = ("slip_bias", "torque_offset")


class Trial(NamedTuple):
    score: Score
    fitted: Fitted
    loss: float  # expected, over all runs


def shortlisted(scores: Sequence[Score], significant: float) -> Sequence[Score]:
    """The most telling causes and columns, where the best of all is significant."""
    if not scores or scores[0].p > significant:
        return []
    causes = [score for score in scores if not score.entry.generic][:_CAUSES]
    columns = [score for score in scores if score.entry.generic][:_COLUMNS]
    return [score for score in (*causes, *columns) if score.p <= 10 * significant]


def tried(state: Selection, shortlist: Sequence[Score]) -> tuple[Setting, Trial, Sequence[Trial]]:
    """Joint refits under the noise that the best of them leaves, and the model as it is."""
    base, values = state.base, state.fitted.base_values.tolist()
    effects = state.fitted.effects

    starts = fit_models(state.setting, [(base, values, (*effects, one.start)) for one in shortlist])
    first = [
        (start, score)
        for start, score in zip(starts, shortlist, strict=True)
        if np.isfinite(start.total)
    ]
    best = min((start for start, _ in first), key=lambda fitted: fitted.total)
    setting = with_noise(state.setting, best)
    again = [(base, start.base_values.tolist(), start.effects) for start, _ in first]
    now, *refitted = fit_models(setting, [(base, values, effects), *again])
    trials = [
        Trial(score, fitted, float(expected_loss(fitted).sum()))
        for fitted, (_, score) in zip(refitted, first, strict=True)
    ]
    # Whitening may prefer what follows the fastest changes and misses all the others.
    sane = [trial for trial in trials if squares(setting, trial.fitted) < squares(setting, now)]
    return setting, Trial(shortlist[0], now, float(expected_loss(now).sum())), sane


def choose(trials: Sequence[Trial], now: Trial) -> Trial:
    """The best cause, unless a plain column explains clearly more that is no matter of form."""
    causes = [trial for trial in trials if not trial.score.entry.generic]
    columns = [trial for trial in trials if trial.score.entry.generic]
    best = min(trials, key=lambda trial: trial.loss)
    if not causes or not columns:
        return best
    cause = min(causes, key=lambda trial: trial.loss)
    column = min(columns, key=lambda trial: trial.loss)
    ahead = gain(cause.fitted, column.fitted)
    whole = now.loss - column.loss
    clearly = ahead.total > max(
        _COLUMN_ERRORS * ahead.error, _COLUMN_LOSS * cause.loss, _COLUMN_GAIN * whole
    )
    if not clearly:
        return cause
    kin = [trial for trial in causes if trial.score.entry.family == column.score.entry.family]
    for trial in sorted(kin, key=lambda trial: trial.loss):
        if now.loss - trial.loss > _SAME_CAUSE * whole:
            return trial
    return column


def class_of(trials: Sequence[Trial], chosen: Trial, now: Trial) -> tuple[str, ...]:
    """The names that cannot be told from the chosen one, most likely first."""
    whole = now.loss - chosen.loss
    change = chosen.fitted.residual - now.fitted.residual
    members: dict[str, None] = {}
    for trial in sorted(trials, key=lambda trial: trial.loss):
        behind = gain(trial.fitted, chosen.fitted)
        kin = trial.score.entry.family == chosen.score.entry.family
        allowed = max((_KIN_GAIN if kin else _CLASS_GAIN) * whole, _CLASS_LEAST)
        if trial.score.entry.generic != chosen.score.entry.generic:
            continue
        other = trial.fitted.residual - now.fitted.residual
        alike = (change * other).sum() > _ALIKE * np.linalg.norm(change) * np.linalg.norm(other)
        if trial is chosen or (alike and tied(behind) and behind.total <= allowed):
            members[trial.score.entry.name] = None
    name = chosen.score.entry.name
    if name in _THE_SAME:
        members.update(dict.fromkeys(_THE_SAME))
    return (name, *(member for member in members if member != name))


def tied(behind: Gain) -> bool:
    """Whether it is not decided that a model is behind another."""
    return behind.total <= max(_CLASS_ERRORS * behind.error, _CLASS_LEAST)


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
        rows.append(Candidate(number, _label(score), score.z, score.p, *gained, decision))
    return rows


def _label(score: Score) -> str:
    kinds = {Covariate: " (linear)", Spline: " (spline)"}
    return score.entry.name + kinds.get(type(score.start), "")
