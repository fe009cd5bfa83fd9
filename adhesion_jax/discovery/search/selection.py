"""Forward selection: effects are accepted one at a time, each refitted with all the others."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import scipy

from adhesion_jax.curves import BASES
from adhesion_jax.discovery.model.bases import bic, refits
from adhesion_jax.discovery.model.fitting import has_room, side_by_side
from adhesion_jax.discovery.model.prediction import gain
from adhesion_jax.discovery.model.problem import label_of
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import Entry, column_entries
from adhesion_jax.discovery.search.joint import surfaces
from adhesion_jax.discovery.search.pruning import pruned
from adhesion_jax.discovery.search.refinement import fitted_start, refined
from adhesion_jax.discovery.search.scans import waves
from adhesion_jax.discovery.search.screening import Score, first_scores, screen
from adhesion_jax.discovery.search.state import (
    Accepted,
    Selection,
    parts_of,
    refitted,
    settled,
    slots_of,
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
from adhesion_jax.effects import Covariate, Spline, Threshold, kind_of

#: Columns that say which slip a point has.
_OF_THE_SLIP = ("slip_ratio", "slip_velocity_mps")

#: Columns that an inexact formula of any effect may leave something against.
_ALWAYS_THERE = (*_OF_THE_SLIP, "vehicle_speed_mps", "time_s")


def search(
    first: Selection,
    entries: Sequence[Entry],
    seed: int,
    progress: Callable[[str, float], None],
) -> Selection:
    """The state with the effects that are significant and lower the expected loss on runs left out.

    `entries` are the candidates, and `progress` is called with words and the share of the whole.
    """
    state = first
    chosen_on = first.base
    for number in range(rules.MOST_ROUNDS):
        share = 0.6 * number / rules.MOST_ROUNDS
        progress(f"looking for effect {number + 1}", 0.1 + share)
        scores = _scored(state, _open(entries, state), seed + number)
        needed = scores[0].needed if scores else np.nan
        state = state._replace(thresholds=(*state.thresholds, needed))
        found = _next(state, scores, rules.SIGNIFICANT, number, seed)
        if not _grown(found, state):
            state = state._replace(ranking=found.ranking)
            progress("looking for waves and pairs of columns", 0.15 + share)
            scanned = _scanned(state, scores, seed + number)
            found = _next(state, scanned, rules.SCAN_SIGNIFICANT, number, seed)
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
    return len(parts_of(state.accepted)) > len(parts_of(before.accepted))


def _plainer(
    found: Selection, first: Selection, entries: Sequence[Entry], seed: int
) -> tuple[Selection, str]:
    """The first effect chosen anew on a curve that does not depend on speed, if that is better.

    A curve that falls with speed by itself may have absorbed an effect of speed: then nothing is
    significant, or the effect accepted compensates for an error of the curve, and no later round
    would find both. Returns also the curve on which the effect was chosen.
    """
    plain = {name: fitted for name, fitted in first.fits.items() if not BASES[name].NEEDS}
    if not plain or first.base in plain:
        return found, first.base
    start = first._replace(fits=plain, base=min(plain, key=lambda name: bic(plain[name])))
    scores = first_scores(start.fits, start.base, entries, seed)
    again = _next(start, scores, rules.SIGNIFICANT, 0, seed)
    # Beside noise of the slip an error of the signals will become a doubt, not an effect.
    noisy = first.setting.problem.slip_noise is not None
    if _grown(found, first) and not (noisy and found.accepted[-1].name in OF_SIGNALS):
        better = bic(again.fitted) < bic(found.fitted)
    else:
        # A lower BIC may come from fewer parameters, which are no reason to name an effect.
        ahead = first.fitted.total - again.fitted.total
        better = ahead > rules.LEAST_GAIN_OF_PLAINER and bic(again.fitted) < bic(first.fitted)
    if not better:
        return found, first.base
    fits = {**first.fits, **again.fits}
    whole = settled(fits, again.accepted, again.ranking)
    return whole._replace(thresholds=found.thresholds), start.base


def _reconsidered(
    state: Selection, chosen_on: str, entries: Sequence[Entry], seed: int
) -> Selection:
    """Each effect chosen anew on the base curve that fits best with the effects, if that is better.

    The flexible curve on which an effect was chosen may have absorbed the true cause, so that
    another effect was accepted in its place.
    """
    if state.base == chosen_on:
        return state
    for effect in state.accepted:
        rest = tuple(other for other in state.accepted if other.name != effect.name)
        start = state._replace(fits=refits(state.fits, parts_of(rest)), accepted=rest)
        scores = screen(start.fitted, _open(entries, start), seed)
        again = _next(start, scores, rules.SIGNIFICANT, len(state.thresholds), seed)
        if len(again.accepted) == len(state.accepted) and bic(again.fitted) < bic(state.fitted):
            state = refined(again, seed)
    return state


def _with_other_formulas(state: Selection, entries: Sequence[Entry], seed: int) -> Selection:
    """The classes of refined effects, with the formulas of their family that do as well refined.

    Without the refinement such a formula explained less, and was left out of the class.
    """
    slots = slots_of(state.accepted)
    accepted = []
    for number, effect in enumerate(state.accepted):
        kin = [
            entry
            for entry in _open(entries, state)
            if entry.family == effect.family and not entry.generic
        ]
        if kin and len(effect.parts) > 1 and not effect.generic:
            slot = slots.index((number, 0))
            rest = (*state.fitted.effects[:slot], *state.fitted.effects[slot + 1 :])
            scores = screen(refitted(state, rest), kin, seed)
            fits = side_by_side(partial(refitted, state), [(*rest, one.start) for one in scores])
            trials = zip(scores, fits, strict=True)
            as_good = [one.entry.name for one, less in trials if tied(gain(less, state.fitted))]
            effect = effect._replace(members=tuple(dict.fromkeys((*effect.members, *as_good))))
        accepted.append(effect)
    return state._replace(accepted=tuple(accepted))


def search_columns(state: Selection, columns: Sequence[str], seed: int) -> Selection:
    """The state with one more effect of one or two of the `columns`, if one is accepted.

    The columns are those that boosted trees need to predict the residual; p is adjusted for the
    forms of these columns alone.
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
        found = _next(state, scores, rules.SIGNIFICANT, len(state.thresholds), seed)
        if _grown(found, state):
            return refined(found, seed)
    return state


