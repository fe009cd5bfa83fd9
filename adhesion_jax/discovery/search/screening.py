"""Score tests: whether any entry of the library explains what a model leaves."""

from collections.abc import Sequence
from functools import cache, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc, fdtrc, ndtr, ndtri

from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import Entry
from adhesion_jax.discovery.search.probes import (
    Null,
    beside_given,
    firsts_of_runs,
    of_hidden_curves,
    signals,
    split,
    stretches,
)
from adhesion_jax.effects import Effect, Spline
from adhesion_jax.effects.dynamic import Lagging

#: Number of random choices of signs under which all that is looked at is compared.
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

#: A start whose deviate by signs is at most this is not looked at more closely. Of 20,000 starts of
#: eight searches these were 75 %, and the largest z of any of them was 2.4.
_ORDINARY = 1.0

#: What an entry would gain is worked out if its own p is at most this.
_SURE = 0.02

#: Least share of a run's score that is taken to be left beside what is given.
_LEAST_LEFT = 0.1

#: Amounts of shrinking that are tried.
_RIDGES = (0.02, 0.2, 1.0)

#: Largest number of probes that are held at a time.
_TOGETHER = 800

#: Values of the statistic between which its deviates are interpolated.
_GRID = np.concatenate([[0.0], np.geomspace(1e-2, 1e5, 240)])

#: A form of an entry: the name of the entry, the kind of effect, the part of the curve it acts on.
Form = tuple[str, type, str]


def least_p(runs: int) -> float:
    """The smallest p that is told of so many runs: one of the draws, or of the signs of the runs.

    There are 2^(runs - 1) patterns of signs, for those that are all opposite tell the same. What a
    test says beyond them rests on the normal tails of so few errors.
    """
    return max(1 / (1 + FLIPS), 0.5 ** (runs - 1))


def adjusted(z: float, largest: np.ndarray, runs: int) -> float:
    """The p of z among the `largest` of all that is looked at under random signs, [FLIPS]."""
    return max((1 + int(np.sum(largest >= z))) / (1 + FLIPS), least_p(runs))


class Score(NamedTuple):
    """How surely one form of an entry explains a part of a residual, before any refit."""

    entry: Entry
    start: Effect
    z: float  # of its statistic, as a standard normal deviate
    p: float  # adjusted for the whole library by random signs
    needed: float  # the z whose adjusted p is that of acceptance
    gains: np.ndarray  # [runs]: what it would gain on each run, fitted to the others; 0 if not sure
    change: np.ndarray  # [points]: what it would change, in units of the noise; () if not sure

    @property
    def form(self) -> Form:
        return self.entry.name, type(self.start), self.entry.acts_on


def screen(parts: Sequence[tuple[Sequence[Null], Sequence[Entry]]], seed: int) -> tuple[Score, ...]:
    """The best start of each form of an entry, the largest z first.

    Each part are entries with all that is given where they are tested, for one model; p is adjusted
    for all parts, and the smallest of a form is taken.

    With everything given projected out, the probes of a start are made orthonormal, X. The score of
    a run is u_r = X_r' e_r over its points, and b their sum. F is |b|^2 over the variance that the
    u_r - X_r'X_r b show, so that an effect does not hide itself; a fit makes them small where it
    leans on a run, for which they are enlarged, and which takes degrees of freedom (Bell and
    McCaffrey 2002, Survey Methodology 28, 169-181). z is the normal deviate of F. It holds for any
    noise within runs, if runs are independent.

    p is by the largest z of all starts under random signs (Romano and Wolf 2005, Econometrica 73,
    1237-1282). The signs are of stretches, which are many even where runs are few, and z is that of
    |b|^2 alone, scaled so that .5 % of those of each start are beyond 2.58: the signs tell how much
    alike the starts are, and not how sure one of them is.

    What is tested within runs is held against the scatter of stretches of them.
    """
    largest = np.full(FLIPS, -np.inf)
    tested: list[Score] = []
    for nulls, entries in parts:
        starts = [(entry, start) for entry in entries for start in entry.starts]
        for group in _groups(starts):
            probes, owner = split([start for _, start in group])
            changes = signals(nulls[0], probes)
            for null in nulls:
                some, of_signs = _tested(null, group, probes, owner, changes, seed)
                largest = np.maximum(largest, of_signs)
                tested += some
    if not tested:
        return ()
    needed = float(np.quantile(largest, 1 - rules.SIGNIFICANT))
    runs = parts[0][0][0].fitted.setting.problem.runs
    scores: dict[Form, Score] = {}
    for one in tested:
        score = one._replace(p=adjusted(one.z, largest, runs), needed=needed)
        old = scores.get(score.form, score)
        best = score if (old.gains.sum(), old.z) < (score.gains.sum(), score.z) else old
        scores[score.form] = best._replace(z=max(old.z, score.z), p=min(old.p, score.p))
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


