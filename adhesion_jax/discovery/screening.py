"""Which cause would explain most of what is left: score tests of the whole library at once."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from scipy.special import gammaln

from adhesion_jax.discovery.effects import Effect
from adhesion_jax.discovery.fitting import Fitted, Setting, packed, size_of
from adhesion_jax.discovery.law import BASES
from adhesion_jax.discovery.library import Entry
from adhesion_jax.discovery.program import PROBES, changes, pack, whitened

#: A probe that keeps less than this share of itself beside the model cannot be told from it.
_SHARE_LEFT = 0.03

_FLIPS = 1999

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


def screen(
    setting: Setting, fitted: Fitted, entries: Sequence[Entry], seed: int
) -> tuple[Score, ...]:
    """The best start of each entry, the most telling first.

    Each start is switched on a little, strength by strength; what that changes, with the model's
    own Jacobian projected out, is held against the residual. Significance is by flipping the signs
    of whole runs, after the most telling entries have been projected out of the residual (what is
    really there would else be taken for noise), and the largest z over the library is compared: p
    is adjusted for everything that was looked at.
    """
    starts = [(entry, start) for entry in entries for start in entry.starts]
    probes, owner = [], []
    for place, (_, start) in enumerate(starts):
        for strength in start.STRENGTHS:
            others = {name: 0.0 for name in start.STRENGTHS if name != strength}
            probes.append(dataclasses.replace(start, **others))
            owner.append(place)
    if not probes:
        return ()
    heard, flat, residual = telling(setting, fitted, probes)

    owners = np.array(owner)
    blocks = [np.flatnonzero((owners == place) & heard) for place in range(len(starts))]
    parts = _parts(flat, residual, setting)
    first = _deviates(blocks, parts, np.ones((parts.levels.size, 1)), None)[:, 0]
    block = flat[:, np.concatenate([blocks[place] for place in _most_telling(starts, first)])]
    left = residual
    if block.size:
        left = residual - block @ np.linalg.lstsq(block, residual, rcond=1e-3)[0]
    noise = _parts(flat, left, setting)
    observed = _deviates(blocks, parts, np.ones((parts.levels.size, 1)), noise)[:, 0]
    signs = np.random.default_rng([seed, 11]).choice([-1.0, 1.0], size=(noise.levels.size, _FLIPS))
    largest = _deviates(blocks, noise, signs, noise).max(axis=0)
    needed = float(np.quantile(largest, 1 - SIGNIFICANT))
    scores: dict[tuple[str, type], Score] = {}
    for (entry, start), z, block in zip(starts, observed, blocks, strict=True):
        if not block.size:
            continue
        p = (1 + np.sum(largest >= z)) / (1 + _FLIPS)
        score = Score(entry, start, float(z), float(p), needed)
        key = (entry.name, type(start))
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
    level = np.asarray(whitened(unlevelled, setting.level, setting.level[None]))[0]
    if setting.problem.blocks:
        level = np.zeros_like(level)  # blocks of one run have no level of their own
    size = np.sqrt((level**2).sum(axis=1, keepdims=True))
    direction = (level / np.maximum(size, 1e-300))[weight > 0]
    run = np.nonzero(weight > 0)[0]

    def by_run(columns: np.ndarray) -> np.ndarray:
        ends = np.flatnonzero(np.diff(run, prepend=-1))
        return np.add.reduceat(columns, ends, axis=0).T

    probe_levels = by_run(flat * direction[:, None])
    levels = by_run(residual[:, None] * direction[:, None])[0]
    level_scores = probe_levels * levels
    scores = by_run(flat * residual[:, None])
    outer = probe_levels @ probe_levels.T
    variance = float(residual @ residual - levels @ levels) / max(residual.size - levels.size, 1)
    inner = flat.T @ flat - outer
    return _Parts(level_scores, scores - level_scores, levels, outer, inner, variance)


def _deviates(
    blocks: Sequence[np.ndarray], parts: _Parts, signs: np.ndarray, noise: _Parts | None
) -> np.ndarray:
    """Likelihood ratios of blocks of probes as normal deviates, [blocks, choices of signs].

    With the level c of each run, what changes within runs e, and the least squares b of a block
    of k probes, the statistic is m ln(c'c/(c - A b)'(c - A b)) + (e'e - (e - E b)'(e - E b))/v.
    The variance of the levels is unknown: m = R - 1 - (k + 1)/2 after Bartlett 1937. (Against a
    fixed variance, estimated from the same residual, a cause that acts from run to run could
    explain no more than the number of runs.) v is how much more the scores of the runs in `noise`
    scatter than independent points would, for the correlation within runs is known only about. It
    is at least the variance of the points within their runs, where that is below one: noise taken
    from a misfit is wider than they are.
    """
    level, within = parts.level @ signs, parts.within @ signs
    energy = max(float((parts.levels**2).sum()), 1e-300)
    found = []
    for block in blocks:
        outer, inner = parts.outer[np.ix_(block, block)], parts.inner[np.ix_(block, block)]
        if noise is not None and block.size:
            scatter = noise.within[block] @ noise.within[block].T
            excess = np.trace(np.linalg.pinv(inner, rcond=1e-3, hermitian=True) @ scatter)
            excess = max(float(excess) / block.size, min(noise.variance, 1.0))
        else:
            excess = 1.0
        root = _root(outer + inner / excess)
        freedom = root.shape[0]
        if freedom == 0:
            found.append(np.zeros(signs.shape[1]))
            continue
        b = root.T @ (root @ (level[block] + within[block] / excess))
        explained = 2 * (b * level[block]).sum(0) - (b * (outer @ b)).sum(0)
        rest = 2 * (b * within[block]).sum(0) - (b * (inner @ b)).sum(0)
        factor = max(parts.levels.size - 1 - (freedom + 1) / 2, 1.0)
        kept = np.clip(1 - explained / energy, 1e-12, None)
        statistic = rest / excess - factor * np.log(kept)
        found.append(_as_normal(np.maximum(statistic, 0.0), freedom))
    return np.stack(found)


def telling(
    setting: Setting, fitted: Fitted, probes: Sequence[Effect]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What each probe adds that the parameters of the model cannot, and the residual beside it.

    Which probes are heard at all [probes]; their directions [points, probes], each of length one,
    zero where not heard; the residual, data less prediction [points]. Points are those with weight,
    signals in units of the noise.
    """
    used = np.asarray(setting.noise.weight).ravel() > 0
    flat = _changes(setting, fitted, probes).reshape(len(probes), -1)[:, used].T
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


