"""Which effects a law lacks: one is accepted at a time, refitted jointly with all the others."""

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
from scipy import stats

from adhesion_jax.discovery.bases import bic, first_fits, refits
from adhesion_jax.discovery.effects import EFFECTS, Effect
from adhesion_jax.discovery.findings import Candidate
from adhesion_jax.discovery.fitting import (
    Fitted,
    Gain,
    Setting,
    expected_loss,
    fit_model,
    fit_models,
    gain,
    squares,
)
from adhesion_jax.discovery.law import BASES, kind_of
from adhesion_jax.discovery.library import Entry, entry_of
from adhesion_jax.discovery.problem import Problem
from adhesion_jax.discovery.scans import SCAN_SIGNIFICANT, products, waves
from adhesion_jax.discovery.screening import SIGNIFICANT, Score, screen
from adhesion_jax.discovery.state import Accepted, Selection, parts_of, settled, without
from adhesion_jax.discovery.trials import Trial, choose, class_of, ranked, shortlisted, tied, tried

_ROUNDS = 6

#: An effect is accepted at this share of the loss, one standard error over it.
_LEAST_GAIN = 0.003

#: By so many standard deviations the best cause must stand out more when noise is taken for white.
_CLEARER = 2.0

#: A second effect of a family that gains less than this share of the first refines its form.
_MATTER_OF_FORM = 0.25

#: So does one of any family below this share, if it rests on no column of its own.
_SMALL_MATTER = 0.05
_ALWAYS_THERE = ("slip_ratio", "slip_velocity_mps", "vehicle_speed_mps", "time_s")

#: Families whose effects noise in the slip looks like.
_FEIGNED = ("in time", "offset")


def search(
    setting: Setting,
    fits: Mapping[str, Fitted],
    entries: Sequence[Entry],
    seed: int,
    progress: Callable[[str, float], None],
) -> Selection:
    """Accepts effects until none is left that is significant and lowers the held-out loss."""
    first = state = settled(setting, fits, (), ())
    chosen_on = first.base
    pairs = products(setting.problem)
    for number in range(_ROUNDS):
        progress(f"looking for effect {number + 1}", 0.1 + 0.6 * number / _ROUNDS)
        open_entries = _open(entries, state)
        scores: Sequence[Score] = screen(state.setting, state.fitted, open_entries, seed + number)
        needed = scores[0].needed if scores else np.nan
        state = state._replace(thresholds=(*state.thresholds, needed))
        chosen, significant = state, SIGNIFICANT
        if number == 0 and state.setting.noise.autocorrelation > 0:
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
            state = found
            break
        if number == 0:
            found, chosen_on = _plainer(found, first, entries, seed)
        state = _pruned(found)
        if len(state.accepted) < len(found.accepted):
            break
    return _with_other_formulas(_reconsidered(state, chosen_on, entries, seed), entries)


def _grown(state: Selection, before: Selection) -> bool:
    """Whether an effect or a part of one was accepted."""
    return state.accepted is not before.accepted


def _plainer(
    found: Selection, first: Selection, entries: Sequence[Entry], seed: int
) -> tuple[Selection, str]:
    """The first effect chosen anew on a curve that speed does not change, if that is better.

    A curve that itself falls with speed may have absorbed the cause. What was accepted then makes
    up for what is wrong with the curve, and no later round would find both. Also on which curve
    the effect was chosen.
    """
    plain = {name: fitted for name, fitted in first.fits.items() if not BASES[name].NEEDS}
    if not plain or first.base in plain:
        return found, first.base
    start = first._replace(fits=plain, base=min(plain, key=lambda name: bic(plain[name])))
    scores = screen(start.setting, start.fitted, entries, seed)
    again = _next(start, scores, SIGNIFICANT, 0)
    parts = parts_of(again.accepted)
    fitted = fit_model(found.setting, again.base, again.fitted.base_values.tolist(), parts)
    if bic(fitted) >= bic(found.fitted):
        return found, first.base
    fits = {**first.fits, **again.fits}
    whole = settled(again.setting, fits, again.accepted, again.ranking)
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
        fits = refits(state.setting, state.fits, parts_of(rest))
        start = state._replace(fits=fits, accepted=rest)
        scores = screen(start.setting, start.fitted, _open(entries, start), seed)
        again = _next(start, scores, SIGNIFICANT, len(state.thresholds))
        more = squares(again.setting, again.fitted) / squares(state.setting, state.fitted)
        simpler = len(again.fitted.places) < len(state.fitted.places)
        if len(again.accepted) == len(state.accepted) and more < (1.002 if simpler else 1.0):
            state = again
    return state


def _with_other_formulas(state: Selection, entries: Sequence[Entry]) -> Selection:
    """Formulas of a family that only with the refinement of its effect do as well, in its class."""
    accepted = []
    for effect in state.accepted:
        if len(effect.parts) > 1 and not effect.generic:
            kin = [
                (entry.name, start)
                for entry in _open(entries, state)
                if entry.family == effect.family and not entry.generic
                for start in entry.starts
            ]
            values = state.fitted.base_values.tolist()
            rest = [part for part in state.fitted.effects if part is not effect.parts[0]]
            models = [(state.base, values, (*rest, start)) for _, start in kin]
            trials = zip(kin, fit_models(state.setting, models), strict=True)
            as_good = [name for (name, _), less in trials if tied(gain(less, state.fitted))]
            effect = effect._replace(members=tuple(dict.fromkeys((*effect.members, *as_good))))
        accepted.append(effect)
    return state._replace(accepted=tuple(accepted))


