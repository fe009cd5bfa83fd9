"""Probes: what an effect that is not in a model would change in its prediction."""

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from adhesion_jax.curves import Scalar
from adhesion_jax.discovery.model.fitting import Fitted, levels_of, raw_changes
from adhesion_jax.discovery.model.packing import words_of
from adhesion_jax.discovery.model.problem import Problem
from adhesion_jax.discovery.search import rules
from adhesion_jax.effects import Covariate, Effect, ShapeTerm
from adhesion_jax.effects.api import Conditions
from adhesion_jax.effects.dynamic import Lagging
from adhesion_jax.effects.shape import ACTS_ON
from adhesion_jax.programs import kept

#: Size of the constant by which the derivative with respect to a `ShapeTerm` is taken.
_NUDGE = 1e-4

#: Knots of the functions of the slip that are given in a test, and points for each of them.
_KNOTS, _POINTS_A_KNOT = 16, 20

#: How many neighbours before and after a point may smooth its slip.
_REACHES = (1, 2, 4, 8, 16, 32, 64, 128)

#: About this number of stretches of all runs have signs of their own; those that take the place of
#: the runs are at least this number of times as long as the noise remembers.
_STRETCHES, _MEMORIES = 160, 3.0

#: Rates c of two curves 1 - exp(-c slip) between which that of an adhesion lies which a lag hides.
_HIDDEN = (15.0, 100.0)

#: Directions shorter than this, beside those before them, are none of their own.
_OWN = 1e-6


class Null(NamedTuple):
    """What a test takes as given: a model, and whatever further probes might explain."""

    fitted: Fitted
    inside: np.ndarray  # [runs, points]
    basis: np.ndarray  # [points, directions]: orthonormal
    residual: np.ndarray  # [points]: data less prediction, in units of the noise, without them
    firsts: np.ndarray  # [clusters]: the first point of each; runs, or stretches of them
    level: np.ndarray  # [points]: what a level of each run changes, at length one
    kept: np.ndarray  # [points]: the share of it that is kept
    changed: Mapping[str, np.ndarray]  # [runs, points]: per constant in the place of a ShapeTerm


def null_of(fitted: Fitted, beside: Sequence[Effect] = (), within: bool = False) -> Null:
    """The model, its Jacobian and the probes `beside` projected out of what is tested.

    What is tested `within` runs has the level of each run given, and stretches of the runs for
    clusters.
    """
    root = fitted.setting.root
    inside = root > 0
    constants = [Covariate(_NUDGE, 0.0, 1.0, column="", acts_on=acts_on) for acts_on in ACTS_ON]
    changed = dict(zip(ACTS_ON, raw_changes(fitted, constants) / _NUDGE, strict=True))
    unit, variance = levels_of(fitted)
    kept = np.broadcast_to(1 / np.sqrt(1 + variance)[:, None], unit.shape)
    nothing = np.zeros((int(inside.sum()), 0))
    firsts = firsts_of_runs(inside)
    run = np.repeat(np.arange(firsts.size), np.diff(firsts, append=len(nothing)))
    plain = Null(fitted, inside, nothing, np.zeros(0), firsts, unit[inside], kept[inside], changed)
    levels = nothing
    if within:
        levels = plain.level[:, None] * (run[:, None] == np.arange(run[-1] + 1))
        firsts = stretches(plain, _MEMORIES)
    whole = np.concatenate(
        [
            levels,
            fitted.jacobian[:, inside].T,
            _of_slip(fitted, inside),
            _of_smoothing(plain, fitted.setting.problem.data.slip, root * changed["shift"]),
            # A constant in the place of a term is another curve, and no effect of a column.
            np.stack([(root * change)[inside] for change in changed.values()], axis=1),
            signals(plain, beside),
        ],
        axis=1,
    )
    size = np.linalg.norm(whole, axis=0)
    whole = beside_levels(plain, whole[:, size > 0] / size[size > 0])
    left, values, _ = np.linalg.svd(whole, full_matrices=False)
    basis = left[:, values > _OWN * values[0]]
    residual = beside_levels(plain, -fitted.residual[inside][:, None])[:, 0]
    residual = residual - basis @ (basis.T @ residual)
    return plain._replace(basis=basis, residual=residual, firsts=firsts)


def firsts_of_runs(inside: np.ndarray) -> np.ndarray:
    """The first point of each run, [runs]."""
    return np.flatnonzero(np.diff(np.nonzero(inside)[0], prepend=-1))


