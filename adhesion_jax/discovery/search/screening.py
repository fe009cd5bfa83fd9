"""Score tests: whether any entry of the library explains what a model leaves."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc, ndtri

from adhesion_jax.discovery.model.fitting import has_room
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import Entry
from adhesion_jax.discovery.search.probes import Null, directions_of, firsts_of_runs, split
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

#: Least share of a run's score that is taken to be left beside what is given.
_LEAST_LEFT = 0.1

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


def adjusted(z: float, largest: np.ndarray, runs: int) -> float:
    """The p of z among the `largest` of all that is looked at under random signs, [FLIPS]."""
    # Signs that are all alike give the data again, up to rounding.
    return max((1 + int(np.sum(largest + _ROUNDING >= z))) / (1 + FLIPS), least_p(runs))


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

    Each part are entries with what is given where they are tested; p is adjusted for all parts, and
    the smallest of a form is taken.

    A wild cluster bootstrap of the score (Cameron, Gelbach and Miller 2008, Rev. Econ. Stat. 90,
    414-427). With everything given projected out, the probes of a start are made orthonormal, X.
    b = sum over runs of u_r, u_r = X_r' e_r over the points of a run; the sum of its variances is
    R/(R - 1) times that of |u_r - X_r' X_r b|^2, so that an effect does not hide itself. In it and
    under random signs u_r is enlarged by 1/sqrt(1 - h), h the share of the probe of the run that is
    given: a fit makes residuals small where it leans on them (Bell and McCaffrey 2002, Survey
    Methodology 28, 169-181). F is |b|^2 over it, and z the normal deviate of F with as many degrees
    of freedom as the runs that carry the probe allow, scaled so that .5 % of the z of each start
    are beyond 2.58 under random signs of the residuals of the runs, all of a run alike. p is by the
    largest z of all starts under the same signs (Romano and Wolf 2005, Econometrica 73, 1237-1282).

    Where stretches of the runs take their place, the variance of the data is that by whole runs if
    that is larger: if runs differ in more than their levels, stretches of one do not err alone.
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
    needed = float(np.quantile(largest, 1 - rules.SIGNIFICANT))
    runs = parts[0][0].fitted.setting.problem.runs
    scores: dict[Form, Score] = {}
    for one in tested:
        told = zip(one.starts, one.z, one.own, one.gains, one.changes, strict=True)
        for (entry, start), z, own, gains, change in told:
            p = adjusted(float(z), largest, runs)
            score = Score(entry, start, float(z), p, float(own), needed, gains, change)
            old = scores.get(score.form, score)
            best = score if (old.gains.sum(), old.z) < (gains.sum(), z) else old
            z, p, own = max(old.z, score.z), min(old.p, score.p), min(old.own_p, score.own_p)
            scores[score.form] = best._replace(z=z, p=p, own_p=own)
    return tuple(sorted(scores.values(), key=lambda score: -score.z))


def _groups(
    starts: Sequence[tuple[Entry, Effect]],
) -> list[list[tuple[Entry, Effect]]]:
    """The starts in groups of a bounded number of probes."""
    groups: list[list[tuple[Entry, Effect]]] = [[]]
    count = 0
    for one in starts:
        count += len(one[1].FACTS.strengths)
        if count > _TOGETHER and groups[-1]:
            groups.append([])
            count = len(one[1].FACTS.strengths)
        groups[-1].append(one)
    return groups


def _tested(null: Null, starts: Sequence[tuple[Entry, Effect]], seed: int) -> _Tested:
    probes, owner = split([start for _, start in starts])
    testable, flat = directions_of(null, probes)
    blocks, places = [], []
    ends = null.firsts
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
    z, sure, largest = signed(null, blocks, seed)
    kept = [starts[place] for place in places]
    whole_runs = firsts_of_runs(null.inside)
    nothing = np.zeros(whole_runs.size), np.zeros(0)
    told = [
        _gained(block, null.residual, whole_runs) if p <= _SURE else nothing
        for block, p in zip(blocks, sure, strict=True)
    ]
    gains, changes = [one for one, _ in told], [change for _, change in told]
    return _Tested(kept, z, sure, largest, gains, changes)


def signed(
    null: Null, blocks: Sequence[np.ndarray], seed: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The z of blocks of orthonormal probes [points, directions], by the statistic of `screen`.

    Returns z [blocks]; the share of random signs under which the z of a block reaches it [blocks];
    and the largest z of any block under each choice of signs [FLIPS].
    """
    ends, whole_runs = null.firsts, firsts_of_runs(null.inside)
    of_runs = np.searchsorted(ends, whole_runs)
    first = np.cumsum([0, *(block.shape[1] for block in blocks[:-1])])
    x = np.concatenate(blocks, axis=1)
    b = null.residual @ x
    g = np.add.reduceat(x**2, ends, axis=0)
    u = np.add.reduceat(x * null.residual[:, None], ends, axis=0)
    given = _given(null.basis, x, ends) / np.maximum(g, 1e-300)
    u /= np.sqrt(np.maximum(1 - given, _LEAST_LEFT))
    count = np.diff(first, append=x.shape[1])
    ranges = [slice(at, at + k) for at, k in zip(first, count, strict=True)]
    crosses, squares, left = [], [], []
    for block, some in zip(blocks, ranges, strict=True):
        products = np.add.reduceat(block[:, :, None] * block[:, None, :], ends, axis=0)
        crosses.append(np.einsum("rkl,rl->rk", products, u[:, some]))
        squares.append(np.einsum("rkl,rlm->km", products, products))
        of_run = np.add.reduceat(u[:, some] - products @ b[some], of_runs, axis=0)
        left.append(float(np.sum(of_run**2)))
    crossed_runs = np.concatenate(crosses, axis=1)

    def variances(b: np.ndarray, crossed: np.ndarray) -> np.ndarray:
        """Those of sums b [directions, choices]; `crossed` are those of X'X u with their signs."""
        whole = np.add.reduceat((u**2).sum(axis=0)[:, None] - 2 * b * crossed, first, axis=0)
        made = [
            np.sum(b[some] * (s @ b[some]), axis=0) for s, some in zip(squares, ranges, strict=True)
        ]
        return np.maximum(whole + np.stack(made), 1e-300) * ends.size / (ends.size - 1)

    def deviates(b: np.ndarray, variance: np.ndarray, freedom: np.ndarray) -> np.ndarray:
        """Z of sums b by their variances [blocks, choices], known with that freedom [blocks]."""
        statistic = np.add.reduceat(b**2, first, axis=0) / variance
        z = np.empty_like(statistic)
        for place, (k, nu) in enumerate(zip(count, freedom, strict=True)):
            tail = np.clip(fdtrc(k, nu, _GRID), 1e-300, 1 - 1e-12)
            z[place] = np.interp(statistic[place], _GRID, -ndtri(tail))
        return z

    def freedom_of(shares: np.ndarray) -> np.ndarray:
        """The freedom of a variance by clusters with these shares of the directions, [blocks]."""
        carrying = np.add.reduceat(1 / (shares**2).sum(axis=0), first) / count
        return np.maximum(carrying - 1, 1.0) * np.sqrt(count)

    freedom = freedom_of(g)
    signs = np.random.default_rng([seed, 11]).choice([-1.0, 1.0], size=(ends.size, FLIPS))
    flipped = u.T @ signs
    flipped = deviates(flipped, variances(flipped, crossed_runs.T @ signs), freedom)
    # What whole runs scatter beyond their stretches is a variance of its own: Satterthwaite 1946,
    # Biometrics Bulletin 2, 110-114.
    variance = variances(b[:, None], crossed_runs.sum(axis=0)[:, None])[:, 0]
    more = np.maximum(np.array(left) * whole_runs.size / (whole_runs.size - 1) - variance, 0.0)
    unsure = variance**2 / freedom + more**2 / freedom_of(np.add.reduceat(g, of_runs, axis=0))
    observed = deviates(b[:, None], (variance + more)[:, None], (variance + more) ** 2 / unsure)
    # Starts of few runs or many probes have other tails: all are brought to that of a normal one.
    tail = np.quantile(flipped, 1 - _TAIL, axis=1, keepdims=True)
    scale = -ndtri(_TAIL) / np.maximum(tail, _LEAST_TAIL)
    observed, flipped = observed * scale, flipped * scale
    sure = (1 + np.sum(flipped + _ROUNDING >= observed, axis=1)) / (1 + FLIPS)
    return observed[:, 0], sure, flipped.max(axis=0)


def _given(basis: np.ndarray, x: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """The squared length of what is given of the probe of each run, [runs, directions]."""
    parts = np.split(np.arange(len(x)), ends[1:])
    return np.stack([((basis[part].T @ x[part]) ** 2).sum(axis=0) for part in parts])


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
