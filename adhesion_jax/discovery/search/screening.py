"""Score tests: how much of the residual of a model each entry of the library would explain."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy
from scipy.special import gammaln

from adhesion_jax.discovery.model.bases import middle_start_under, starts_under
from adhesion_jax.discovery.model.fitting import (
    Fitted,
    Setting,
    has_room,
    in_noise_units,
    with_own_noise,
)
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import Entry
from adhesion_jax.discovery.search.probes import directions_of
from adhesion_jax.effects import EFFECTS, Effect

#: Number of random sign flips of the runs that the null distribution is drawn from.
_FLIPS = 1999

#: Number of top entries projected out of the residual before the null distribution is drawn.
_PROJECTED = 5

#: Largest number of probes that are held at a time.
_TOGETHER = 600

#: A form of an entry: the name of the entry, the kind of effect, the part of the curve it acts on.
Form = tuple[str, type, str]


class Score(NamedTuple):
    """How much of a residual one form of an entry would explain, before any refit."""

    entry: Entry
    start: Effect
    z: float  # of its chi-square, as a standard normal deviate
    p: float  # adjusted for the whole library by sign flips of runs
    needed: float  # the z whose adjusted p is that of acceptance
    elsewhere: Fitted | None = None  # the model whose residual it is, if not the one asked about

    @property
    def form(self) -> Form:
        return self.entry.name, type(self.start), self.entry.acts_on


def first_scores(
    fits: Mapping[str, Fitted], base: str, entries: Sequence[Entry], seed: int
) -> Sequence[Score]:
    """The best score of each form of an entry, for the base curve without effects, best first.

    If the noise is nearly white these are the scores of `screen`. Otherwise the missing effect may
    itself be what correlates neighbouring points or sets runs apart, and the curve, fitted under
    such a noise, hides it: an effect that delays adhesion leaves a curve without a rise, and free
    levels of the runs absorb an effect that acts on whole runs. Therefore the residual is screened
    a second time as if its noise were white; for two screenings each p is doubled. Effects that may
    be slow are also fitted outright, on every curve, because a little of such an effect does not
    show what all of it does; their p is so strict that they add next to nothing to false claims.
    """
    fitted = fits[base]
    scores = screen(fitted, entries, seed)
    noise = fitted.setting.noise
    if (
        float(noise.autocorrelation) < rules.COLOURED_AUTOCORRELATION
        and float(noise.run_scatter) < rules.COLOURED_RUN_SCATTER
    ):
        return scores
    best: dict[Form, Score] = {}
    rank: dict[Form, int] = {}
    white = _as_if_white(fitted)
    as_if_white = [score._replace(elsewhere=white) for score in screen(white, entries, seed)]
    for some in (scores, as_if_white, _outright(fits, fitted, white, entries)):
        for place, score in enumerate(some):
            form = score.form
            rank[form] = min(place, rank.get(form, place))
            if form not in best or score.z > best[form].z:
                best[form] = score
    # Sorted by the rank within a screening: the z of different screenings cannot be compared.
    return [
        best[form]._replace(p=min(2 * best[form].p, 1.0))
        for form in sorted(best, key=lambda form: (rank[form], -best[form].z))
    ]


def _as_if_white(fitted: Fitted) -> Fitted:
    """The base curve refitted without autocorrelation, and without a run scatter that is large."""
    setting = fitted.setting
    noise = setting.noise._replace(autocorrelation=np.array(0.0))
    if float(noise.run_scatter) >= rules.COLOURED_RUN_SCATTER:
        noise = noise._replace(run_scatter=np.array(0.0))
    white = Setting(setting.problem, noise, setting.level)
    return min(starts_under(white, [fitted.base]), key=lambda start: start.total)


def _outright(
    fits: Mapping[str, Fitted], fitted: Fitted, white: Fitted, entries: Sequence[Entry]
) -> Sequence[Score]:
    """Effects that may be slow, each fitted on the curve where it is likeliest, the best z first.

    z and p are those of the likelihood ratio to `fitted`, the base curve alone; p is multiplied by
    the number of these entries and by `rules.OUTRIGHT_TIMES`.
    """
    slow = [entry for entry in entries if entry.name in EFFECTS and EFFECTS[entry.name].SLOW]
    found = []
    for entry in slow:
        start = entry.starts[-1]
        trials = [middle_start_under(white.setting, base, (start,)) for base in fits]
        own = with_own_noise(min(trials, key=lambda trial: trial.total))
        ratio = 2 * (fitted.total - own.total)
        freedom = max(len(own.places) - len(fitted.places), 1)
        if not ratio > 0:
            continue
        p = min(1.0, rules.OUTRIGHT_TIMES * len(slow) * float(scipy.stats.chi2.sf(ratio, freedom)))
        z = float(_as_normal(np.array([ratio]), np.array([freedom]))[0])
        (effect,) = own.effects
        found.append(Score(entry, effect, z, p, np.nan, own._replace(effects=())))
    return sorted(found, key=lambda score: -score.z)


def screen(fitted: Fitted, entries: Sequence[Entry], seed: int) -> tuple[Score, ...]:
    """The best start of each form of an entry, the largest z first.

    The probe of a start is the change of the prediction when one of its strengths is raised from
    zero, with the model's Jacobian projected out; z says how much of the residual the probes of a
    start explain. p is the share of sign flips of whole units (runs, or stretches of one) in which
    the largest z of the library reaches this one, so that it is adjusted for all entries. The best
    entries are projected out of the residual before the signs are flipped: otherwise real effects
    would widen the null distribution. Starts for which a model has no room are left out.
    """
    starts = [
        (entry, start)
        for entry in entries
        for start in entry.starts
        if has_room(fitted.effects, start)
    ]
    if not starts:
        return ()
    groups = _groups(starts)
    seen = [_seen(fitted, group) for group in groups[:1]]
    # Of many probes some at a time are held, and worked out anew where they are needed again.
    best: list[_Best] = []
    for number, group in enumerate(groups):
        best = _best_of([*best, *_firsts(seen[0] if number == 0 else _seen(fitted, group))])
    residual = left = seen[0].residual
    block = np.concatenate([one.block for one in best], axis=1)
    if block.size:
        left = residual - block @ np.linalg.lstsq(block, residual, rcond=1e-3)[0]
    signs: np.ndarray | None = None
    largest = np.full(_FLIPS, -np.inf)
    found: list[tuple[tuple[Entry, Effect], float]] = []
    for number, group in enumerate(groups):
        one = seen[0] if number == 0 else _seen(fitted, group)
        noise = _split_scores(one.flat, left, fitted.setting)
        excess = _excess(one.blocks, one.parts, noise)
        observed = _as_normal(*_statistics(one.blocks, one.parts, excess, *_observed(one.parts)))
        if signs is None:
            shape = (noise.levels.size, _FLIPS)
            signs = np.random.default_rng([seed, 11]).choice([-1.0, 1.0], size=shape)
        flipped = (noise.level @ signs, noise.within @ signs, float((noise.levels**2).sum()))
        statistic, freedom = _statistics(one.blocks, one.parts, excess, *flipped)
        # Among blocks of equal degrees of freedom the largest statistic has the largest deviate.
        alike = [freedom[:, 0] == k for k in np.unique(freedom)]
        tops = [_as_normal(statistic[some].max(axis=0), freedom[some][0]) for some in alike]
        largest = np.max([largest, *tops], axis=0)
        tested = zip(group, observed[:, 0], one.blocks, strict=True)
        found += [(start, float(z)) for start, z, block in tested if block.size]
    needed = float(np.quantile(largest, 1 - rules.SIGNIFICANT))
    scores: dict[Form, Score] = {}
    for (entry, start), z in found:
        p = (1 + np.sum(largest >= z)) / (1 + _FLIPS)
        score = Score(entry, start, z, float(p), needed)
        if score.form not in scores or scores[score.form].z < z:
            scores[score.form] = score
    return tuple(sorted(scores.values(), key=lambda score: -score.z))


_Start = tuple[Entry, Effect]


def _groups(starts: Sequence[_Start]) -> list[list[_Start]]:
    """The starts in groups of a bounded number of probes."""
    groups: list[list[_Start]] = [[]]
    count = 0
    for one in starts:
        count += len(one[1].STRENGTHS)
        if count > _TOGETHER:
            groups.append([])
            count = len(one[1].STRENGTHS)
        groups[-1].append(one)
    return groups


class _Seen(NamedTuple):
    """The probes of some starts against a residual."""

    starts: Sequence[_Start]
    flat: np.ndarray  # [points, probes]
    residual: np.ndarray  # [points]
    blocks: list[np.ndarray]  # [starts]: the testable probes of each
    parts: "_SplitScores"


def _seen(fitted: Fitted, starts: Sequence[_Start]) -> _Seen:
    probes, owner = [], []
    for place, (_, start) in enumerate(starts):
        for strength in start.STRENGTHS:
            others = {name: 0.0 for name in start.STRENGTHS if name != strength}
            probes.append(dataclasses.replace(start, **others))
            owner.append(place)
    testable, flat, residual = directions_of(fitted, probes)
    owners = np.array(owner)
    blocks = [np.flatnonzero((owners == place) & testable) for place in range(len(starts))]
    return _Seen(starts, flat, residual, blocks, _split_scores(flat, residual, fitted.setting))


class _Best(NamedTuple):
    """The best start of an entry: its name, z, and probes [points, probes]."""

    name: str
    z: float
    block: np.ndarray


def _firsts(seen: _Seen) -> list[_Best]:
    """The best starts of the best entries."""
    unscaled = np.ones(len(seen.blocks))
    statistics = _statistics(seen.blocks, seen.parts, unscaled, *_observed(seen.parts))
    z = _as_normal(*statistics)[:, 0]
    chosen: dict[str, int] = {}
    for place in np.argsort(-z, kind="stable"):
        chosen.setdefault(seen.starts[place][0].name, int(place))
        if len(chosen) == _PROJECTED:
            break
    return [
        _Best(name, float(z[place]), seen.flat[:, seen.blocks[place]])
        for name, place in chosen.items()
    ]


def _best_of(candidates: Sequence[_Best]) -> list[_Best]:
    best: dict[str, _Best] = {}
    for one in sorted(candidates, key=lambda one: -one.z):
        best.setdefault(one.name, one)
    return list(best.values())[:_PROJECTED]


class _SplitScores(NamedTuple):
    """Scores of the probes by run, split into those of its level and of what changes within it.

    The score of a probe is its scalar product with the residual.
    """

    level: np.ndarray  # [probes, runs]
    within: np.ndarray  # [probes, runs]
    levels: np.ndarray  # [runs]: the level of each run in the residual
    outer: np.ndarray  # [probes, probes]: products of the probes' levels, summed over runs
    inner: np.ndarray  # [probes, probes]: products of what they change within runs
    variance: float  # of a point of the residual within its run


def _split_scores(flat: np.ndarray, residual: np.ndarray, setting: Setting) -> _SplitScores:
    """Scores of probes [points, probes] and a residual [points], both in units of the noise."""
    weight = np.asarray(setting.noise.weight)
    unlevelled = setting.noise._replace(run_scatter=np.array(0.0))
    level = in_noise_units(
        Setting(setting.problem, unlevelled, setting.level), setting.level[None]
    )[0]
    if setting.problem.blocks:
        level = np.zeros_like(level)  # blocks of one run have no level of their own
    size = np.sqrt((level**2).sum(axis=1, keepdims=True))
    direction = (level / np.maximum(size, 1e-300))[weight > 0]
    unit = np.unique(setting.problem.units[weight > 0], return_inverse=True)[1]

    def by_run(columns: np.ndarray) -> np.ndarray:
        ends = np.flatnonzero(np.diff(unit, prepend=-1))
        return np.add.reduceat(columns, ends, axis=0).T

    probe_levels = by_run(flat * direction[:, None])
    levels = by_run(residual[:, None] * direction[:, None])[0]
    level_scores = probe_levels * levels
    scores = by_run(flat * residual[:, None])
    outer = probe_levels @ probe_levels.T
    variance = float(residual @ residual - levels @ levels) / max(residual.size - levels.size, 1)
    inner = flat.T @ flat - outer
    return _SplitScores(level_scores, scores - level_scores, levels, outer, inner, variance)


def _observed(parts: _SplitScores) -> tuple[np.ndarray, np.ndarray, float]:
    """The scores of each probe over all runs, [probes, 1], and the energy of the runs' levels."""
    level, within = (scores.sum(axis=1, keepdims=True) for scores in (parts.level, parts.within))
    return level, within, float((parts.levels**2).sum())


