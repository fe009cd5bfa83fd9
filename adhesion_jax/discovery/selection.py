"""Which effects a law lacks: one is accepted at a time, refitted jointly with all the others."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats

from adhesion_jax.discovery.bases import bic, first_fits, refits
from adhesion_jax.discovery.effects import Covariate, Effect, Spline
from adhesion_jax.discovery.findings import Candidate
from adhesion_jax.discovery.fitting import Fitted, Setting, fit_model, held_out_loss
from adhesion_jax.discovery.library import Entry
from adhesion_jax.discovery.noise import estimate_noise
from adhesion_jax.discovery.scans import SCAN_SIGNIFICANT, products, waves
from adhesion_jax.discovery.screening import SIGNIFICANT, Score, screen

#: An effect is accepted at this share of the loss, one standard error over it.
_LEAST_GAIN = 0.003

#: How many causes and how many plain columns are refitted in each round.
_CAUSES, _COLUMNS = 6, 3

_ROUNDS = 6

#: A plain column is preferred to a cause only by so many standard errors, this share of the loss
#: and this share of the gain.
_COLUMN_ERRORS, _COLUMN_LOSS, _COLUMN_GAIN = 2.0, 0.01, 0.15

#: A cause that explains this share of what a plain column on it does, has the wrong form only.
_SAME_CAUSE = 0.5

#: By so many standard deviations the best cause must stand out more when noise is taken for white.
_CLEARER = 2.0

#: Causes within so many standard errors and this share of the gain are one class.
_CLASS_ERRORS, _CLASS_GAIN = 2.0, 0.10

#: A likelihood ratio below exp(2) decides nothing, however small the gain.
_CLASS_LEAST = 2.0

#: A second effect of a family that gains less than this share of the first refines its form.
_MATTER_OF_FORM = 0.25

#: So does one of any family below this share, if it rests on no column of its own.
_SMALL_MATTER = 0.05
_ALWAYS_THERE = ("slip_ratio", "slip_velocity_mps", "vehicle_speed_mps", "time_s")


#: Families whose effects noise in the slip looks like.
_FEIGNED = ("in time", "offset")


class Accepted(NamedTuple):
    """An effect of the model: what it is called, and what it consists of."""

    name: str
    members: tuple[str, ...]  # of its class, itself first
    family: str
    generic: bool
    covariates: tuple[str, ...]
    parts: tuple[Effect, ...]  # the effect, then what refines its form
    p: float
    gain: float  # of the cross-validated log likelihood, over all runs
    losses: np.ndarray  # held-out loss of each run with it and those before it


class Selection(NamedTuple):
    """Where the search has come to."""

    setting: Setting
    fits: Mapping[str, Fitted]  # every base curve with the effects accepted
    base: str
    accepted: tuple[Accepted, ...]
    ranking: tuple[Candidate, ...]
    thresholds: tuple[float, ...] = ()  # by round, the z needed for acceptance

    @property
    def fitted(self) -> Fitted:
        return self.fits[self.base]


class _Trial(NamedTuple):
    score: Score
    fitted: Fitted
    losses: np.ndarray  # [runs], held out


def parts_of(accepted: Sequence[Accepted]) -> tuple[Effect, ...]:
    """All effects of a model."""
    return tuple(part for effect in accepted for part in effect.parts)


def search(
    setting: Setting,
    fits: Mapping[str, Fitted],
    entries: Sequence[Entry],
    seed: int,
    progress: Callable[[str, float], None],
) -> Selection:
    """Accepts effects until none is left that is significant and lowers the held-out loss."""
    state = settled(setting, fits, (), ())
    pairs = products(setting.problem)
    for number in range(_ROUNDS):
        progress(f"looking for effect {number + 1}", 0.1 + 0.6 * number / _ROUNDS)
        open_entries = _open(entries, state)
        scores: Sequence[Score] = screen(state.setting, state.fitted, open_entries, seed + number)
        needed = scores[0].needed if scores else np.nan
        state = state._replace(thresholds=(*state.thresholds, needed))
        chosen, significant = state, SIGNIFICANT
        if number == 0:
            # Two looks at the same data: each must be twice as sure.
            significant = SIGNIFICANT / 2
            white, others = _uncoloured(state, open_entries, seed)
            if others and others[0].z > scores[0].z + _CLEARER:
                chosen, scores = white, others
        found = _next(chosen, scores, significant, number)
        if not _grown(found, state):
            state = state._replace(ranking=found.ranking)
            progress("looking for waves and pairs of columns", 0.15 + 0.6 * number / _ROUNDS)
            scanned = _scanned(state, pairs, seed + number)
            found = _next(state, scanned, SCAN_SIGNIFICANT, number)
        if not _grown(found, state):
            return found
        state = _pruned(found)
        if len(state.accepted) < len(found.accepted):
            break
    return state


def _grown(state: Selection, before: Selection) -> bool:
    return len(parts_of(state.accepted)) > len(parts_of(before.accepted))


def _uncoloured(
    state: Selection, entries: Sequence[Entry], seed: int
) -> tuple[Selection, Sequence[Score]]:
    """The state and its scores as if the noise of neighbours were independent.

    What is missing may itself be what correlates them. A curve fitted to fast changes alone then
    hides the cause: one that follows the slip late fits a curve without a rise.
    """
    noise = state.setting.noise._replace(autocorrelation=np.array(0.0))
    setting = Setting(state.setting.problem, noise, state.setting.level)
    fits = first_fits(setting, tuple(state.fits))
    base = min(fits, key=lambda name: bic(fits[name]))
    white = state._replace(setting=setting, fits=fits, base=base)
    return white, screen(setting, white.fitted, entries, seed)


def _open(entries: Sequence[Entry], state: Selection) -> Sequence[Entry]:
    """What may still be accepted: no member of a class twice, nothing that slip noise feigns."""
    taken = {member for effect in state.accepted for member in (effect.name, *effect.members)}
    noisy = "slip_noise" in taken
    return [
        entry
        for entry in entries
        if entry.name not in taken and not (noisy and entry.family in _FEIGNED)
    ]


def _scanned(state: Selection, pairs: Sequence[Entry], seed: int) -> Sequence[Score]:
    """Pairs of columns by score tests, waves by their coherence over runs."""
    open_pairs = _open(pairs, state)
    scores = list(screen(state.setting, state.fitted, open_pairs, seed)) if open_pairs else []
    taken = [effect.name for effect in state.accepted]
    scores += [
        Score(entry, entry.starts[0], float(stats.norm.isf(p)), p, np.nan)
        for entry, p in waves(state.setting, state.fitted, taken, seed)
    ]
    return sorted(scores, key=lambda score: (score.p, -score.z))


def settled(
    setting: Setting,
    fits: Mapping[str, Fitted],
    accepted: Sequence[Accepted],
    ranking: Sequence[Candidate],
) -> Selection:
    """Base curve and noise chosen anew for the effects there are."""
    effects = parts_of(accepted)
    fits = refits(setting, fits, effects)
    base = min(fits, key=lambda name: bic(fits[name]))
    fitted = fits[base]
    setting = _with_noise(setting, fitted)
    fits = refits(setting, fits, fitted.effects)
    base = min(fits, key=lambda name: bic(fits[name]))
    parts = _refreshed(accepted, fits[base].effects)
    return Selection(setting, fits, base, parts, tuple(ranking))


def without(state: Selection, rest: Sequence[Accepted]) -> Selection:
    """The state with only some of its effects."""
    less = settled(state.setting, state.fits, rest, state.ranking)
    return less._replace(thresholds=state.thresholds)


def _with_noise(setting: Setting, fitted: Fitted) -> Setting:
    residual = np.asarray(setting.problem.data.adhesion) - fitted.adhesion
    weight = np.asarray(setting.noise.weight)
    noise = estimate_noise(weight, residual, fitted.adhesion)
    return Setting(setting.problem, noise, fitted.adhesion)


def _refreshed(accepted: Sequence[Accepted], effects: Sequence[Effect]) -> tuple[Accepted, ...]:
    """The parts with the parameters of a fit, whose effects are in another order."""
    old = parts_of(accepted)
    order = sorted(range(len(old)), key=lambda place: old[place].ORDER)
    new = dict(zip(order, effects, strict=True))
    found, place = [], 0
    for effect in accepted:
        count = len(effect.parts)
        found.append(effect._replace(parts=tuple(new[at] for at in range(place, place + count))))
        place += count
    return tuple(found)


def _next(state: Selection, scores: Sequence[Score], significant: float, number: int) -> Selection:
    """The state with its ranking, and with one more effect where one is accepted."""
    shortlist = _shortlist(scores, significant)
    if not shortlist:
        rows = _ranked(number, scores, (), None, None, (), False)
        return state._replace(ranking=(*state.ranking, *rows))
    setting, now, trials = _trials(state, shortlist)
    chosen = _choose(trials, now)
    gains = now.losses - chosen.losses
    total, error = float(gains.sum()), _standard_error(gains)
    accepted = (
        chosen.score.p <= significant
        and total > error
        and total > _LEAST_GAIN * float(now.losses.sum())
    )
    members = _class(trials, chosen, total)
    ranking = (*state.ranking, *_ranked(number, scores, trials, now, chosen, members, accepted))
    if not accepted:
        return state._replace(ranking=ranking)
    entry = chosen.score.entry
    new = Accepted(
        entry.name,
        members,
        entry.family,
        entry.generic,
        entry.covariates,
        (chosen.score.start,),
        chosen.score.p,
        total,
        chosen.losses,
    )
    return _joined(state, setting, chosen, new, ranking)


def _joined(
    state: Selection,
    setting: Setting,
    chosen: _Trial,
    new: Accepted,
    ranking: Sequence[Candidate],
) -> Selection:
    """The chosen effect as one of its own, or as a refinement of one of its family."""
    kin = next((effect for effect in state.accepted if _matter_of_form(new, effect)), None)
    if kin is not None:
        whole = kin._replace(parts=(*kin.parts, *new.parts))
        accepted = tuple(whole if effect is kin else effect for effect in state.accepted)
    else:
        accepted = (*state.accepted, new)
    fits = {**state.fits, state.base: chosen.fitted}
    start = _started(accepted, chosen)
    return settled(setting, fits, start, ranking)._replace(thresholds=state.thresholds)


def _matter_of_form(new: Accepted, old: Accepted) -> bool:
    """Whether what is new only mends the formula of what was accepted before.

    A plain column of the same effect does, one of its family that gains much less does, and so does
    a small gain by anything that rests on nothing but its columns, slip, speed and time: that is
    what a formula leaves that is a little wrong.
    """
    own = {*new.covariates}
    if new.generic and own <= {*old.covariates}:
        return True
    if new.family == old.family:
        return new.gain < _MATTER_OF_FORM * old.gain
    return own <= {*old.covariates, *_ALWAYS_THERE} and new.gain < _SMALL_MATTER * old.gain


def _started(accepted: Sequence[Accepted], chosen: _Trial) -> tuple[Accepted, ...]:
    """The new part where the trial left it."""
    fitted = next(
        effect
        for effect in chosen.fitted.effects
        if type(effect) is type(chosen.score.start) and _names(effect) == _names(chosen.score.start)
    )
    return tuple(
        effect._replace(
            parts=tuple(fitted if part is chosen.score.start else part for part in effect.parts)
        )
        for effect in accepted
    )


def _names(effect: Effect) -> tuple[str, ...]:
    return tuple(
        value
        for value in (
            getattr(effect, "column", ""),
            getattr(effect, "first", ""),
            getattr(effect, "second", ""),
        )
        if value
    )


def _shortlist(scores: Sequence[Score], significant: float) -> Sequence[Score]:
    """The most telling causes and columns, where the best of all is significant."""
    if not scores or scores[0].p > significant:
        return []
    causes = [score for score in scores if not score.entry.generic][:_CAUSES]
    columns = [score for score in scores if score.entry.generic][:_COLUMNS]
    return [score for score in (*causes, *columns) if score.p <= 10 * significant]


def _trials(
    state: Selection, shortlist: Sequence[Score]
) -> tuple[Setting, _Trial, Sequence[_Trial]]:
    """Joint refits under the noise that the best of them leaves, and the model as it is."""
    base, values = state.base, state.fitted.base_values.tolist()
    effects = state.fitted.effects

    def refit(setting: Setting, start: Fitted | None, score: Score) -> Fitted:
        if start is None:
            return fit_model(setting, base, values, (*effects, score.start))
        return fit_model(setting, base, start.base_values.tolist(), start.effects)

    first = [refit(state.setting, None, score) for score in shortlist]
    best = min(first, key=lambda fitted: fitted.total)
    setting = _with_noise(state.setting, best)
    trials = []
    for score, start in zip(shortlist, first, strict=True):
        fitted = refit(setting, start, score)
        trials.append(_Trial(score, fitted, held_out_loss(fitted)))
    now = fit_model(setting, base, values, effects)
    return setting, _Trial(shortlist[0], now, held_out_loss(now)), trials


def _choose(trials: Sequence[_Trial], now: _Trial) -> _Trial:
    """The best cause, unless a plain column explains clearly more that is no matter of form."""
    causes = [trial for trial in trials if not trial.score.entry.generic]
    columns = [trial for trial in trials if trial.score.entry.generic]
    best = min(trials, key=lambda trial: trial.losses.sum())
    if not causes or not columns:
        return best
    cause = min(causes, key=lambda trial: trial.losses.sum())
    column = min(columns, key=lambda trial: trial.losses.sum())
    ahead = cause.losses - column.losses
    gain = float((now.losses - column.losses).sum())
    clearly = (
        ahead.sum() > _COLUMN_ERRORS * _standard_error(ahead)
        and ahead.sum() > _COLUMN_LOSS * cause.losses.sum()
        and ahead.sum() > _COLUMN_GAIN * gain
    )
    if not clearly:
        return cause
    kin = [trial for trial in causes if trial.score.entry.family == column.score.entry.family]
    for trial in sorted(kin, key=lambda trial: trial.losses.sum()):
        if (now.losses - trial.losses).sum() > _SAME_CAUSE * gain:
            return trial
    return column


def _class(trials: Sequence[_Trial], chosen: _Trial, gain: float) -> tuple[str, ...]:
    """The names that cannot be told from the chosen one, most likely first."""
    members: dict[str, None] = {}
    for trial in sorted(trials, key=lambda trial: trial.losses.sum()):
        behind = trial.losses - chosen.losses
        close = behind.sum() <= _CLASS_ERRORS * _standard_error(behind) + 1e-9
        allowed = max(_CLASS_GAIN * gain, _CLASS_LEAST)
        if trial.score.entry.generic != chosen.score.entry.generic:
            continue
        if trial is chosen or (close and behind.sum() <= allowed):
            members[trial.score.entry.name] = None
    name = chosen.score.entry.name
    return (name, *(member for member in members if member != name))


def _standard_error(gains: np.ndarray) -> float:
    """Of a sum over runs that differ."""
    used = gains[gains != 0]
    return float(np.sqrt(used.size) * np.std(used, ddof=1)) if used.size > 1 else np.inf


def _ranked(
    number: int,
    scores: Sequence[Score],
    trials: Sequence[_Trial],
    now: _Trial | None,
    chosen: _Trial | None,
    members: Sequence[str],
    accepted: bool,
) -> list[Candidate]:
    tried = {id(trial.score): trial for trial in trials}
    rows = []
    for score in scores:
        trial = tried.get(id(score))
        gain = error = np.nan
        if trial is not None and now is not None:
            gains = now.losses - trial.losses
            gain, error = float(gains.sum()), _standard_error(gains)
        name = score.entry.name
        if trial is not None and trial is chosen:
            decision = "accepted" if accepted else "does not lower the held-out error"
        elif trial is not None and name in members:
            decision = f"in the class of {members[0]}"
        elif trial is not None:
            decision = "explains less"
        else:
            decision = "not significant" if score.p > SIGNIFICANT else "less telling"
        rows.append(Candidate(number, _label(score), score.z, score.p, gain, error, decision))
    return rows


def _label(score: Score) -> str:
    kinds = {Covariate: " (linear)", Spline: " (spline)"}
    return score.entry.name + kinds.get(type(score.start), "")


def _pruned(state: Selection) -> Selection:
    """Backward elimination: an effect that the later ones have made needless goes."""
    while len(state.accepted) > 1:
        whole = held_out_loss(state.fitted)
        for effect in state.accepted[:-1]:
            rest = tuple(other for other in state.accepted if other is not effect)
            values = state.fitted.base_values.tolist()
            less = fit_model(state.setting, state.base, values, parts_of(rest))
            gains = held_out_loss(less) - whole
            needed = (
                gains.sum() > _standard_error(gains) and gains.sum() > _LEAST_GAIN * whole.sum()
            )
            if not needed:
                state = without(state, rest)
                break
        else:
            return state
    return state
