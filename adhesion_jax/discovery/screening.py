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
from adhesion_jax.discovery.program import PROBES, changes

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
    whiteners = [_root(flat[:, block]) for block in blocks]
    run = np.nonzero(np.asarray(setting.noise.weight) > 0)[0]
    runs = int(run.max()) + 1

    def z_of(sums: np.ndarray) -> np.ndarray:
        """[starts, flips] from sums over points [probes, flips]."""
        return np.stack(
            [
                _as_normal(np.sum((root @ sums[block]) ** 2, axis=0), root.shape[0])
                for block, root in zip(blocks, whiteners, strict=True)
            ]
        )

    observed = z_of((flat.T @ residual)[:, None])[:, 0]
    best = int(np.argmax(observed))
    block = flat[:, blocks[best]]
    if blocks[best].size:
        residual = residual - block @ np.linalg.lstsq(block, residual, rcond=None)[0]
    by_run = np.stack(
        [np.bincount(run, weights=column * residual, minlength=runs) for column in flat.T]
    )
    signs = np.random.default_rng([seed, 11]).choice([-1.0, 1.0], size=(runs, _FLIPS))
    largest = z_of(by_run @ signs).max(axis=0)
    needed = float(np.quantile(largest, 1 - SIGNIFICANT))
    scores: dict[tuple[str, type], Score] = {}
    for (entry, start), z in zip(starts, observed, strict=True):
        p = (1 + np.sum(largest >= z)) / (1 + _FLIPS)
        score = Score(entry, start, float(z), float(p), needed)
        key = (entry.name, type(start))
        if key not in scores or scores[key].z < z:
            scores[key] = score
    return tuple(sorted(scores.values(), key=lambda score: -score.z))


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
