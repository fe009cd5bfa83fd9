"""Which cause would explain most of what is left: score tests of the whole library at once."""

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from scipy.special import gammaln

from adhesion_jax.discovery.effects import Effect
from adhesion_jax.discovery.fitting import Fitted, Setting, packed
from adhesion_jax.discovery.library import Entry
from adhesion_jax.discovery.program import PROBES, changes, whitened

#: A probe that keeps less than this share of itself beside the model cannot be told from it.
_SHARE_LEFT = 0.03

_FLIPS = 1999

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
    of whole runs, after the most telling start has been projected out of the residual, and the
    largest z over the library is compared: p is adjusted for everything that was looked at.
    """
    starts = [(entry, start) for entry in entries for start in entry.starts]
    probes, owner = [], []
    for place, (_, start) in enumerate(starts):
        for strength in start.STRENGTHS:
            others = {name: 0.0 for name in start.STRENGTHS if name != strength}
            probes.append(dataclasses.replace(start, **others))
            owner.append(place)
    heard, flat, residual = telling(setting, fitted, probes)

    owners = np.array(owner)
    blocks = [np.flatnonzero((owners == place) & heard) for place in range(len(starts))]
    along = _levels(setting)
    test = _Test(flat, blocks, along)
    observed = test.deviates(test.sums(residual, along), np.ones((along.run.max() + 1, 1)))[:, 0]
    block = flat[:, blocks[int(np.argmax(observed))]]
    if block.size:
        residual = residual - block @ np.linalg.lstsq(block, residual, rcond=None)[0]
    runs = along.run.max() + 1
    signs = np.random.default_rng([seed, 11]).choice([-1.0, 1.0], size=(runs, _FLIPS))
    largest = test.deviates(test.sums(residual, along), signs).max(axis=0)
    needed = float(np.quantile(largest, 1 - SIGNIFICANT))
    scores: dict[tuple[str, type], Score] = {}
    for (entry, start), z in zip(starts, observed, strict=True):
        p = (1 + np.sum(largest >= z)) / (1 + _FLIPS)
        score = Score(entry, start, float(z), float(p), needed)
        key = (entry.name, type(start))
        if key not in scores or scores[key].z < z:
            scores[key] = score
    return tuple(sorted(scores.values(), key=lambda score: -score.z))


class _Levels(NamedTuple):
    """The direction in which the level of each run acts, of length one in each run."""

    run: np.ndarray  # [points]
    direction: np.ndarray  # [points]


def _levels(setting: Setting) -> _Levels:
    weight = np.asarray(setting.noise.weight)
    flat_noise = setting.noise._replace(run_scatter=np.array(0.0))
    direction = np.asarray(whitened(flat_noise, setting.level, setting.level[None]))[0]
    size = np.sqrt((direction**2).sum(axis=1, keepdims=True))
    return _Levels(np.nonzero(weight > 0)[0], (direction / np.maximum(size, 1e-300))[weight > 0])


class _Sums(NamedTuple):
    """Scores of each run, [probes, runs]: of its level, and of what changes within it."""

    level: np.ndarray
    within: np.ndarray
    levels: np.ndarray  # [runs]: the level of each run in the residual


class _Test:
    """Likelihood ratios of blocks of probes, the variance of the levels of runs unknown.

    The residual is split into the level c of each run and the rest e. For a block of k probes with
    the least squares b its statistic is m ln(c'c/(c - A b)'(c - A b)) + e'e - (e - E b)'(e - E b),
    m = R - 1 - (k + 1)/2 after Bartlett 1937. Without the logarithm a cause that acts from run to
    run could explain no more than the number of runs, for the variance of the levels is estimated
    from the same residual.
    """

    def __init__(self, flat: np.ndarray, blocks: Sequence[np.ndarray], along: _Levels) -> None:
        self._flat = flat
        self._level_of_probe = np.stack(
            [np.bincount(along.run, weights=column * along.direction) for column in flat.T]
        )
        self._blocks = []
        for block in blocks:
            level = self._level_of_probe[block]
            outer = level @ level.T
            inner = flat[:, block].T @ flat[:, block] - outer
            self._blocks.append((block, _root(flat[:, block]), outer, inner))

    def sums(self, residual: np.ndarray, along: _Levels) -> _Sums:
        levels = np.bincount(along.run, weights=residual * along.direction)
        level = self._level_of_probe * levels
        whole = np.stack(
            [np.bincount(along.run, weights=column * residual) for column in self._flat.T]
        )
        return _Sums(level, whole - level, levels)

    def deviates(self, sums: _Sums, signs: np.ndarray) -> np.ndarray:
        """Normal deviates of every block under every choice of the signs of the runs."""
        level, within = sums.level @ signs, sums.within @ signs
        energy = float((sums.levels**2).sum())
        runs = int((np.abs(sums.levels) > 0).sum())
        found = []
        for block, root, outer, inner in self._blocks:
            freedom = root.shape[0]
            if freedom == 0:
                found.append(np.full(signs.shape[1], -np.inf))
                continue
            b = root.T @ (root @ (level[block] + within[block]))
            explained = 2 * (b * level[block]).sum(0) - (b * (outer @ b)).sum(0)
            left = np.clip(1 - explained / max(energy, 1e-300), 1e-12, None)
            rest = 2 * (b * within[block]).sum(0) - (b * (inner @ b)).sum(0)
            factor = max(runs - 1 - (freedom + 1) / 2, 1.0)
            statistic = rest - factor * np.log(left)
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


def _changes(setting: Setting, fitted: Fitted, probes: Sequence[Effect]) -> np.ndarray:
    """What each probe adds to the prediction, in units of the noise, [probes, runs, points]."""
    models = [packed(setting, fitted, (*fitted.effects, probe)) for probe in probes]
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


def _root(block: np.ndarray) -> np.ndarray:
    """W with W'W the inverse of block' block, its near-singular directions left out."""
    if block.shape[1] == 0:
        return np.zeros((0, 0))
    values, vectors = np.linalg.eigh(block.T @ block)
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