def _open(entries: Sequence[Entry], state: Selection) -> Sequence[Entry]:
    """The entries that may still be accepted: no effect twice, and no second one of a class."""
    taken = {member for effect in state.accepted for member in (effect.name, *effect.members)}
    taken |= {kind_of(part) for part in parts_of(state.accepted)}
    return [entry for entry in entries if entry.name not in taken]


def _scored(state: Selection, entries: Sequence[Entry], seed: int) -> Sequence[Score]:
    """The scores of the entries; before the first effect also under other kinds of noise."""
    if state.accepted:
        return screen(state.fitted, entries, seed)
    return first_scores(state.fits, state.base, entries, seed)


def _scanned(state: Selection, scores: Sequence[Score], seed: int) -> Sequence[Score]:
    """Waves by their coherence over runs, then pairs of the columns of best score by score tests.

    Waves come first: their z is only the deviate of p, which sign flips bound from below.
    """
    taken = [effect.name for effect in state.accepted]
    lines = [
        Score(entry, entry.starts[0], float(scipy.stats.norm.isf(p)), p, np.nan)
        for entry, p in waves(state.fitted, taken, seed)
        if has_room(state.fitted.effects, entry.starts[0])
    ]
    columns = [label for label in _columns_of(scores) if label not in _OF_THE_SLIP]
    pairs = _open(surfaces(state.setting.problem, columns[: rules.PAIRED_COLUMNS]), state)
    joint = _scored(state, pairs, seed) if pairs else []
    return [*sorted(lines, key=_by_p), *sorted(joint, key=_by_p)]


def _by_p(score: Score) -> tuple[float, float]:
    return score.p, -score.z


def _columns_of(scores: Sequence[Score]) -> Sequence[str]:
    """The columns that the entries rest on, the one of the best score first."""
    labels = (label for score in scores for label in score.entry.covariates)
    return list(dict.fromkeys(labels))


def _joint(chosen: Trial, now: Trial, scores: Sequence[Score], seed: int) -> Trial | None:
    """The best pair of the chosen plain column and another one, if it is clearly ahead of it.

    Otherwise the dependence of the column's effect on the other one would be left to later effects.
    """
    entry, elsewhere = chosen.score.entry, chosen.score.elsewhere
    if not entry.generic or len(entry.covariates) > 1:
        return None
    start = now.fitted if elsewhere is None else elsewhere
    others = _columns_of(scores)[: rules.PARTNER_COLUMNS]
    pairs = surfaces(start.setting.problem, entry.covariates, others)
    trials = tried(start, screen(start, pairs, seed)[: rules.TRIED_PAIRS]) if pairs else []
    if not trials:
        return None
    best = min(trials, key=lambda trial: trial.loss)
    if not clearly_ahead(chosen, best, now):
        return None
    return best._replace(score=best.score._replace(p=chosen.score.p))


