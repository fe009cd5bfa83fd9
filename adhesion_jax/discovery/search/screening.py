"""Which cause would explain most of what is left: score tests of the whole library at once."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float
from scipy import stats
from scipy.special import gammaln

from adhesion_jax.curves import BASES, Scalar
from adhesion_jax.discovery.model.bases import middle_start_under, starts_under
from adhesion_jax.discovery.model.fitting import (
    Fitted,
    Setting,
    has_room,
    in_noise_units,
    raw_changes,
    size_of,
    with_own_noise,
)
from adhesion_jax.discovery.model.problem import Problem
from adhesion_jax.discovery.model.program import PROBES, changes, pack, words_of
from adhesion_jax.discovery.search.catalogue import Entry
from adhesion_jax.effects import EFFECTS, Covariate, Effect, ShapeTerm
from adhesion_jax.effects.shape import ACTS_ON

#: A probe that keeps less than this share of itself beside the model cannot be told from it.
_SHARE_LEFT = 0.03

_FLIPS = 1999

#: What is fitted outright may claim with this part of the chance that what is scored may.
_SPENT = 500

#: From this autocorrelation or this scatter of the levels of runs on, the residual is also looked
#: at as if its noise were white.
_COLOURED, _SCATTERED = 0.15, 0.025

#: So many entries are taken for real when the null distribution is drawn.
_PROJECTED = 5

#: An effect is accepted at this p, adjusted for the whole library.
SIGNIFICANT = 0.01


class Score(NamedTuple):
    """What a start of an entry would explain, before any refit."""

    entry: Entry
    start: Effect
    z: float  # of its chi-square, as a standard normal deviate
    p: float  # adjusted for the whole library by sign flips of runs
    needed: float  # the z whose adjusted p is that of acceptance
    seen_in: Fitted  # the model in whose residual it was seen


def seen(
    fits: Mapping[str, Fitted], base: str, entries: Sequence[Entry], seed: int
) -> Sequence[Score]:
    """The scores of all entries in the residual of a curve, under its noise and as if white.

    What is missing may itself be what correlates neighbours, or what sets runs apart. A curve
    fitted to fast changes alone then hides the cause: one that follows the slip late fits a curve
    without a rise; and where the level of each run is free, what acts on whole runs is lost in it.
    And of an effect that may be slow a little says nothing of the whole: it is fitted outright, on
    any of the curves. Each entry counts as it is seen best, and for two looks each p is doubled;
    the third must be as good as certain, and costs them nothing.
    """
    fitted = fits[base]
    scores = screen(fitted, entries, seed)
    noise = fitted.setting.noise
    if float(noise.autocorrelation) < _COLOURED and float(noise.run_scatter) < _SCATTERED:
        return scores
    best: dict[tuple[str, type, str], Score] = {}
    rank: dict[tuple[str, type, str], int] = {}
    white = _as_if_white(fitted)
    looks = (scores, screen(white, entries, seed), _outright(fits, fitted, white, entries))
    for look in looks:
        for place, score in enumerate(look):
            key = (score.entry.name, type(score.start), score.entry.acts_on)
            rank[key] = min(place, rank.get(key, place))
            if key not in best or score.z > best[key].z:
                best[key] = score
    # The first of either look come first: a z of one is no measure for the other.
    return [
        best[key]._replace(p=min(2 * best[key].p, 1.0))
        for key in sorted(best, key=lambda key: (rank[key], -best[key].z))
    ]


def _as_if_white(fitted: Fitted) -> Fitted:
    """The base curve as if all points were independent."""
    setting = fitted.setting
    noise = setting.noise._replace(autocorrelation=np.array(0.0))
    if float(noise.run_scatter) >= _SCATTERED:
        noise = noise._replace(run_scatter=np.array(0.0))
    white = Setting(setting.problem, noise, setting.level)
    return min(starts_under(white, fitted.base), key=lambda start: start.total)


def _outright(
    fits: Mapping[str, Fitted], fitted: Fitted, white: Fitted, entries: Sequence[Entry]
) -> Sequence[Score]:
    """Slow effects by likelihood ratios to the curve alone, on whichever curve they fit best.

    p is that of chi-square, times the number of these entries and `_SPENT`.
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
        p = min(1.0, _SPENT * len(slow) * float(stats.chi2.sf(ratio, freedom)))
        z = float(_as_normal(np.array([ratio]), np.array([freedom]))[0])
        (effect,) = own.effects
        found.append(Score(entry, effect, z, p, np.nan, own._replace(effects=())))
    return sorted(found, key=lambda score: -score.z)