def _uncoloured(
    state: Selection, entries: Sequence[Entry], seed: int
) -> tuple[Selection, Sequence[Score]]:
    """The state and its scores as if the noise of neighbours were independent.

    What is missing may itself be what correlates them. A curve fitted to fast changes alone then
    hides the cause: one that follows the slip late fits a curve without a rise.
    """
    noise = state.setting.noise._replace(autocorrelation=np.array(0.0))
    setting = Setting(state.setting.problem, noise, state.setting.level)
    fits = {**state.fits, **first_fits(setting, [state.base])}
    white = state._replace(setting=setting, fits=fits)
    return white, screen(setting, white.fitted, entries, seed)


def _open(entries: Sequence[Entry], state: Selection) -> Sequence[Entry]:
    """What may still be accepted: no member of a class twice, nothing that slip noise feigns."""
    taken = {member for effect in state.accepted for member in (effect.name, *effect.members)}
    taken |= {kind_of(part) for part in parts_of(state.accepted)}
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


def _next(state: Selection, scores: Sequence[Score], significant: float, number: int) -> Selection:
    """The state with its ranking, and with one more effect where one is accepted."""
    shortlist = shortlisted(scores, significant)
    if not shortlist:
        rows = ranked(number, scores, (), None, None, (), False)
        return state._replace(ranking=(*state.ranking, *rows))
    setting, now, trials = tried(state, shortlist)
    if not trials:
        rows = ranked(number, scores, (), None, None, (), False)
        return state._replace(ranking=(*state.ranking, *rows))
    chosen = choose(trials, now)
    gained = gain(now.fitted, chosen.fitted)
    accepted = chosen.score.p <= significant and _is_worth(gained, now.loss)
    members = class_of(trials, chosen, now)
    ranking = (*state.ranking, *ranked(number, scores, trials, now, chosen, members, accepted))
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
        gained.total,
    )
    return _joined(state, setting, chosen, new, ranking)


def _is_worth(gained: Gain, loss: float) -> bool:
    """Whether an effect lowers the loss by more than its standard error and a least share of it."""
    return gained.total > max(gained.error, _LEAST_GAIN * loss)


def _joined(
    state: Selection,
    setting: Setting,
    chosen: Trial,
    new: Accepted,
    ranking: Sequence[Candidate],
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
    fits = {**state.fits, state.base: chosen.fitted}
    start = _started(accepted, chosen)
    return settled(setting, fits, start, ranking)._replace(thresholds=state.thresholds)


def _matter_of_form(new: Accepted, old: Accepted, varying: frozenset[str]) -> bool:
    """Whether what is new only mends the formula of what was accepted before.

    A plain column of the same effect does, one of its family that gains much less does, and so does
    a small gain by anything that rests on nothing but its columns, slip, speed and time: that is
    what a formula leaves that is a little wrong.
    """
    own = {*new.covariates}
    if not ((own | {*old.covariates}) & varying) - {"slip_ratio", "slip_velocity_mps"}:
        # Both are functions of the slip alone: together they are one.
        return True
    if new.generic and own <= {*old.covariates}:
        return True
    if new.family == old.family:
        return new.gain < _MATTER_OF_FORM * old.gain
    return own <= {*old.covariates, *_ALWAYS_THERE} and new.gain < _SMALL_MATTER * old.gain


def _started(accepted: Sequence[Accepted], chosen: Trial) -> tuple[Accepted, ...]:
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


def _pruned(state: Selection) -> Selection:
    """Backward elimination: what later effects and refinements have made needless goes."""
    while True:
        values = state.fitted.base_values.tolist()
        for rest in _smaller(state):
            less = fit_model(state.setting, state.base, values, parts_of(rest))
            whole = float(expected_loss(state.fitted).sum())
            if not _is_worth(gain(less, state.fitted), whole):
                state = without(state, rest)
                break
        else:
            return state


def _smaller(state: Selection) -> Iterator[tuple[Accepted, ...]]:
    """The accepted without one of them but the last, or without a part of one but its last."""
    for effect in state.accepted[:-1]:
        yield tuple(other for other in state.accepted if other is not effect)
    for effect in state.accepted:
        if len(effect.parts) < 2:
            continue
        for less in _with_a_part_less(effect, state.setting.problem):
            yield tuple(less if other is effect else other for other in state.accepted)


def _with_a_part_less(effect: Accepted, problem: Problem) -> Iterator[Accepted]:
    """Where the part goes that named the effect, the last takes its place, if it is a cause."""
    _, *between, last = effect.parts
    for part in between:
        yield effect._replace(parts=tuple(other for other in effect.parts if other is not part))
    name = kind_of(last)
    if name in EFFECTS:
        entry = entry_of(name, (last,), problem)
        yield effect._replace(
            name=name,
            members=(name, *effect.members),
            family=entry.family,
            generic=False,
            covariates=entry.covariates,
            parts=(last, *between),
        )
