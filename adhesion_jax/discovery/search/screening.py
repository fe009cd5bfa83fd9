"""Score tests: whether any entry of the library explains what a model leaves."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc, ndtri

from adhesion_jax.discovery.model.fitting import has_room
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import Entry
from adhesion_jax.discovery.search.probes import Null, directions_of, firsts_of, split
from adhesion_jax.effects import Effect, Spline

#: Number of random sign flips of the runs that the null distribution is drawn from.
FLIPS = 1999

#: Directions of an entry whose own part is shorter than this are left out.
_OWN = 0.05

#: Number of the smoothest directions of a spline that are also tested alone.
_SMOOTHEST = 2

#: Fewest runs, as many of equal share, that must carry what is told of the directions of an entry
#: in the mean, and of each. By hand.
_FEWEST_RUNS, _FEWEST_RUNS_ALONE = 4.0, 2.0

#: The tail by which deviates are scaled, and the least deviate that it is taken to have.
_TAIL, _LEAST_TAIL = 0.005, 1.0

#: What an entry would gain is worked out if its own p is at most this.
_SURE = 0.02

#: Amounts of shrinking that are tried.
_RIDGES = (0.02, 0.2, 1.0)

#: Deviates that differ by less are the same.
_ROUNDING = 1e-6

#: Largest number of probes that are held at a time.
_TOGETHER = 800

#: Values of the statistic between which its deviates are interpolated.
_GRID = np.concatenate([[0.0], np.geomspace(1e-2, 1e5, 240)])

#: A form of an entry: the name of the entry, the kind of effect, the part of the curve it acts on.
Form = tuple[str, type, str]


def least_p(runs: int) -> float:
    """The smallest p that signs of so many runs can show: one of the draws, or of the patterns.

    There are 2^(runs - 1) patterns of signs, for those that are all opposite tell the same.
    """
    return max(1 / (1 + FLIPS), 0.5 ** (runs - 1))


class Score(NamedTuple):
    """How surely one form of an entry explains a part of a residual, before any refit."""

    entry: Entry
    start: Effect
    z: float  # of its statistic, as a standard normal deviate
    p: float  # adjusted for the whole library by sign flips of runs
    own_p: float  # by the same flips, of this form alone
    needed: float  # the z whose adjusted p is that of acceptance
    gains: np.ndarray  # [runs]: what it would gain on each run, fitted to the others; 0 if not sure
    change: np.ndarray  # [points]: what it would change, in units of the noise; () if not sure

    @property
    def form(self) -> Form:
        return self.entry.name, type(self.start), self.entry.acts_on


class _Tested(NamedTuple):
    starts: list[tuple[Entry, Effect]]
    z: np.ndarray  # [starts]
    own: np.ndarray  # [starts]: the share of flips in which its own z reaches that of the data
    largest: np.ndarray  # [flips]: the largest z of any start
    gains: list[np.ndarray]  # [starts]
    changes: list[np.ndarray]  # [starts]


def screen(parts: Sequence[tuple[Null, Sequence[Entry]]], seed: int) -> tuple[Score, ...]:
    """The best start of each form of an entry, the largest z first.

    Each part are entries with what is given where they are tested; p is adjusted for all parts.

    A wild cluster bootstrap of the score (Cameron, Gelbach and Miller 2008, Rev. Econ. Stat. 90,
    414-427). With everything given projected out, the probes of a start are made orthonormal, x_j.
    b_j = sum over runs of u_rj, u_rj = sum over the points of a run of x_j e; its variance is
    R/(R - 1) sum of (u_rj - g_rj b_j)^2, g_rj = sum of x_j^2. F is the sum of b^2 over the sum of
    the variances, and z the normal deviate of F with as many degrees of freedom as the runs that
    carry the probe allow, scaled so that .5 % of the z of each start are beyond 2.58 under random
    signs of the residuals of the runs, all of a run alike. p is by the largest z of all starts
    under the same signs (Romano and Wolf 2005, Econometrica 73, 1237-1282).
    """
    largest = np.full(FLIPS, -np.inf)
    tested: list[_Tested] = []
    for null, entries in parts:
        starts = [
            (entry, start)
            for entry in entries
            for start in entry.starts
            if has_room(null.fitted.effects, start)
        ]
        for group in _groups(starts):
            one = _tested(null, group, seed)
            largest = np.maximum(largest, one.largest)
            tested.append(one)
    if not any(one.starts for one in tested):
        return ()
    # Signs that are all alike give the data again, up to rounding.
    largest = largest + _ROUNDING
    needed = float(np.quantile(largest, 1 - rules.SIGNIFICANT))
    least = least_p(parts[0][0].fitted.setting.problem.runs)
    scores: dict[Form, Score] = {}
    for one in tested:
        told = zip(one.starts, one.z, one.own, one.gains, one.changes, strict=True)
        for (entry, start), z, own, gains, change in told:
            p = max((1 + np.sum(largest >= z)) / (1 + FLIPS), least)
            score = Score(entry, start, float(z), float(p), float(own), needed, gains, change)
            old = scores.get(score.form)
            if old is None or (old.gains.sum(), old.z) < (gains.sum(), z):
                scores[score.form] = score
    return tuple(sorted(scores.values(), key=lambda score: -score.z))


def _groups(
    starts: Sequence[tuple[Entry, Effect]],
) -> list[list[tuple[Entry, Effect]]]:
    """The starts in groups of a bounded number of probes."""
    groups: list[list[tuple[Entry, Effect]]] = [[]]
    count = 0
    for one in starts:
        count += len(one[1].STRENGTHS)
        if count > _TOGETHER and groups[-1]:
            groups.append([])
            count = len(one[1].STRENGTHS)
        groups[-1].append(one)
    return groups


def _tested(null: Null, starts: Sequence[tuple[Entry, Effect]], seed: int) -> _Tested:
    probes, owner = split([start for _, start in starts])
    testable, flat = directions_of(null, probes)
    blocks, places = [], []
    ends = firsts_of(null)
    for place in range(len(starts)):
        own = np.flatnonzero((owner == place) & testable)
        block = orthonormal(flat[:, own])
        # What rests on a few runs is not tested: random signs of so few say nothing.
        shares = np.add.reduceat(block**2, ends, axis=0)
        carried = 1 / np.maximum((shares**2).sum(axis=0), 1e-300)
        block = block[:, carried >= _FEWEST_RUNS_ALONE]
        if not block.shape[1] or float(carried.mean()) < _FEWEST_RUNS:
            continue
        forms = [block]
        if block.shape[1] > _SMOOTHEST and isinstance(starts[place][1], Spline):
            forms.append(block[:, :_SMOOTHEST])
        # Of a surface the plain product of both columns, too.
        forms += [flat[:, [one]] for one in own if getattr(probes[one], "k11", 0) != 0]
        blocks += forms
        places += [place] * len(forms)
    if not blocks:
        return _Tested([], np.zeros(0), np.zeros(0), np.full(FLIPS, -np.inf), [], [])
    first = np.cumsum([0, *(block.shape[1] for block in blocks[:-1])])
    x = np.concatenate(blocks, axis=1)
    u = np.add.reduceat(x * null.residual[:, None], ends, axis=0)
    g = np.add.reduceat(x**2, ends, axis=0)
    runs = ends.size
    count = np.diff(first, append=x.shape[1])
    carrying = np.add.reduceat(1 / (g**2).sum(axis=0), first) / count
    freedom = np.maximum(carrying - 1, 1.0) * np.sqrt(count)

    def deviates(b: np.ndarray, crossed: np.ndarray) -> np.ndarray:
        """Z of sums b [directions, choices]; `crossed` are the sums of u g with the same signs."""
        whole = (u**2).sum(axis=0)[:, None] - 2 * b * crossed
        variance = np.maximum(whole + b**2 * (g**2).sum(axis=0)[:, None], 0.0) * runs / (runs - 1)
        over = np.maximum(np.add.reduceat(variance, first, axis=0), 1e-300)
        statistic = np.add.reduceat(b**2, first, axis=0) / over
        z = np.empty_like(statistic)
        for place, (k, nu) in enumerate(zip(count, freedom, strict=True)):
            tail = np.clip(fdtrc(k, nu, _GRID), 1e-300, 1 - 1e-12)
            z[place] = np.interp(statistic[place], _GRID, -ndtri(tail))
        return z

    signs = np.random.default_rng([seed, 11]).choice([-1.0, 1.0], size=(runs, FLIPS))
    observed = deviates(u.sum(axis=0)[:, None], (u * g).sum(axis=0)[:, None])
    flipped = deviates(u.T @ signs, (u * g).T @ signs)
    # Starts of few runs or many probes have other tails: all are brought to that of a normal one.
    tail = np.quantile(flipped, 1 - _TAIL, axis=1, keepdims=True)
    scale = -ndtri(_TAIL) / np.maximum(tail, _LEAST_TAIL)
    observed, flipped = observed * scale, flipped * scale
    own = (1 + np.sum(flipped + _ROUNDING >= observed, axis=1)) / (1 + FLIPS)
    kept = [starts[place] for place in places]
    nothing = np.zeros(runs), np.zeros(0)
    told = [
        _gained(block, null.residual, ends) if sure <= _SURE else nothing
        for block, sure in zip(blocks, own, strict=True)
    ]
    gains, changes = [one for one, _ in told], [change for _, change in told]
    return _Tested(kept, observed[:, 0], own, flipped.max(axis=0), gains, changes)


def _gained(x: np.ndarray, residual: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What orthonormal probes gain in log likelihood on each run, and what they change.

    The coefficients for a run are those of the other runs, shrunk by that one of `_RIDGES` with
    which the gain is largest: b_r = ((1 + ridge) I - X_r'X_r)^-1 (sum of X's' e_s - X_r' e_r).
    """
    scores = np.add.reduceat(x * residual[:, None], ends, axis=0)
    squares = np.add.reduceat(x[:, :, None] * x[:, None, :], ends, axis=0)
    whole = scores.sum(axis=0)
    eye = np.eye(x.shape[1])
    best: tuple[np.ndarray, np.ndarray] | None = None
    for ridge in _RIDGES:
        others = (1 + ridge) * eye - squares
        b = np.linalg.solve(others, (whole - scores)[:, :, None])[:, :, 0]
        gains = (b * scores).sum(axis=1) - 0.5 * np.einsum("rk,rkl,rl->r", b, squares, b)
        if best is None or gains.sum() > best[0].sum():
            best = gains, x @ (whole / (1 + ridge))
    assert best is not None
    return best


def orthonormal(flat: np.ndarray) -> np.ndarray:
    """Orthonormal directions of the columns [points, columns], what they share first.

    Those of a spline are about a line, a parabola and so on.
    """
    if not flat.shape[1]:
        return flat
    basis, sizes, _ = np.linalg.svd(flat, full_matrices=False)
    return basis[:, sizes > _OWN]