def _separated(
    found: Selection, before: Selection, entries: Sequence[Entry], seed: int
) -> Selection:
    """Two effects of a column each in place of the pair just accepted, if they gain as much."""
    if len(found.accepted) == len(before.accepted):
        return found
    pair = found.accepted[-1]
    if not pair.generic or len(pair.covariates) != 2:
        return found
    open_entries = [entry for entry in _open(entries, before) if len(entry.covariates) == 1]
    left = [entry for entry in open_entries if entry.covariates[0] in pair.covariates]
    chain, chosen = [before.fitted], []
    for _ in pair.covariates:
        trials = tried(chain[-1], screen(chain[-1], left, seed)[: rules.TRIED_PAIRS])
        if not trials:
            return found
        now = trial_of(chain[-1], trials[0].score)
        best = choose(trials, now)
        chosen.append((best, class_of(trials, best, now)))
        chain.append(best.fitted)
        left = [entry for entry in left if entry.covariates != best.score.entry.covariates]
    last = chosen[-1][0]
    joint = trial_of(found.fits[before.base], last.score)
    apart = gain(before.fitted, last.fitted).total
    if apart < rules.SEPARATE_SHARE * pair.gain:
        return found
    if clearly_ahead(last, joint, trial_of(before.fitted, last.score)):
        return found
    state = before
    for trial, members in chosen:
        part = _accepted(trial, members, 0.5 * pair.gain)._replace(p=pair.p)
        state = _with_effect(state, trial, part, found.ranking)
    return state


def _next(
    state: Selection, scores: Sequence[Score], significant: float, number: int, seed: int
) -> Selection:
    """The state after one round: with its rows of the ranking, and one more effect if accepted."""
    trials = tried(state.fitted, shortlisted(scores, significant))
    if not trials:
        rows = ranked(number, scores, (), None, None, (), False)
        return state._replace(ranking=(*state.ranking, *rows))
    now = trial_of(state.fitted, scores[0])
    # A candidate that would not be accepted must not displace one that would.
    worthy = [
        trial for trial in trials if is_worth(now.fitted, trial.fitted, trial.score.entry.generic)
    ]
    # Some form of the columns of a worthy candidate must be significant, not that candidate itself:
    # the form of the best score need not be the one that explains most.
    certain = {trial.score.entry.covariates for trial in trials if trial.score.p <= significant}
    sure = any(trial.score.entry.covariates in certain for trial in worthy)
    best = choose(worthy or trials, now)
    joint = _joint(best, now, scores, seed)
    chosen = best if joint is None else joint
    gained = gain(now.fitted, chosen.fitted)
    accepted = sure and is_worth(now.fitted, chosen.fitted, chosen.score.entry.generic)
    members = class_of(trials, chosen, now)
    # A pair was not scored with the others and has no row of its own.
    in_row = best if joint is None else None
    ranking = (*state.ranking, *ranked(number, scores, trials, now, in_row, members, accepted))
    if not accepted:
        return state._replace(ranking=ranking)
    # The p of the effect is that of the test that something was missing.
    new = _accepted(chosen, members, gained.total)
    new = new._replace(p=min(trial.score.p for trial in trials))
    return _with_effect(state, chosen, new, ranking)


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


def _with_effect(
    state: Selection, chosen: Trial, new: Accepted, ranking: Sequence[Candidate]
) -> Selection:
    """The state with the chosen effect, as a refinement of the first one whose form it mends."""
    varying = state.setting.problem.varying
    mended = (
        number
        for number, effect in enumerate(state.accepted)
        if _matter_of_form(new, effect, varying)
    )
    number = next(mended, None)
    accepted = [*state.accepted]
    if number is None:
        accepted.append(new)
    else:
        old = accepted[number]
        accepted[number] = old._replace(parts=(*old.parts, *new.parts))
    fits = {**state.fits, chosen.fitted.base: chosen.fitted}
    return settled(fits, accepted, ranking)._replace(thresholds=state.thresholds)


def _matter_of_form(new: Accepted, old: Accepted, varying: frozenset[str]) -> bool:
    """Whether a new effect only mends the formula of an earlier one.

    So it does if both are functions of the slip alone, if it is a plain column that the earlier one
    rests on, if it is of the same family and gains much less, or if it gains very little and rests
    on no column but those of the earlier one, slip, speed and time.
    """
    own = {*new.covariates}
    if not ((own | {*old.covariates}) & varying) - {*_OF_THE_SLIP}:
        # Two functions of the slip alone are together one.
        return True
    if new.generic and own <= {*old.covariates}:
        return True
    if new.family == old.family:
        return new.gain < rules.REFINING_SHARE_OF_FAMILY * old.gain
    small = new.gain < rules.REFINING_SHARE * old.gain
    return small and own <= {*old.covariates, *_ALWAYS_THERE}
