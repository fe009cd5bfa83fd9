"""All measured rows under a law: its predictions and its fit, a few runs at a time.

The search fits to blocks of rows (`data.condensing`). Its result is fitted to every row here. Of
each run only sums over its rows are kept, so that memory does not grow with the number of rows:
with the noise of the search, AR(1) and a level of each run, they are enough for the loss, its
gradient and its Hessian, and for the likelihood of every autocorrelation and run scatter.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from adhesion_jax.data.condensing import block_means
from adhesion_jax.data.grouping import places
from adhesion_jax.data.runs import RunSet
from adhesion_jax.discovery.model.fitting import (
    DETERMINED,
    MOST_SQUARES_REFITTED,
    Fitted,
    fit_model,
    packed,
    size_of,
)
from adhesion_jax.discovery.model.noise import Sums, likeliest_of, long_enough
from adhesion_jax.discovery.model.program import Model, base_curve, base_places, unpack
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.optim.levenberg_marquardt import damped_step
from adhesion_jax.programs import kept

#: Number of cells of one column that are computed at a time.
_CELLS = 2**17

#: Fewest points to which runs are padded; beyond it the powers of two, so that programs are few.
_FEWEST_POINTS = 256

#: Largest number of steps of the fit; it starts from the fit to blocks, and needs two or three.
_STEPS = 8

#: The fit ends where a step promises to lower half the deviance by less than this.
_SETTLED = 1e-3

#: Factors on the damping after a step that lowers half the deviance, and after one that does not;
#: the least damping after the latter, relative to the curvature.
_EASED, _RAISED, _LEAST_RAISED = 0.1, 10.0, 1e-3

#: By column, the smallest and the largest value of the rows.
Ranges = Mapping[str, tuple[float, float]]


class _Piece(NamedTuple):
    """Some runs, or stretches of runs, side by side."""

    held: np.ndarray  # [runs, points]: places of the rows
    inside: np.ndarray  # [runs, points]: false for padding, and for rows that lead in a stretch
    linked: np.ndarray  # [runs, points]: inside, and the point before is of the same run
    runs: np.ndarray  # [runs]: their numbers


def _pieces(runs: RunSet) -> Iterator[_Piece]:
    """All rows, a bounded number at a time.

    A run that is longer is taken in stretches. A stretch of a run in time, or a block of one run,
    is led in by as many rows as it has, for what acts with a memory.
    """
    lengths = runs.lengths
    if lengths.size * lengths.max() <= _CELLS:
        held, inside = runs.layout
        linked = inside & (held > runs.starts[:, None])
        yield _Piece(held, inside, linked, np.arange(lengths.size))
        return
    led = "time_s" in runs.whole.conditions
    begin, start, stop, number = [], [], [], []
    for run, (first, length) in enumerate(zip(runs.starts, lengths, strict=True)):
        earliest = 0 if runs.blocks else first
        for at in range(first, first + length, _CELLS):
            end = min(at + _CELLS, first + length)
            begin.append(max(at - (end - at), earliest) if led else at)
            start.append(at)
            stop.append(end)
            number.append(run)
    begins, starts, stops, numbers = map(np.array, (begin, start, stop, number))
    size = np.maximum(_FEWEST_POINTS, 2 ** np.ceil(np.log2(stops - begins)).astype(int))
    for points in np.unique(size):
        some = np.flatnonzero(size == points)
        count = min(max(_CELLS // points, 1), some.size)
        for at in range(0, some.size, count):
            # The last group is filled up with runs in which nothing counts.
            group = np.resize(some[at : at + count], count)
            there = np.arange(count) < some.size - at
            held, _ = places(begins[group], stops[group] - begins[group], int(points))
            inside = (held >= starts[group][:, None]) & there[:, None]
            inside[:, 1:] &= np.diff(held, axis=1) > 0
            linked = inside & (held > runs.starts[numbers[group]][:, None])
            linked[:, 0] = False
            yield _Piece(held, inside, linked, numbers[group])


def predicted(law: CorrectedLaw, runs: RunSet) -> np.ndarray:
    """Adhesion of every row, [rows]."""
    found = np.empty(runs.whole.slip.size)
    for piece in _pieces(runs):
        values = np.asarray(_of_runs(law, *_rows_of(runs, piece)))
        found[piece.held[piece.inside]] = values[piece.inside]
    return found


@kept()
def _of_runs(
    law: CorrectedLaw,
    slip: Float[Array, "runs points"],
    conditions: Mapping[str, Float[Array, "runs points"]],
) -> Float[Array, "runs points"]:
    return jax.vmap(law)(slip, conditions)


def _rows_of(runs: RunSet, piece: _Piece) -> tuple[Array, Mapping[str, Array]]:
    return jnp.asarray(runs.whole.slip[piece.held]), runs.conditions_at(piece.held)


def bends(fitted: Fitted, runs: RunSet, blocks: RunSet) -> np.ndarray:
    """How far the mean of a curve over the rows of a block is above the curve at their mean.

    [blocks]. Where the slip moves within a block the curve bends, so that the mean adhesion is not
    that of the mean slip: less this difference it is, but for what the curve itself lacks.
    """
    law = _law(fitted, fitted.values, {})
    return block_means(predicted(law, runs), blocks) - predicted(law, blocks)


class _Products(NamedTuple):
    """Sums over the rows of each run of products of the derivatives, the error and the level.

    `sums` is [4, runs, free + 2, free + 2]. First axis, the rows that are summed over: those
    without a predecessor; those with one; the latter times their predecessors; the predecessors.
    """

    sums: np.ndarray
    points: np.ndarray  # [runs]
    starts: np.ndarray  # [runs]: rows without a predecessor


def _products(law: CorrectedLaw, tangents: CorrectedLaw, runs: RunSet) -> _Products:
    """One pass over all rows; `tangents` [free] are the changes of the law by its parameters."""
    count = runs.lengths.size
    columns = len(jax.tree.leaves(tangents)[0]) + 2
    sums = np.zeros((4, count, columns, columns))
    starts = np.zeros(count)
    for piece in _pieces(runs):
        slip, conditions = _rows_of(runs, piece)
        adhesion = jnp.asarray(runs.whole.adhesion[piece.held])
        masks = jnp.asarray(piece.inside), jnp.asarray(piece.linked)
        some = np.asarray(_products_of(law, tangents, slip, adhesion, conditions, *masks))
        for run, of_run in zip(piece.runs, np.moveaxis(some, 1, 0), strict=True):
            sums[:, run] += of_run
        np.add.at(starts, piece.runs, (piece.inside & ~piece.linked).sum(axis=1))
    return _Products(sums, runs.lengths, starts)


@kept()
def _products_of(
    law: CorrectedLaw,
    tangents: CorrectedLaw,
    slip: Float[Array, "runs points"],
    adhesion: Float[Array, "runs points"],
    conditions: Mapping[str, Float[Array, "runs points"]],
    inside: Bool[Array, "runs points"],
    linked: Bool[Array, "runs points"],
) -> Float[Array, "four runs columns columns"]:
    def of_runs(law: CorrectedLaw) -> Array:
        return jax.vmap(law)(slip, conditions)

    def change(tangent: CorrectedLaw) -> tuple[Array, Array]:
        return jax.jvp(of_runs, (law,), (tangent,))

    level, changes = jax.vmap(change, out_axes=(None, 0))(tangents)
    columns = jnp.concatenate([changes, (adhesion - level)[None], level[None]])
    columns = jnp.moveaxis(columns, 0, 1)  # [runs, columns, points]
    before = jnp.concatenate([columns[:, :, :1], columns[:, :, :-1]], axis=2)

    def product(one: Array, other: Array, where: Array) -> Array:
        return jnp.where(where[:, None], one, 0.0) @ jnp.where(where[:, None], other, 0.0).mT

    crossed = product(columns, before, linked)
    return jnp.stack(
        [
            product(columns, columns, inside & ~linked),
            product(columns, columns, linked),
            0.5 * (crossed + crossed.mT),
            product(before, before, linked),
        ]
    )


class _Noise(NamedTuple):
    sigma: float
    autocorrelation: float
    run_scatter: float


def _noise_of(products: _Products, ordered: bool, by_run: bool) -> _Noise:
    """The noise of greatest likelihood for the error of a law at all rows."""
    error, level = -2, -1
    pairs = ((error, error), (level, level), (error, level))
    sums = np.stack([products.sums[:, :, one, other] for one, other in pairs])
    size = sums[1, :2].sum() / max(len(products.points), 1)
    whole = Sums(sums, int(products.points.sum()), int(products.starts.sum()), float(size))
    ordered = ordered and long_enough(whole.points, len(products.points))
    return _Noise(*likeliest_of(whole, ordered, by_run))


class _Loss(NamedTuple):
    """Minus the log likelihood of each run and its derivatives, up to a constant of the data."""

    loss: np.ndarray  # [runs]
    determinant: np.ndarray  # [runs]
    gradient: np.ndarray  # [runs, free]
    hessian: np.ndarray  # [runs, free, free]

    @property
    def total(self) -> float:
        return float(self.loss.sum() + self.determinant.sum())


def _loss(products: _Products, noise: _Noise, at: np.ndarray, precision: np.ndarray) -> _Loss:
    """The loss under a noise; `precision` is that of the prior of the parameters `at`."""
    sigma, r, scatter = noise
    start, own, crossed, before = products.sums
    white = start + (own - 2 * r * crossed + r**2 * before) / (1 - r**2)
    ratio = (scatter / sigma) ** 2
    level = white[:, :, -1]
    free = 1 + ratio * white[:, -1, -1]
    white = white - ratio * level[:, :, None] * level[:, None, :] / free[:, None, None]
    white = white / sigma**2
    share = 1 / len(white)
    linked = products.points - products.starts
    return _Loss(
        0.5 * (white[:, -2, -2] + share * (at @ precision @ at)),
        products.points * np.log(sigma) + 0.5 * linked * np.log1p(-(r**2)) + 0.5 * np.log(free),
        -white[:, :-2, -2] + share * (precision @ at),
        white[:, :-2, :-2] + share * precision,
    )


class OfRows(NamedTuple):
    """A model at the rows of the runs, and at the blocks that it was searched in.

    `rows` has the `loss`, `determinant`, `gradient` and `hessian` of all rows and the noise that
    the model leaves in them; its other arrays are those of the blocks, as in `blocks`.
    """

    rows: Fitted
    blocks: Fitted


def fitted_to_rows(fitted: Fitted, runs: RunSet, ranges: Ranges, white: bool) -> OfRows:
    """The same model fitted to all rows, with the noise that it leaves in them.

    If `white`, every row counts alike: least squares.
    """
    model, kinds = _model(fitted), _kinds(fitted, white)

    def under(values: np.ndarray) -> tuple[float, _Noise, _Loss]:
        products = _products(*_law_and_tangents(fitted, values, ranges), runs)
        noise = _noise_of(products, *kinds)
        at = values[list(fitted.places)]
        squares = float(products.sums[:2, :, -2, -2].sum())
        return squares, noise, _loss(products, noise, at, model.precision)

    values, damping = fitted.values, DETERMINED
    first, noise, loss = under(values)
    for _ in range(_STEPS):
        at = values[list(fitted.places)]
        step, promised = _step(loss, at, model, DETERMINED)
        # A step that stops at a bound may promise a rise, which is not the end.
        if 0 <= promised < _SETTLED:
            break
        if damping > DETERMINED:
            step, _ = _step(loss, at, model, damping)
        trial = values.copy()
        trial[list(fitted.places)] = at + step
        squares, other, new = under(trial)
        # A fit that misses the levels of the runs is no fit, though it is the likelier one.
        if new.total < loss.total and squares <= MOST_SQUARES_REFITTED * first:
            values, noise, loss = trial, other, new
            damping = max(_EASED * damping, DETERMINED)
        else:
            damping = max(_RAISED * damping, _LEAST_RAISED)
    return _with(fitted, values, noise, loss)


def seen_by_rows(fitted: Fitted, runs: RunSet, ranges: Ranges) -> OfRows:
    """The model as it is, with the noise that it leaves in all rows."""
    products = _products(*_law_and_tangents(fitted, fitted.values, ranges), runs)
    noise = _noise_of(products, *_kinds(fitted, white=False))
    at, model = fitted.values[list(fitted.places)], _model(fitted)
    return _with(fitted, fitted.values, noise, _loss(products, noise, at, model.precision))


def _kinds(fitted: Fitted, white: bool) -> tuple[bool, bool]:
    """Whether the noise may have an autocorrelation, and a level of each run."""
    problem = fitted.setting.problem
    ordered = problem.in_time or not problem.blocks
    by_run = not problem.blocks and problem.points.shape[0] > 2
    return ordered and not white, by_run and not white


def _model(fitted: Fitted) -> Model:
    """The model as numbers, its bounds and its prior [free]."""
    size = size_of(fitted.base, fitted.effects)
    model = packed(fitted.setting, fitted, fitted.effects, size)
    free = len(fitted.places)
    return model._replace(
        lower=model.lower[:free],
        upper=model.upper[:free],
        precision=model.precision[:free, :free],
    )


def _law_and_tangents(
    fitted: Fitted, values: np.ndarray, ranges: Ranges
) -> tuple[CorrectedLaw, CorrectedLaw]:
    """The law of some values, and its changes by each free parameter, leaves [free]."""
    here = _law(fitted, values, ranges)
    nudged = values + np.eye(values.size)[list(fitted.places)]
    units = [_law(fitted, other, ranges) for other in nudged]
    changed = [jax.tree.map(np.subtract, other, here) for other in units]
    return here, jax.tree.map(lambda *leaves: np.stack(leaves), *changed)


def _law(fitted: Fitted, values: np.ndarray, ranges: Ranges) -> CorrectedLaw:
    problem = fitted.setting.problem
    curve = base_curve(fitted.base, values[list(base_places(fitted.base))])
    noisy = () if problem.slip_noise is None else (problem.slip_noise,)
    effects = (*noisy, *unpack(values, fitted.effects))
    law = CorrectedLaw(curve, effects, ranges, problem.calendar)
    return jax.tree.map(np.asarray, law)


def _step(loss: _Loss, at: np.ndarray, model: Model, damping: float) -> tuple[np.ndarray, float]:
    """The damped step inside the bounds, and by how much it promises to lower the loss."""
    gradient, hessian = loss.gradient.sum(0), loss.hessian.sum(0)
    box = model.lower, model.upper
    step = np.asarray(damped_step(at, gradient, hessian, damping, *box))
    return step, -float(step @ gradient + 0.5 * step @ hessian @ step)


def _with(fitted: Fitted, values: np.ndarray, noise: _Noise, loss: _Loss) -> OfRows:
    own = values[list(base_places(fitted.base))].tolist()
    effects = unpack(values, fitted.effects)
    # A fit that ends wherever it starts: the model is only evaluated.
    blocks = fit_model(fitted.setting, fitted.base, own, effects, near=np.inf)
    setting = fitted.setting
    found = setting._replace(
        noise=setting.noise._replace(
            sigma=np.array(noise.sigma),
            autocorrelation=np.array(noise.autocorrelation),
            run_scatter=np.array(noise.run_scatter),
        )
    )
    rows = blocks._replace(
        setting=found,
        loss=loss.loss,
        determinant=loss.determinant,
        gradient=loss.gradient,
        hessian=loss.hessian,
    )
    return OfRows(rows, blocks)