def compile_changes(setting: Setting, base: str) -> None:
    """Compiles what `screen` needs, for data of this shape."""
    adhesion = np.asarray(setting.problem.data.adhesion)
    model = pack(base, [1.0] * len(BASES[base].free), (), (), *size_of(base, ()))
    models = jax.tree.map(lambda leaf: np.stack([leaf] * PROBES), model)
    jax.block_until_ready(
        changes(models, setting.problem.data, setting.noise, setting.level, adhesion)
    )


def _changes(setting: Setting, fitted: Fitted, probes: Sequence[Effect]) -> np.ndarray:
    """What each probe adds to the prediction, in units of the noise, [probes, runs, points]."""
    size = max(size_of(fitted.base, (*fitted.effects, probe)) for probe in probes)
    models = [packed(setting, fitted, (*fitted.effects, probe), size) for probe in probes]
    found = []
    for first in range(0, len(models), PROBES):
        some = models[first : first + PROBES]
        padded = some + [some[0]] * (PROBES - len(some))
        stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *padded)
        change = changes(
            stacked, setting.problem.data, setting.noise, setting.level, fitted.adhesion
        )
        found.append(np.asarray(change)[: len(some)])
    return np.concatenate(found)


def _root(gram: np.ndarray) -> np.ndarray:
    """W with W'W the inverse of a Gram matrix, its near-singular directions left out."""
    if gram.shape[1] == 0:
        return np.zeros((0, 0))
    values, vectors = np.linalg.eigh(gram)
    kept = values > 1e-3 * values.max()
    return (vectors[:, kept] / np.sqrt(values[kept])).T


def _as_normal(chi_square: np.ndarray, freedom: int) -> np.ndarray:
    """The normal deviate of the same upper tail, whatever the degrees of freedom.

    Where the tail is far, by the asymptotic series of the incomplete gamma function and that of
    the normal tail; else by the cube root of Wilson and Hilferty 1931.
    """
    if freedom == 0:
        return np.full(chi_square.shape, -np.inf)
    half, shape = np.maximum(chi_square, 1e-9) / 2, freedom / 2
    spread = 2 / (9 * freedom)
    near = ((chi_square / freedom) ** (1 / 3) - 1 + spread) / np.sqrt(spread)
    far = chi_square > 2 * freedom + 6
    shortened = np.log1p(-np.where(far, (shape - 1) / half, 0.0))
    log_tail = -half + (shape - 1) * np.log(half) - gammaln(shape) - shortened
    double = np.maximum(-2 * log_tail, 1.0)
    deviate = np.sqrt(np.maximum(double - np.log(2 * np.pi * double), 0.0))
    deviate = np.sqrt(np.maximum(double - np.log(2 * np.pi * np.maximum(deviate, 1.0) ** 2), 0.0))
    return np.where(far, deviate, near)
