"""Which effects a law lacks: one is accepted at a time, refitted jointly with all the others."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from scipy import stats

from adhesion_jax.curves import BASES
from adhesion_jax.discovery.model.bases import bic, refits
from adhesion_jax.discovery.model.fitting import (
    gain,
    has_room,
    side_by_side,
)
from adhesion_jax.discovery.model.problem import label_of
from adhesion_jax.discovery.search.catalogue import Entry, column_entries
from adhesion_jax.discovery.search.joint import surfaces
from adhesion_jax.discovery.search.pruning import pruned
from adhesion_jax.discovery.search.refinement import fitted_start, refined
from adhesion_jax.discovery.search.scans import SCAN_SIGNIFICANT, waves
from adhesion_jax.discovery.search.screening import SIGNIFICANT, Score, screen, seen
from adhesion_jax.discovery.search.state import (
    Accepted,
    Selection,
    parts_of,
    refitted,
    settled,
)
from adhesion_jax.discovery.search.trials import (
    OF_SIGNALS,
    Trial,
    choose,
    class_of,
    clearly_ahead,
    is_worth,
    ranked,
    shortlisted,
    tied,
    trial_of,
    tried,
)
from adhesion_jax.discovery.types import Candidate
from adhesion_jax.effects import (
    Covariate,
    Spline,
    Threshold,
    kind_of,
)

_ROUNDS = 6

#: So many columns are looked at in pairs, and so many beside a column that was chosen, of which the
#: most telling pairs are tried.
_PAIRED, _BESIDE, _WIDER = 12, 20, 3

#: A plain curve with an effect must be this much more likely than one that falls by itself.
_PLAINER = 2.0

#: Two columns apart do as well as together if they gain this share of it.
_DOES_AS_WELL = 0.75

#: A second effect of a family that gains less than this share of the first refines its form.
_MATTER_OF_FORM = 0.25

#: So does one of any family below this share, if it rests on no column of its own.
_SMALL_MATTER = 0.05
_OF_THE_SLIP = ("slip_ratio", "slip_velocity_mps")
_ALWAYS_THERE = ("slip_ratio", "slip_velocity_mps", "vehicle_speed_mps", "time_s")


def search(
    first: Selection,
    entries: Sequence[Entry],
    seed: int,
    progress: Callable[[str, float], None],
) -> Selection:
    """Accepts effects until none is left that is significant and lowers the held-out loss."""
    state = first
    chosen_on = first.base
    for number in range(_ROUNDS):
        progress(f"looking for effect {number + 1}", 0.1 + 0.6 * number / _ROUNDS)
        scores = _looked(state, _open(entries, state), seed + number)
        needed = scores[0].needed if scores else np.nan
        state = state._replace(thresholds=(*state.thresholds, needed))
        found = _next(state, scores, SIGNIFICANT, number, seed)
        if not _grown(found, state):
            state = state._replace(ranking=found.ranking)
            progress("looking for waves and pairs of columns", 0.15 + 0.6 * number / _ROUNDS)
            scanned = _scanned(state, scores, seed + number)
            found = _next(state, scanned, SCAN_SIGNIFICANT, number, seed)
        if _grown(found, state):
            found = _separated(found, state, entries, seed)
        if not first.accepted and number == 0:
            found, chosen_on = _plainer(found, first, entries, seed)
        if not _grown(found, state):
            state = found
            break
        found = refined(found, seed)
        state = pruned(found)
        if len(state.accepted) < len(found.accepted):
            break
    return _with_other_formulas(_reconsidered(state, chosen_on, entries, seed), entries, seed)


def _grown(state: Selection, before: Selection) -> bool:
    """Whether an effect or a part of one was accepted."""
    return state.accepted is not before.accepted


def _plainer(
    found: Selection, first: Selection, entries: Sequence[Entry], seed: int
) -> tuple[Selection, str]:
    """The first effect chosen anew on a curve that speed does not change, if that is better.

    A curve that itself falls with speed may have absorbed the cause: nothing stands out then, or
    what was accepted makes up for what is wrong with the curve, and no later round would find both.
    Also on which curve the effect was chosen.
    """
    plain = {name: fitted for name, fitted in first.fits.items() if not BASES[name].NEEDS}
    if not plain or first.base in plain:
        return found, first.base
    start = first._replace(fits=plain, base=min(plain, key=lambda name: bic(plain[name])))
    again = _next(start, seen(start.fits, start.base, entries, seed), SIGNIFICANT, 0, seed)
    # An error of the signals beside noise of the slip will be no more than a doubt.
    noisy = first.setting.problem.slip_noise is not None
    if _grown(found, first) and not (noisy and found.accepted[-1].name in OF_SIGNALS):
        better = bic(again.fitted) < bic(found.fitted)
    else:
        # Fewer parameters alone are no reason to name an effect where there was none.
        ahead = first.fitted.total - again.fitted.total
        better = ahead > _PLAINER and bic(again.fitted) < bic(first.fitted)
    if not better:
        return found, first.base
    fits = {**first.fits, **again.fits}
    whole = settled(fits, again.accepted, again.ranking)
    return whole._replace(thresholds=found.thresholds), start.base


def _reconsidered(
    state: Selection, chosen_on: str, entries: Sequence[Entry], seed: int
) -> Selection:
    """Each effect chosen anew on the base that the effects have led to, kept where it is better.

    A flexible base may have absorbed a cause and left another effect to make up for it.
    """
    if state.base == chosen_on:
        return state
    for effect in state.accepted:
        rest = tuple(other for other in state.accepted if other.name != effect.name)
        start = state._replace(fits=refits(state.fits, parts_of(rest)), accepted=rest)
        scores = screen(start.fitted, _open(entries, start), seed)
        again = _next(start, scores, SIGNIFICANT, len(state.thresholds), seed)
        if len(again.accepted) == len(state.accepted) and bic(again.fitted) < bic(state.fitted):
            state = refined(again, seed)
    return state


def _with_other_formulas(state: Selection, entries: Sequence[Entry], seed: int) -> Selection:
    """Formulas of a family that only with the refinement of its effect do as well, in its class."""
    accepted = []
    for effect in state.accepted:
        kin = [
            entry
            for entry in _open(entries, state)
            if entry.family == effect.family and not entry.generic
        ]
        if kin and len(effect.parts) > 1 and not effect.generic:
            rest = [part for part in state.fitted.effects if part is not effect.parts[0]]
            scores = screen(refitted(state, rest), kin, seed)
            fits = side_by_side(partial(refitted, state), [(*rest, one.start) for one in scores])
            trials = zip(scores, fits, strict=True)
            as_good = [one.entry.name for one, less in trials if tied(gain(less, state.fitted))]
            effect = effect._replace(members=tuple(dict.fromkeys((*effect.members, *as_good))))
        accepted.append(effect)
    return state._replace(accepted=tuple(accepted))


def look_again(state: Selection, columns: Sequence[str], seed: int) -> Selection:
    """One more effect of some columns, in any form of one or two of them, where one is accepted.

    The columns are those that a general method needs to predict the residual: p is adjusted for
    the forms of these columns alone.
    """
    problem = state.setting.problem
    places = [name for name in problem.columns if label_of(name, problem.measured) in columns]
    entries = [
        entry
        for kind in (Covariate, Spline, Threshold)
        for column in places
        for entry in column_entries(kind, column, problem)
    ]
    for some in (entries, surfaces(problem, columns)):
        scores = screen(state.fitted, some, seed)
        found = _next(state, scores, SIGNIFICANT, len(state.thresholds), seed)
        if _grown(found, state):
            return refined(found, seed)
    return state


def _open(entries: Sequence[Entry], state: Selection) -> Sequence[Entry]:
    """What may still be accepted: no member of a class twice."""
    taken = {member for effect in state.accepted for member in (effect.name, *effect.members)}
    taken |= {kind_of(part) for part in parts_of(state.accepted)}
    return [entry for entry in entries if entry.name not in taken]


def _looked(state: Selection, entries: Sequence[Entry], seed: int) -> Sequence[Score]:
    """The scores of entries; before anything is known, in every kind of noise."""
    if state.accepted:
        return screen(state.fitted, entries, seed)
    return seen(state.fits, state.base, entries, seed)


def _scanned(state: Selection, scores: Sequence[Score], seed: int) -> Sequence[Score]:
    """Waves by their coherence over runs, then pairs of the most telling columns by score tests.

    Waves come first: how sure they are is told by p alone, and pairs are many.
    """
    taken = [effect.name for effect in state.accepted]
    lines = [
        Score(entry, entry.starts[0], float(stats.norm.isf(p)), p, np.nan, state.fitted)
        for entry, p in waves(state.fitted, taken, seed)
        if has_room(state.fitted.effects, entry.starts[0])
    ]
    telling = [label for label in _most_telling(scores) if label not in _OF_THE_SLIP]
    pairs = _open(surfaces(state.setting.problem, telling[:_PAIRED]), state)
    joint = _looked(state, pairs, seed) if pairs else []
    return [*sorted(lines, key=_by_p), *sorted(joint, key=_by_p)]


def _by_p(score: Score) -> tuple[float, float]:
    return score.p, -score.z


def _most_telling(scores: Sequence[Score]) -> Sequence[str]:
    """Columns by the best score of what rests on them."""
    labels = (label for score in scores for label in score.entry.covariates)
    return list(dict.fromkeys(labels))


def _wider(chosen: Trial, now: Trial, scores: Sequence[Score], seed: int) -> Trial:
    """The chosen column together with another one, where that explains clearly more.

    What of a column depends on another one is else left to be explained by effects that are none.
    """
    entry, start = chosen.score.entry, chosen.score.seen_in
    problem = start.setting.problem
    if not entry.generic or len(entry.covariates) > 1:
        return chosen
    pairs = surfaces(problem, entry.covariates, _most_telling(scores)[:_BESIDE])
    trials = tried(start, screen(start, pairs, seed)[:_WIDER]) if pairs else []
    if not trials:
        return chosen
    best = min(trials, key=lambda trial: trial.loss)
    if not clearly_ahead(chosen, best, now):
        return chosen
    return best._replace(score=best.score._replace(p=chosen.score.p))


def _separated(
    found: Selection, before: Selection, entries: Sequence[Entry], seed: int
) -> Selection:
    """Two effects of a column each in place of a joint one, where they do as well."""
    if not _grown(found, before) or len(found.accepted) == len(before.accepted):
        return found
    pair = found.accepted[-1]
    if not pair.generic or len(pair.covariates) != 2:
        return found
    open_entries = [entry for entry in _open(entries, before) if len(entry.covariates) == 1]
    left = [entry for entry in open_entries if entry.covariates[0] in pair.covariates]
    chain, chosen = [before.fitted], []
    for _ in pair.covariates:
        trials = tried(chain[-1], screen(chain[-1], left, seed)[:_WIDER])
        if not trials:
            return found
        now = trial_of(chain[-1], trials[0].score)
        best = choose(trials, now)
        chosen.append((best, class_of(trials, best, now)))
        chain.append(best.fitted)
        left = [entry for entry in left if entry.covariates != best.score.entry.covariates]
    last = chosen[-1][0]
    joint = trial_of(found.fits[before.base], last.score)
    if (
        gain(before.fitted, last.fitted).total < _DOES_AS_WELL * pair.gain
        or clearly_ahead(last, joint, trial_of(before.fitted, last.score))
    ):  # fmt: skip
        return found
    state = before
    for trial, members in chosen:
        part = _accepted(trial, members, 0.5 * pair.gain)._replace(p=pair.p)
        state = _joined(state, trial, part, found.ranking)
    return state


def _next(
    state: Selection, scores: Sequence[Score], significant: float, number: int, seed: int
) -> Selection:
    """The state with its ranking, and with one more effect where one is accepted."""
    trials = tried(state.fitted, shortlisted(scores, significant))
    if not trials:
        rows = ranked(number, scores, (), None, None, (), False)
        return state._replace(ranking=(*state.ranking, *rows))
    now = trial_of(state.fitted, scores[0])
    # What would not be accepted cannot stand in the way of what would.
    worthy = [
        trial for trial in trials if is_worth(now.fitted, trial.fitted, trial.score.entry.generic)
    ]
    # That there is something must be sure of the columns of one of them, in whatever form; the one
    # that explains it best may be another.
    telling = {trial.score.entry.covariates for trial in trials if trial.score.p <= significant}
    sure = any(trial.score.entry.covariates in telling for trial in worthy)
    chosen = _wider(choose(worthy or trials, now), now, scores, seed)
    gained = gain(now.fitted, chosen.fitted)
    generic = chosen.score.entry.generic
    accepted = sure and is_worth(now.fitted, chosen.fitted, generic)
    members = class_of(trials, chosen, now)
    ranking = (*state.ranking, *ranked(number, scores, trials, now, chosen, members, accepted))
    if not accepted:
        return state._replace(ranking=ranking)
    new = _accepted(chosen, members, gained.total)
    # What was sure is that something was left.
    new = new._replace(p=min(trial.score.p for trial in trials))
    return _joined(state, chosen, new, ranking)


def _accepted(chosen: Trial, members: tuple[str, ...], gained: float) -> Accepted:
    entry = chosen.score.entry
    return Accepted(
        entry.name,
        members,
        entry.family,
        entry.generic,
        entry.covariates,
        (fitted_start(chosen),),
        chosen.score.p,
        gained,
    )


def _joined(
    state: Selection, chosen: Trial, new: Accepted, ranking: Sequence[Candidate]
) -> Selection:
    """The chosen effect as one of its own, or as a refinement of one of its family."""
    varying = state.setting.problem.varying
    old = (effect for effect in state.accepted if _matter_of_form(new, effect, varying))
    kin = next(old, None)
    if kin is not None:
        whole = kin._replace(parts=(*kin.parts, *new.parts))
        accepted = tuple(whole if effect is kin else effect for effect in state.accepted)
    else:
        accepted = (*state.accepted, new)
    fits = {**state.fits, chosen.fitted.base: chosen.fitted}
    return settled(fits, accepted, ranking)._replace(thresholds=state.thresholds)


def _matter_of_form(new: Accepted, old: Accepted, varying: frozenset[str]) -> bool:
    """Whether what is new only mends the formula of what was accepted before.

    A plain column of the same effect does, one of its family that gains much less does, and so does
    a small gain by anything that rests on nothing but its columns, slip, speed and time: that is
    what a formula leaves that is a little wrong.
    """
    own = {*new.covariates}
    if not ((own | {*old.covariates}) & varying) - {*_OF_THE_SLIP}:
        # Both are functions of the slip alone: together they are one.
        return True
    if new.generic and own <= {*old.covariates}:
        return True
    if new.family == old.family:
        return new.gain < _MATTER_OF_FORM * old.gain
    return own <= {*old.covariates, *_ALWAYS_THERE} and new.gain < _SMALL_MATTER * old.gain