def _tested(
    null: Null,
    starts: Sequence[tuple[Entry, Effect]],
    probes: list[Effect],
    owner: np.ndarray,
    changes: np.ndarray,
    seed: int,
) -> tuple[list[Score], np.ndarray]:
    """The starts before their p is known, and the largest z of any of them by signs, [FLIPS].

    `probes` are those of the starts by their place, `owner`, with their `changes` [points, probes].
    """
    testable, flat = beside_given(null, changes)
    blocks, places = [], []
    ends = firsts_of_runs(null.inside)
    for place, (_, start) in enumerate(starts):
        own = np.flatnonzero((owner == place) & testable)
        block = orthonormal(flat[:, own])
        # What rests on a few runs is not tested: so few do not say how much they scatter.
        shares = np.add.reduceat(block**2, ends, axis=0)
        carried = 1 / np.maximum((shares**2).sum(axis=0), 1e-300)
        block = block[:, carried >= _FEWEST_RUNS_ALONE]
        if not block.shape[1] or float(carried.mean()) < _FEWEST_RUNS:
            continue
        forms = [block]
        if block.shape[1] > _SMOOTHEST and isinstance(start, Spline):
            forms.append(block[:, :_SMOOTHEST])
        if isinstance(start, Lagging):
            forms.append(orthonormal(of_hidden_curves(null, start)))
        # Of a surface the plain product of both columns, too.
        forms += [flat[:, [one]] for one in own if getattr(probes[one], "k11", 0) != 0]
        forms = [form for form in forms if form.shape[1]]
        blocks += forms
        places += [place] * len(forms)
    if not blocks:
        return [], np.full(FLIPS, -np.inf)
    z, largest = signed(null, blocks, seed)
    nothing = np.zeros(ends.size), np.zeros(0)
    found = []
    for place, block, one in zip(places, blocks, z.tolist(), strict=True):
        told = _gained(block, null.residual, ends) if ndtr(-one) <= _SURE else nothing
        found.append(Score(*starts[place], one, np.nan, np.nan, *told))
    return found, largest


def signed(null: Null, blocks: Sequence[np.ndarray], seed: int) -> tuple[np.ndarray, np.ndarray]:
    """The z of blocks of orthonormal probes [points, directions], by the statistic of `screen`.

    That of a block whose |b|^2 is ordinary among those under random signs is the deviate of it
    there. Returns z [blocks], and the largest z of any block under each choice of signs [FLIPS].
    """
    counts = np.array([block.shape[1] for block in blocks])
    firsts = np.cumsum(counts) - counts
    pulled = np.concatenate(blocks, axis=1) * null.residual[:, None]
    pieces = np.add.reduceat(pulled, stretches(null, 0.0), axis=0)
    variance = np.maximum((pieces**2).sum(axis=0), 1e-300)
    own = np.add.reduceat(pieces.sum(axis=0) ** 2 / variance, firsts)
    z = -ndtri(np.clip(chdtrc(counts, own), 1e-300, 1 - 1e-12))
    followed = np.flatnonzero(z > _ORDINARY)
    if followed.size:
        z[followed] = _deviates_of(null, [blocks[place] for place in followed.tolist()])
    signs = np.random.default_rng([seed, 11]).choice([-1.0, 1.0], size=(len(pieces), FLIPS))
    squares = pieces.T @ signs
    squares *= squares
    squares /= variance[:, None]
    flipped = np.add.reduceat(squares, firsts, axis=0)
    for one, count in zip(flipped, counts.tolist(), strict=True):
        one[:] = np.interp(one, _GRID, _deviates(count))
    # Of signs the tails are not quite those of a normal deviate: all are brought to them.
    tail = np.quantile(flipped, 1 - _TAIL, axis=1, keepdims=True)
    flipped *= -ndtri(_TAIL) / np.maximum(tail, _LEAST_TAIL)
    return z, flipped.max(axis=0)


def _deviates_of(null: Null, blocks: Sequence[np.ndarray]) -> np.ndarray:
    """The z of blocks of orthonormal probes by the statistic of `screen`, [blocks]."""
    ranges = [slice(*ends) for ends in pairwise(np.cumsum([0, *(x.shape[1] for x in blocks)]))]
    x, ends, runs = np.concatenate(blocks, axis=1), null.firsts, firsts_of_runs(null.inside)
    scores = np.add.reduceat(x * null.residual[:, None], ends, axis=0)
    given = _given(null.basis, x, ends)
    at = np.searchsorted(ends, runs)
    variance_of = _of_runs if ends.size == runs.size else partial(_of_stretches, at)
    z = np.empty(len(blocks))
    for place, (block, some) in enumerate(zip(blocks, ranges, strict=True)):
        products = np.add.reduceat(block[:, :, None] * block[:, None, :], ends, axis=0)
        variance, *freedom = variance_of(scores[:, some], products, given[some])
        ratio = np.sum(scores[:, some].sum(axis=0) ** 2) / variance
        z[place] = -ndtri(np.clip(fdtrc(*freedom, ratio), 1e-300, 1 - 1e-12))
    return z