def stretches(null: Null, memories: float) -> np.ndarray:
    """The first point of each stretch, with about `_STRETCHES` of them in all runs, [stretches].

    A stretch is that number of times as long as the noise remembers. With three the errors of two
    of them are nearly independent once the levels of the runs are given. Runs that are too short
    stay whole.
    """
    runs = np.append(firsts_of_runs(null.inside), null.level.size)
    error = null.fitted.residual[null.inside]
    ends = list(pairwise(runs.tolist()))
    least = max(memories * _memory([error[low:high] for low, high in ends]), 1.0)
    found = []
    for low, high in ends:
        count = min(-(-_STRETCHES // (runs.size - 1)), int((high - low) / least))
        found.append(np.linspace(low, high, max(count, 1), endpoint=False).astype(int))
    return np.concatenate(found)


def _memory(errors: Sequence[np.ndarray]) -> float:
    """The integrated correlation time of the errors within runs, in points.

    1 + 2 sum of their autocorrelations up to the first that is not above 0.
    """
    most = min(error.size for error in errors) // 2
    centred = [error - error.mean() for error in errors]
    sums = [sum(float(one[lag:] @ one[: one.size - lag]) for one in centred) for lag in range(most)]
    correlations = np.array(sums) / max(sums[0], 1e-300)
    last = int(np.argmax(correlations <= 0)) or most
    return 1 + 2 * float(correlations[1:last].sum())


def beside_smoothing(null: Null) -> Null:
    """The null with what smoothing the prediction would change given too, where the slip is noisy.

    The slope is that at a noisy slip. Where the curve bends, what smoothing the slip would change
    does therefore not tell what a memory gains that smooths the prediction.
    """
    flat = _of_smoothing(null, null.fitted.adhesion, null.fitted.setting.root)
    if not flat.size:
        return null
    size = np.linalg.norm(flat, axis=0)
    flat = beside_levels(null, flat[:, size > 0] / size[size > 0])
    flat = flat - null.basis @ (null.basis.T @ flat)
    left, values, _ = np.linalg.svd(flat, full_matrices=False)
    more = left[:, values > _OWN]
    residual = null.residual - more @ (more.T @ null.residual)
    return null._replace(basis=np.concatenate([null.basis, more], axis=1), residual=residual)


def beside_levels(null: Null, flat: np.ndarray) -> np.ndarray:
    """Columns [points, columns] times the root of the inverse covariance of levels that scatter."""
    firsts = firsts_of_runs(null.inside)
    level = null.level[:, None]
    along = np.add.reduceat(level * flat, firsts, axis=0)
    along = np.repeat(along, np.diff(firsts, append=level.size), axis=0)
    return flat - level * (1 - null.kept[:, None]) * along


def _of_slip(fitted: Fitted, inside: np.ndarray) -> np.ndarray:
    """What any function of the slip would change, in units of the noise, [points, functions].

    Natural cubic splines of the rank of the slip, times the prediction, for traction and braking
    apart: finer than the departure of the curve, so that no column is named for a bend of it.
    """
    slip = np.asarray(fitted.setting.problem.data.slip)[inside]
    level = (fitted.setting.root * fitted.adhesion)[inside]
    found = []
    for branch in (slip >= 0, slip < 0):
        count = int(branch.sum())
        knots = min(_KNOTS, count // _POINTS_A_KNOT)
        if knots < 3:
            continue
        place = np.zeros(slip.size)
        place[branch] = np.argsort(np.argsort(np.abs(slip[branch]), kind="stable")) / count
        whole = CubicSpline(np.linspace(0.0, 1.0, knots), np.eye(knots), bc_type="natural")(place)
        found.append(whole * (branch * level)[:, None])
    return np.concatenate([np.zeros((slip.size, 0)), *found], axis=1)


def _of_smoothing(null: Null, signal: ArrayLike, per: np.ndarray) -> np.ndarray:
    """What smoothing a signal would change where the slip is noisy, [points, differences].

    Adhesion follows a symmetric mean of neighbours in time where white noise is on the measured
    slip. Such a mean changes a signal s by second differences s(i - k) - 2 s(i) + s(i + k), which
    change the prediction, in units of its noise, by `per`. They are added up over k to each of
    _REACHES, which tells means that fall with k in any way. A memory differs from all of them by
    what came before a point alone.
    """
    setting = null.fitted.setting
    if not setting.problem.in_time or not setting.spread.any():
        return np.zeros((int(null.inside.sum()), 0))
    signal = np.asarray(signal)
    points = np.arange(signal.shape[1])
    found, added = [], np.zeros_like(signal)
    for k in range(1, min(_REACHES[-1], int(points[-1])) + 1):
        before, after = np.maximum(points - k, 0), np.minimum(points + k, points[-1])
        added = added + signal[:, before] - 2 * signal + signal[:, after]
        if k in _REACHES:
            found.append((per * added)[null.inside] / k)
    return np.stack(found, axis=1)


def directions_of(null: Null, probes: Sequence[Effect]) -> tuple[np.ndarray, np.ndarray]:
    """Component of each probe orthogonal to what is given.

    Returns a mask of the probes that can be tested [probes]; the components [points, probes], each
    of length one, zero for the others, in units of the noise.
    """
    return beside_given(null, signals(null, probes))


def of_hidden_curves(null: Null, lag: Lagging) -> np.ndarray:
    """Components, as of `directions_of`, of what a lag would change if the curve were another.

    Where adhesion hardly follows the slip the fitted curve is nearly flat, and a lag of it nothing.
    """
    data = null.fitted.setting.problem.data
    slip = np.asarray(data.slip)
    curves = np.stack([np.sign(slip) * -np.expm1(-rate * np.abs(slip)) for rate in _HIDDEN])
    changes = np.asarray(_lagged(type(lag), vars(lag), curves, data.conditions)) - curves
    return beside_given(null, (null.fitted.setting.root * changes)[:, null.inside].T)[1]


@kept(static=(0,))
def _lagged(
    kind: type[Lagging],
    numbers: Mapping[str, Scalar],
    curves: Float[Any, "curves runs points"],
    conditions: Mapping[str, Float[Any, "runs points"]],
) -> Float[Array, "curves runs points"]:
    def of_run(curve: Array, conditions: Conditions) -> Array:
        return kind(**numbers).after(curve, curve, conditions)

    return jax.vmap(jax.vmap(of_run), in_axes=(0, None))(curves, conditions)


def beside_given(null: Null, flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`directions_of` the changes [points, probes] of a prediction."""
    flat = beside_levels(null, flat)
    before = np.linalg.norm(flat, axis=0)
    flat = flat - null.basis @ (null.basis.T @ flat)
    left = np.linalg.norm(flat, axis=0)
    testable = (left > rules.LEAST_SHARE_LEFT * before) & (before > 0) & np.isfinite(left)
    return testable, np.where(testable, flat / np.where(testable, left, 1.0), 0.0)


def split(starts: Sequence[Effect]) -> tuple[list[Effect], np.ndarray]:
    """A probe for each strength that is not zero, the others at zero, and the start of each."""
    probes, owner = [], []
    for place, start in enumerate(starts):
        for strength in start.FACTS.strengths:
            if float(getattr(start, strength)) != 0 or len(start.FACTS.strengths) == 1:
                others = {name: 0.0 for name in start.FACTS.strengths if name != strength}
                probes.append(dataclasses.replace(start, **others) if others else start)
                owner.append(place)
    return probes, np.array(owner, int)


def signals(null: Null, probes: Sequence[Effect]) -> np.ndarray:
    """The change of the prediction by each probe, in units of the noise, [points, probes].

    For a `ShapeTerm` it is its function of the columns times the derivative of the prediction with
    respect to a constant in its place: exact to first order if no effect has a memory.
    """
    root = null.fitted.setting.root
    found = np.empty((int(null.inside.sum()), len(probes)))
    others = [place for place, probe in enumerate(probes) if not isinstance(probe, ShapeTerm)]
    if others:
        changes = raw_changes(null.fitted, [probes[place] for place in others])
        found[:, others] = (root * changes)[:, null.inside].T
    for place, probe in enumerate(probes):
        if isinstance(probe, ShapeTerm):
            term = _term(null.fitted.setting.problem, probe)
            found[:, place] = (root * null.changed[probe.acts_on] * term)[null.inside]
    return found


def _term(problem: Problem, probe: ShapeTerm) -> np.ndarray:
    """The values of the term's function of the columns, [runs, points].

    It is the sum of the functions by which its strengths are multiplied. These do not depend on any
    fit and are kept in `problem.terms`.
    """
    kind, numbers = type(probe), vars(probe)
    names = [numbers[word] for word in words_of(kind)]
    strengths = kind.FACTS.strengths
    others = {name: float(numbers[name]) for name in kind.FACTS.parameters if name not in strengths}
    key = (kind, *names, *others.values())
    if key not in problem.terms:
        columns = [problem.data.columns[problem.columns.index(name)] for name in names]
        time = problem.data.conditions["time_s"]
        problem.terms[key] = np.asarray(_functions(kind, others, columns, time))
    sizes = np.array([float(numbers[name]) for name in strengths])
    used = np.flatnonzero(sizes)
    return np.tensordot(sizes[used], problem.terms[key][used], 1)


@kept(static=(0,))
def _functions(
    kind: type[ShapeTerm],
    others: Mapping[str, Scalar],
    columns: Sequence[Float[Any, "runs points"]],
    time: Float[Any, "runs points"],
) -> Float[Array, "strengths runs points"]:
    """What each strength of a term multiplies; compiled once for all names of columns."""
    places = [str(place) for place in range(len(columns))]
    named: Mapping[str, Any] = {**others, **dict(zip(words_of(kind), places, strict=True))}

    def of_run(sizes: Array, columns: Sequence[Array], time: Array) -> Array:
        conditions = {**dict(zip(places, columns, strict=True)), "time_s": time}
        strengths = dict(zip(kind.FACTS.strengths, sizes, strict=True))
        return kind(**named, **strengths).log_factor(conditions)

    of_runs = jax.vmap(of_run, in_axes=(None, 0, 0))
    alone = jnp.eye(len(kind.FACTS.strengths))
    return jax.vmap(of_runs, in_axes=(0, None, None))(alone, columns, time)