def screen(fitted: Fitted, entries: Sequence[Entry], seed: int) -> tuple[Score, ...]:
    """The best start of each entry, the most telling first.

    Each start is switched on a little, strength by strength; what that changes, with the model's
    own Jacobian projected out, is held against the residual. Significance is by flipping the signs
    of whole units, after the most telling entries have been projected out of the residual (what is
    really there would else be taken for noise), and the largest z over the library is compared: p
    is adjusted for everything that was looked at.
    """
    starts = [
        (entry, start)
        for entry in entries
        for start in entry.starts
        if has_room(fitted.effects, start)
    ]
    probes, owner = [], []
    for place, (_, start) in enumerate(starts):
        for strength in start.STRENGTHS:
            others = {name: 0.0 for name in start.STRENGTHS if name != strength}
            probes.append(dataclasses.replace(start, **others))
            owner.append(place)
    if not probes:
        return ()
    setting = fitted.setting
    heard, flat, residual = telling(fitted, probes)

    owners = np.array(owner)
    blocks = [np.flatnonzero((owners == place) & heard) for place in range(len(starts))]
    parts = _parts(flat, residual, setting)
    unscaled = np.ones(len(blocks))
    first = _as_normal(*_statistics(blocks, parts, unscaled, *_observed(parts)))[:, 0]
    block = flat[:, np.concatenate([blocks[place] for place in _most_telling(starts, first)])]
    left = residual
    if block.size:
        left = residual - block @ np.linalg.lstsq(block, residual, rcond=1e-3)[0]
    noise = _parts(flat, left, setting)
    excess = _excess(blocks, parts, noise)
    observed = _as_normal(*_statistics(blocks, parts, excess, *_observed(parts)))[:, 0]
    signs = np.random.default_rng([seed, 11]).choice([-1.0, 1.0], size=(noise.levels.size, _FLIPS))
    flipped = (noise.level @ signs, noise.within @ signs, float((noise.levels**2).sum()))
    statistic, freedom = _statistics(blocks, parts, excess, *flipped)
    # Of blocks of as many degrees of freedom the largest statistic is the largest deviate.
    alike = [freedom[:, 0] == k for k in np.unique(freedom)]
    tops = [_as_normal(statistic[some].max(axis=0), freedom[some][0]) for some in alike]
    largest = np.max(tops, axis=0)
    needed = float(np.quantile(largest, 1 - SIGNIFICANT))
    scores: dict[tuple[str, type, str], Score] = {}
    for (entry, start), z, block in zip(starts, observed, blocks, strict=True):
        if not block.size:
            continue
        p = (1 + np.sum(largest >= z)) / (1 + _FLIPS)
        score = Score(entry, start, float(z), float(p), needed, fitted)
        key = (entry.name, type(start), entry.acts_on)
        if key not in scores or scores[key].z < z:
            scores[key] = score
    return tuple(sorted(scores.values(), key=lambda score: -score.z))


def _most_telling(starts: Sequence[tuple[Entry, Effect]], observed: np.ndarray) -> Sequence[int]:
    """The places of the best starts of the best entries."""
    chosen: dict[str, int] = {}
    for place in np.argsort(-observed, kind="stable"):
        chosen.setdefault(starts[place][0].name, int(place))
        if len(chosen) == _PROJECTED:
            break
    return list(chosen.values())


class _Parts(NamedTuple):
    """Scores of each run, split into those of its level and those of what changes within it."""

    level: np.ndarray  # [probes, runs]
    within: np.ndarray  # [probes, runs]
    levels: np.ndarray  # [runs]: the level of each run in the residual
    outer: np.ndarray  # [probes, probes]: products of the probes' levels, summed over runs
    inner: np.ndarray  # [probes, probes]: products of what they change within runs
    variance: float  # of a point of the residual within its run


def _parts(flat: np.ndarray, residual: np.ndarray, setting: Setting) -> _Parts:
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
    return _Parts(level_scores, scores - level_scores, levels, outer, inner, variance)


def _observed(parts: _Parts) -> tuple[np.ndarray, np.ndarray, float]:
    """The scores of each probe over all runs, [probes, 1], and the energy of the runs' levels."""
    level, within = (scores.sum(axis=1, keepdims=True) for scores in (parts.level, parts.within))
    return level, within, float((parts.levels**2).sum())


