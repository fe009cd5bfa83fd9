"""Forward selection: effects are accepted one at a time, each refitted with all the others."""

from collections.abc import Callable, Sequence, Set

import numpy as np

from adhesion_jax.discovery.model.prediction import gain
from adhesion_jax.discovery.model.problem import label_of
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import Entry, forms_of_column, pair_entries
from adhesion_jax.discovery.search.probes import Null, beside_smoothing, null_of, split
from adhesion_jax.discovery.search.refinement import form_of, pruned, refined
from adhesion_jax.discovery.search.scans import waves
from adhesion_jax.discovery.search.screening import Score, least_p, screen
from adhesion_jax.discovery.search.state import (
    Accepted,
    Selection,
    as_effect,
    parts_of,
    settled,
)
from adhesion_jax.discovery.search.together import together
from adhesion_jax.discovery.search.trials import (
    Trial,
    choose,
    class_of,
    clearly_ahead,
    fitted_start,
    is_worth,
    ranked,
    shortlisted,
    trial_of,
    tried,
)
from adhesion_jax.discovery.types import Candidate, Doubt, Opinion
from adhesion_jax.effects import Effect, Interaction, Surface, in_words, kind_of
from adhesion_jax.effects.dynamic import Dynamic
from adhesion_jax.wording import capital, p_is

#: Columns that say which slip a point has.
_OF_THE_SLIP = ("slip_ratio", "slip_velocity_mps")

#: Columns that an inexact formula of any effect may leave something against.
_ALWAYS_THERE = (*_OF_THE_SLIP, "vehicle_speed_mps", "time_s")


def search(
    state: Selection,
    entries: Sequence[Entry],
    seed: int,
    progress: Callable[[str, float], None],
) -> Selection:
    """The state with the effects that are significant and lower the expected loss on runs left out.

    `entries` are the candidates, and `progress` is called with words and the share of the whole.
    """
    for number in range(rules.MOST_ROUNDS):
        if state.full:
            return state
        share = 0.6 * number / rules.MOST_ROUNDS
        progress(f"looking for effect {number + 1}", 0.1 + share)
        nulls = _nulls(state, beside(state, entries))
        scores = screen(_apart(nulls, _open(entries, state)), seed + number)
        needed = scores[0].needed if scores else np.nan
        state = state._replace(thresholds=(*state.thresholds, needed))
        found = _next(state, scores, rules.SIGNIFICANT, number, seed)
        if not _grown(found, state):
            # Lines of several columns are plainer than a surface over two of them.
            found = together(found, nulls[0], number, seed)
        if not _grown(found, state):
            state = state._replace(ranking=found.ranking)
            progress("looking for waves and pairs of columns", 0.15 + share)
            scanned = _scanned(state, nulls, scores, seed + number)
            found = _next(state, scanned, rules.SCAN_SIGNIFICANT, number, seed)
        if not _grown(found, state):
            return found
        found = refined(found, seed)
        state = pruned(found)
        if len(state.accepted) < len(found.accepted):
            return state
    return state


def nominated(state: Selection, entries: Sequence[Entry], opinion: Opinion, seed: int) -> Selection:
    """The state with an effect of the columns by which boosted trees predict runs left out.

    The opinion of the trees is a test of its own, whose p is that of the effect: only the form is
    left to be found, which signs of few runs may not tell from chance among all that the search
    looks at. Without a form that lowers the expected loss enough it is the state itself.
    """
    if state.full:
        return state
    problem, names = state.setting.problem, {*opinion.columns}
    own = [name for effect in state.accepted for name in effect.covariates]
    forms = [entry for entry in _open(entries, state) if names & {*entry.covariates}]
    for column in problem.columns:
        if label_of(column, problem.measured) in names:
            forms += forms_of_column(column, problem)
    for kind in (Surface, Interaction):
        forms += pair_entries(kind, problem, opinion.columns, (*opinion.columns, *own))
    known = {form_of(part) for part in parts_of(state.accepted)}
    new = {form_of(entry.starts[0]): entry for entry in forms}
    tested = [entry for form, entry in new.items() if form not in known]
    scores = screen(_apart(_nulls(state, ()), tested), seed)
    number = state.ranking[-1].round + 1 if state.ranking else 0
    p = max(opinion.p, least_p(problem.runs))
    found = _next(state, scores, rules.SIGNIFICANT, number, seed, p)
    if not _grown(found, state):
        return state
    before = len(state.accepted)
    named = (effect._replace(by_trees=True) for effect in found.accepted[before:])
    accepted = (*found.accepted[:before], *named)
    return pruned(refined(found._replace(accepted=accepted), seed))


def _nulls(state: Selection, given: Sequence[Effect]) -> list[Null]:
    """The model and what is given, in a test by signs of the runs and in one within them."""
    whole = not state.setting.problem.blocks
    return [null_of(state.fitted, given, within=within) for within in (False, True)[: 1 + whole]]