@cache
def _deviates(count: int) -> np.ndarray:
    """The normal deviates of the values of the grid as those of a chi-square."""
    return -ndtri(np.clip(chdtrc(count, _GRID), 1e-300, 1 - 1e-12))


def _variance(u: np.ndarray, products: np.ndarray, given: np.ndarray) -> tuple[float, float]:
    """The variance of the sum b of the scores u [clusters, directions], and its degrees of freedom.

    `products` are X_r'X_r, `given` the scores X_r'N_r of what is given, N. Of independent errors of
    variance one the u_r - X_r'X_r b of a direction have the covariance D - W W', where D are the
    shares of the clusters in the probe, and W their scores of N and X. Each is enlarged to variance
    D; with K the covariance then, the sum of their squares has (tr K)^2/tr K^2 degrees of freedom,
    here their mean over the directions.
    """
    # The sums over clusters are products of matrices, for which each direction lies in one piece.
    scores = np.concatenate([given, np.moveaxis(products, 2, 0)], axis=2)
    shares = np.diagonal(products, axis1=1, axis2=2).T
    held = np.einsum("dcg,dcg->dc", scores, scores)
    weight = 1 / np.maximum(1 - held / np.maximum(shares, 1e-300), _LEAST_LEFT)
    trace = (weight * (shares - held)).sum(axis=1)
    scores *= np.sqrt(weight)[:, :, None]
    turned = np.swapaxes(scores, 1, 2)
    crossed = scores @ turned if scores.shape[1] < scores.shape[2] else turned @ scores
    square = np.einsum("dab,dab->d", crossed, crossed)
    square += (weight**2 * shares * (shares - 2 * held)).sum(axis=1)
    freedom = float(np.mean(trace**2 / np.maximum(square, 1e-300)))
    left = float((weight.T * (u - products @ u.sum(axis=0)) ** 2).sum())
    variance = trace.size * left / max(float(trace.sum()), 1e-300)
    return max(variance, 1e-300), max(freedom, 1.0)


def _of_runs(u: np.ndarray, products: np.ndarray, given: np.ndarray) -> tuple[float, float, float]:
    """`_variance` by runs, and the degrees of freedom of |b|^2 and of it."""
    variance, freedom = _variance(u, products, given)
    free = _free(u, products)
    return variance, free, freedom * np.sqrt(free)


def _of_stretches(
    at: np.ndarray, u: np.ndarray, products: np.ndarray, given: np.ndarray
) -> tuple[float, float, float]:
    """`_variance` by stretches, and the degrees of freedom of |b|^2 and of it.

    `at` is the first stretch of each run. Whole runs count where they scatter more (Satterthwaite
    1946, Biometrics Bulletin 2, 110-114).

    Noise that is slower than a probe moves the directions within a stretch together, so that they
    tell the variance no better than one of them.
    """
    variance, freedom = _variance(u, products, given)
    of_runs, few = _variance(
        np.add.reduceat(u, at, axis=0),
        np.add.reduceat(products, at, axis=0),
        np.add.reduceat(given, at, axis=1),
    )
    total = max(variance, of_runs)
    share = variance / total
    return total, _free(u, products), 1 / (share**2 / freedom + (1 - share) ** 2 / few)


def _free(u: np.ndarray, products: np.ndarray) -> float:
    """The degrees of freedom of |b|^2, b the sum of the scores u [clusters, directions].

    With V the covariance of b they are (tr V)^2/tr V^2 (Box 1954, Annals of Mathematical Statistics
    25, 290-302): fewer than the directions where noise moves some of them further than others, as
    slow noise does smooth ones. Both are sums over pairs of different clusters, since the score of
    one has one direction, whatever V is.
    """
    left = u - products @ u.sum(axis=0)
    crossed = left @ left.T
    own = np.diag(crossed)
    square = np.sum(crossed**2) - own @ own
    return float(np.clip((own.sum() ** 2 - own @ own) / max(square, 1e-300), 1.0, u.shape[1]))


def _given(basis: np.ndarray, x: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """The scores of what is given of the probe of each run, [directions, runs, given]."""
    found = np.empty((runs.size, x.shape[1], basis.shape[1]))
    for place, part in enumerate(pairwise([*runs.tolist(), len(x)])):
        np.matmul(x[slice(*part)].T, basis[slice(*part)], out=found[place])
    return np.swapaxes(found, 0, 1)


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
    """Orthonormal directions of the columns [points, columns], each beside those before it."""
    basis, sizes = np.linalg.qr(flat)
    return basis[:, np.abs(np.diag(sizes)) > _OWN]