def _excess(blocks: Sequence[np.ndarray], parts: _Parts, noise: _Parts) -> np.ndarray:
    """How much more the scores of the runs scatter than independent points would, [blocks].

    The correlation within runs is known only about. It is at least the variance of the points
    within their runs, where that is below one: noise taken from a misfit is wider than they are.
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
    parts: _Parts,
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
        # Directions that are nearly singular are left out.
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
    """Blocks of as many probes together: which, and the places of their Gram matrices."""
    sizes = np.array([block.size for block in blocks])
    for size in np.unique(sizes[sizes > 0]):
        some = np.flatnonzero(sizes == size)
        places = np.stack([block for block in blocks if block.size == size])
        yield some, places[:, :, None], places[:, None, :]


def telling(fitted: Fitted, probes: Sequence[Effect]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What each probe adds that the parameters of the model cannot, and the residual beside it.

    Which probes can be tested [probes]; their directions [points, probes], each of length one, zero
    for the others; the residual, data less prediction [points]. Points are those with weight,
    signals in units of the noise.
    """
    used = np.asarray(fitted.setting.noise.weight).ravel() > 0
    signals = in_noise_units(fitted.setting, _added(fitted, probes))
    flat = signals.reshape(len(probes), -1)[:, used].T
    jacobian = fitted.jacobian.reshape(fitted.jacobian.shape[0], -1)[:, used].T
    basis, upper = np.linalg.qr(jacobian / np.maximum(np.linalg.norm(jacobian, axis=0), 1e-300))
    basis = basis[:, np.abs(np.diag(upper)) > 1e-9]
    before = np.linalg.norm(flat, axis=0)
    flat = flat - basis @ (basis.T @ flat)
    left = np.linalg.norm(flat, axis=0)
    heard = (left > _SHARE_LEFT * before) & (before > 0) & np.isfinite(left)
    flat = np.where(heard, flat / np.where(heard, left, 1.0), 0.0)
    residual = -fitted.residual.ravel()[used]
    return heard, flat, residual - basis @ (basis.T @ residual)


def _added(fitted: Fitted, probes: Sequence[Effect]) -> np.ndarray:
    """What each probe adds to the prediction, [probes, runs, points].

    A term that bends the curve adds its function of the columns times the change of the prediction
    with a constant of that kind: to first order where no effect has a memory.
    """
    found = np.empty((len(probes), *fitted.adhesion.shape))
    others = [place for place, probe in enumerate(probes) if not isinstance(probe, ShapeTerm)]
    if others:
        found[others] = raw_changes(fitted, [probes[place] for place in others])
    if len(others) == len(probes):
        return found
    step = 1e-4
    constants = [Covariate(step, 0.0, 1.0, column="", acts_on=acts_on) for acts_on in ACTS_ON]
    changed = dict(zip(ACTS_ON, raw_changes(fitted, constants) / step, strict=True))
    for place, probe in enumerate(probes):
        if isinstance(probe, ShapeTerm):
            found[place] = changed[probe.acts_on] * _term(fitted.setting.problem, probe)
    return found


def _term(problem: Problem, probe: ShapeTerm) -> np.ndarray:
    """The function of the columns that a term is, [runs, points]; kept, for no fit changes it."""
    kind = type(probe)
    names = [getattr(probe, word) for word in words_of(kind)]
    numbers = {name: float(getattr(probe, name)) for name in kind.PARAMETERS}
    key = (kind, *names, *numbers.values())
    if key not in problem.terms:
        columns = [problem.data.columns[problem.columns.index(name)] for name in names]
        problem.terms[key] = np.asarray(_log_factor(kind, numbers, columns))
    return problem.terms[key]


@partial(jax.jit, static_argnums=0)
def _log_factor(
    kind: type[ShapeTerm],
    numbers: Mapping[str, Scalar],
    columns: Sequence[Float[Any, "runs points"]],
) -> Float[Array, "runs points"]:
    """The function of columns of a term of that kind, compiled once whatever they are called."""
    places = [str(place) for place in range(len(columns))]
    named: Mapping[str, Any] = {**numbers, **dict(zip(words_of(kind), places, strict=True))}
    return kind(**named).log_factor(dict(zip(places, columns, strict=True)))


def compile_changes(setting: Setting, base: str) -> None:
    """Compiles what `screen` needs, for data of this shape."""
    adhesion = np.asarray(setting.problem.data.adhesion)
    model = pack(base, [1.0] * len(BASES[base].free), (), (), *size_of(base, ()))
    models = jax.tree.map(lambda leaf: np.stack([leaf] * PROBES), model)
    jax.block_until_ready(changes(models, setting.problem.data, adhesion))


def _as_normal(chi_square: np.ndarray, freedom: np.ndarray) -> np.ndarray:
    """The normal deviate of the same upper tail, whatever the degrees of freedom; 0 for none.

    Where the tail is far, by the asymptotic series of the incomplete gamma function and that of
    the normal tail; else by the cube root of Wilson and Hilferty 1931.
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