def _apart(
    nulls: Sequence[Null], entries: Sequence[Entry]
) -> list[tuple[Sequence[Null], Sequence[Entry]]]:
    """The entries with what is given: more beside a memory, which may smooth a noisy slip."""
    others = [entry for entry in entries if not isinstance(entry.starts[0], Dynamic)]
    memories = [entry for entry in entries if isinstance(entry.starts[0], Dynamic)]
    return [(nulls, others), ([beside_smoothing(null) for null in nulls], memories)]


def beside(state: Selection, entries: Sequence[Entry]) -> list[Effect]:
    """All that the columns and the causes of the accepted effects might explain, as probes.

    Further effects are tested beside it, because an accepted effect of an inexact form leaves
    something that goes with any column that resembles its own.
    """
    if not state.accepted:
        return []
    problem = state.setting.problem
    own = {name for effect in state.accepted for name in effect.covariates}
    families = {effect.family for effect in state.accepted}
    starts = [
        entry.starts[0]
        for column in problem.columns
        if label_of(column, problem.measured) in own
        for entry in forms_of_column(column, problem)
    ]
    starts += [
        start
        for entry in entries
        if not entry.generic and entry.family in families
        for start in entry.starts
    ]
    return split(starts)[0]


def _grown(state: Selection, before: Selection) -> bool:
    """Whether an effect or a part of one was accepted."""
    return len(parts_of(state.accepted)) > len(parts_of(before.accepted))


def _open(entries: Sequence[Entry], state: Selection) -> Sequence[Entry]:
    """The entries that may still be accepted: no effect twice, and no second one of a class."""
    taken = {member for effect in state.accepted for member in (effect.name, *effect.members)}
    taken |= {kind_of(part) for part in parts_of(state.accepted)}
    return [entry for entry in entries if entry.name not in taken]


def _scanned(
    state: Selection, nulls: Sequence[Null], scores: Sequence[Score], seed: int
) -> Sequence[Score]:
    """Waves by their coherence over runs, then pairs of the columns of best score."""
    lines = waves(nulls[0], [effect.name for effect in state.accepted], seed)
    # What else the effect of a column rests on may show beside it alone.
    own = [name for effect in state.accepted for name in effect.covariates]
    columns = [label for label in (*own, *_columns_of(scores)) if label not in _OF_THE_SLIP]
    pairs = _pairs(state, columns)
    joint = screen([(nulls, pairs)], seed) if pairs else []
    return [*sorted(lines, key=_by_p), *sorted(joint, key=_by_p)]


def _pairs(state: Selection, columns: Sequence[str]) -> Sequence[Entry]:
    """Surfaces over two of the first columns, and the mixed terms of those that effects rest on.

    With all forms of a column given hardly more than one mixed term of a surface is left, and two
    columns may act together without it. The mixed terms of a pair are open where it is but a member
    of a class as well: its surface may have been like others by what one of its columns does alone.
    """
    problem, first = state.setting.problem, columns[: rules.PAIRED_COLUMNS]
    own = {name for effect in state.accepted for name in effect.covariates}
    names = {effect.name for effect in state.accepted}
    mixed = [
        entry
        for entry in pair_entries(Interaction, problem, first)
        if own & {*entry.covariates} and entry.name not in names
    ]
    return [*_open(pair_entries(Surface, problem, first), state), *mixed]


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
    entry = chosen.score.entry
    if not entry.generic or len(entry.covariates) > 1:
        return None
    problem = now.fitted.setting.problem
    parts = []
    for other in _columns_of(scores)[: rules.PARTNER_COLUMNS]:
        # Tested beside all forms of each column alone: only what both do together counts.
        both = {*entry.covariates, other}
        own = [name for name in problem.columns if label_of(name, problem.measured) in both]
        forms = [form.starts[0] for name in own for form in forms_of_column(name, problem)]
        if pairs := pair_entries(Surface, problem, entry.covariates, (other,)):
            parts.append(([null_of(chosen.fitted, split(forms)[0])], pairs))
    scored = [one for one in screen(parts, seed) if one.p <= rules.SCAN_SIGNIFICANT]
    trials = tried(now.fitted, scored[: rules.TRIED_FORMS])
    if not trials:
        return None
    best = min(trials, key=lambda trial: trial.loss)
    if not clearly_ahead(chosen, best, now):
        return None
    return best._replace(score=best.score._replace(p=chosen.score.p))