def _excess(blocks: Sequence[np.ndarray], parts: _SplitScores, noise: _SplitScores) -> np.ndarray:
    """Variance of the scores of the runs relative to that of independent points, [blocks].

    It corrects for a correlation within runs that is known only approximately. It is at least the
    variance of the points within their runs or one, whichever is smaller: a noise estimated from a
    misfit is wider than the points are.
    """
    least = min(noise.variance, 1.0)
    found = np.full(len(blocks), least)
    scatter = noise.within @ noise.within.T
    for some, rows, columns in _by_size(blocks):
        inverse = np.linalg.pinv(parts.inner[rows, columns], rcond=1e-3, hermitian=True)
        traces = np.einsum("nkl,nlk->n", inverse, scatter[rows, columns])
        found[some] = np.maximum(traces / rows.shape[1], least)
    return found


def _statistics(
    blocks: Sequence[np.ndarray],
    parts: _SplitScores,
    excess: np.ndarray,
    level: np.ndarray,
    within: np.ndarray,
    energy: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Likelihood ratios of blocks of probes [blocks, choices], and degrees of freedom [blocks, 1].

    `level` and `within` are the scores of the probes, [probes, choices of signs]. With the level c
    of each run, what changes within runs e, and the least squares b of a block of k probes, the
    statistic is m ln(c'c/(c - A b)'(c - A b)) + (e'e - (e - E b)'(e - E b))/v, v the excess. The
    variance of the levels is unknown: m = R - 1 - (k + 1)/2 after Bartlett 1937. (Against a fixed
    variance, estimated from the same residual, a cause that acts from run to run could explain no
    more than the number of runs.)
    """
    found = np.zeros((len(blocks), level.shape[1]))
    freedoms = np.zeros((len(blocks), 1))
    for some, rows, columns in _by_size(blocks):
        outer, inner = parts.outer[rows, columns], parts.inner[rows, columns]
        share = excess[some][:, None, None]
        values, vectors = np.linalg.eigh(outer + inner / share)
        # Nearly singular directions are left out.
        kept = values > 1e-3 * values[:, -1:]
        inverse = np.where(kept, 1 / np.where(kept, values, 1.0), 0.0)
        levels, withins = level[rows[:, :, 0]], within[rows[:, :, 0]]
        b = vectors @ (inverse[:, :, None] * (vectors.mT @ (levels + withins / share)))
        explained = (b * (2 * levels - outer @ b)).sum(axis=1)
        rest = (b * (2 * withins - inner @ b)).sum(axis=1)
        freedom = kept.sum(axis=1, keepdims=True)
        factor = np.maximum(parts.levels.size - 1 - (freedom + 1) / 2, 1.0)
        left = np.clip(1 - explained / max(energy, 1e-300), 1e-12, None)
        found[some] = np.maximum(rest / share[:, 0] - factor * np.log(left), 0.0)
        freedoms[some] = freedom
    return found, freedoms


def _by_size(
    blocks: Sequence[np.ndarray],
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Blocks of equal size together: their numbers, and where their Gram matrices stand."""
    sizes = np.array([block.size for block in blocks])
    for size in np.unique(sizes[sizes > 0]):
        some = np.flatnonzero(sizes == size)
        places = np.stack([block for block in blocks if block.size == size])
        yield some, places[:, :, None], places[:, None, :]


def _as_normal(chi_square: np.ndarray, freedom: np.ndarray) -> np.ndarray:
    """The standard normal deviate with the same upper tail; 0 for no degrees of freedom.

    Far in the tail by the asymptotic series of the incomplete gamma function and of the normal
    tail, elsewhere by the cube root of Wilson and Hilferty 1931.
    """
    some = np.maximum(freedom, 1)
    half, shape = np.maximum(chi_square, 1e-9) / 2, some / 2
    spread = 2 / (9 * some)
    near = ((chi_square / some) ** (1 / 3) - 1 + spread) / np.sqrt(spread)
    far = chi_square > 2 * some + 6
    shortened = np.log1p(-np.where(far, (shape - 1) / half, 0.0))
    log_tail = -half + (shape - 1) * np.log(half) - gammaln(shape) - shortened
    double = np.maximum(-2 * log_tail, 1.0)
    deviate = np.sqrt(np.maximum(double - np.log(2 * np.pi * double), 0.0))
    deviate = np.sqrt(np.maximum(double - np.log(2 * np.pi * np.maximum(deviate, 1.0) ** 2), 0.0))
    return np.where(freedom > 0, np.where(far, deviate, near), 0.0)