def _next(
    state: Selection,
    scores: Sequence[Score],
    significant: float,
    number: int,
    seed: int,
    known: float = 1.0,
) -> Selection:
    """The state after one round: with its rows of the ranking, and one more effect if accepted.

    `known` is the p of a test apart from the scores that all of these candidates rest on.
    """
    sharper = [score._replace(p=min(score.p, known)) for score in scores]
    trials = tried(state.fitted, shortlisted(sharper, significant))
    if not trials:
        rows = ranked(number, scores, (), None, None, (), False)
        return state._replace(ranking=(*state.ranking, *rows))
    now = trial_of(state.fitted, scores[0])
    # A candidate that would not be accepted must not displace one that would.
    worthy = [
        trial
        for trial in trials
        if _p_of(trial.score, sharper) <= significant
        and is_worth(now.fitted, trial.fitted, trial.score.entry.generic)
    ]
    best = choose(worthy or trials, now)
    joint = _joint(best, now, scores, seed)
    chosen = best if joint is None else joint
    gained = gain(now.fitted, chosen.fitted)
    members = class_of(scores, chosen.score)
    p = _p_of(chosen.score, sharper)
    worth = is_worth(now.fitted, chosen.fitted, chosen.score.entry.generic)
    accepted = p <= significant and worth
    # A pair was not scored with the others and has no row of its own.
    in_row = best if joint is None else None
    ranking = (*state.ranking, *ranked(number, scores, trials, now, in_row, members, accepted))
    if not accepted:
        return state._replace(ranking=ranking)
    new = as_effect(chosen.score.entry, members, fitted_start(chosen), p, gained.total)
    return _with_effect(state, new, ranking)


def _p_of(chosen: Score, scores: Sequence[Score]) -> float:
    """The smallest p of any form of the columns of a candidate, or of its class.

    It need not be that of the candidate: the form of the best score may not explain most.
    """
    own, members = {*chosen.entry.covariates}, class_of(scores, chosen)
    return min(
        score.p
        for score in (chosen, *scores)
        if {*score.entry.covariates} <= own or score.entry.name in members
    )


def _with_effect(state: Selection, new: Accepted, ranking: Sequence[Candidate]) -> Selection:
    """The state with the chosen effect, as a refinement of the first one whose form it mends."""
    varying = state.setting.problem.flat.keys()
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
    return settled(state, accepted)._replace(ranking=tuple(ranking))


def _matter_of_form(new: Accepted, old: Accepted, varying: Set[str]) -> bool:
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


def undecided(state: Selection) -> tuple[Doubt, ...]:
    """The doubt about the best candidate of the last round that stands out and was not accepted.

    In fewer runs than any p could be significant of, one stands out by its score alone.
    """
    last = [row for row in state.ranking if row.round == state.ranking[-1].round]
    if any(row.decision == "accepted" for row in last):
        return ()
    runs = state.setting.problem.runs
    if least_p(runs) > rules.SIGNIFICANT:
        seen = [row for row in last if row.z >= state.thresholds[-1]]
        return (_of_few_runs(max(seen, key=lambda row: row.z), runs),) if seen else ()
    taken = {member for effect in state.accepted for member in effect.members}
    # A column of an accepted effect asks for another form of that effect, not for another effect.
    taken |= {f"covariate:{name}" for effect in state.accepted for name in effect.covariates}
    standing = [
        row
        for row in last
        if row.p_adjusted <= rules.SIGNIFICANT and row.gain > 0 and _plain(row) not in taken
    ]
    if not standing:
        return ()
    row = max(standing, key=lambda row: row.gain)
    p = p_is(row.p_adjusted, least_p(runs))
    seen_as = f"{capital(in_words(row.name))} stands out in the residual (adjusted {p}), but"
    if state.fitted.log and row.gain > rules.SURE_ERRORS_OF_COLUMN * row.gain_se:
        why = (
            f"{seen_as} what it explains lies in one stretch of the only run: it is not counted as "
            "an effect. A single event agrees with every column that was different there; a second "
            "run over the same line would decide."
        )
    else:
        why = (
            f"{seen_as} taken into the law it does not raise the likelihood of runs left out by "
            f"enough ({row.gain:.2g} with a standard error of {row.gain_se:.2g}): it is not "
            "counted as an effect. It may be weak, act differently at other values of another "
            "column, or be a proxy for a cause that has no column here; more runs in which it "
            "varies would decide."
        )
    return (Doubt((_plain(row),), why),)


def _plain(row: Candidate) -> str:
    """The name of a candidate without its form."""
    return row.name.split(" (")[0]


def _of_few_runs(row: Candidate, runs: int) -> Doubt:
    p = p_is(row.p_adjusted, least_p(runs))
    why = (
        f"{capital(in_words(row.name))} stands out most in the residual, as far as {runs} runs "
        f"can show it (adjusted {p}; its score is {row.z:.1f} standard errors): it is not "
        "counted as an effect, since so few runs agree by chance too often. More runs in which it "
        "varies would decide."
    )
    return Doubt((_plain(row),), why)
