"""Robust weighted least squares of a curve with effects, and what is known of its parameters."""

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import jax
import numpy as np
import scipy

from adhesion_jax import runtime
from adhesion_jax.curves import BASES
from adhesion_jax.curves.bent import BELOW_EFFECTS
from adhesion_jax.discovery.model.packing import (
    Model,
    base_places,
    columns_of,
    effect_places,
    pack,
    unpack,
)
from adhesion_jax.discovery.model.problem import Data, Problem
from adhesion_jax.discovery.model.program import PROBES, changes, fit
from adhesion_jax.effects import Covariate, Effect
from adhesion_jax.inference.sums import TUNING
from adhesion_jax.linear_algebra import eigh

#: Free parameters of the program of a curve alone, which most fits are of: without slots for
#: effects it takes a third of the time. And those of the others beside what each has of slots.
_ALONE, _BESIDE = 48, 24

#: Slots and free parameters by which the next larger program grows.
_SLOTS, _PARAMETERS = 6, 48

#: If the curvature along each parameter is scaled to one, the data do not determine a direction
#: whose curvature is below this.
DETERMINED = 1e-7

#: Curvature along a parameter below which it is held: no bound of any is further off than 1e12, and
#: so far it changes the loss by less than the number above.
_FELT = DETERMINED / 1e24

#: A fit ends where a step promises to lower its loss by no more than this share of it.
_PRECISE, _NEAR = 1e-9, 1e-5

#: Turns of fits and weights, and of the standard deviation within one.
_TURNS, _ROUNDS = 3, 4

#: Shares of the slip's noise that are tried: what jumps in the slip from row to row may be true.
_SHARES = np.array([0.0, 0.25, 0.5, 0.75, 1.0])

#: Size of the shift by which the slope of the curve is taken, in slip.
_NUDGE = 1e-5

A = TypeVar("A")


class Setting(NamedTuple):
    """The data, and the weights under which models are fitted."""

    problem: Problem
    spread: np.ndarray  # [runs, points]: standard deviation of the slip
    root: np.ndarray  # [runs, points]: reciprocal standard deviation of a point, less far outside
    sigma: float  # standard deviation of the noise of adhesion, of a point of weight 1
    share: float  # of the noise of the slip that acts


class Fitted(NamedTuple):
    """A model at its least squares; sums of squares are in units of the noise of its setting."""

    setting: Setting
    base: str
    effects: tuple[Effect, ...]  # in the order in which they are applied
    values: np.ndarray
    places: tuple[int, ...]  # of the free parameters in `values`
    loss: np.ndarray  # [runs]: half the sum of squares
    gradient: np.ndarray  # [runs, free]
    hessian: np.ndarray  # [runs, free, free]
    adhesion: np.ndarray  # [runs, points]
    residual: np.ndarray  # [runs, points], in units of the noise, prediction less data
    jacobian: np.ndarray  # [free, runs, points], in units of the noise

    @property
    def blocks(self) -> bool:
        """Whether the runs are blocks of one run."""
        return self.setting.problem.blocks

    @property
    def log(self) -> bool:
        """Whether the runs are blocks of one run in time."""
        return self.blocks and self.setting.problem.in_time

    @property
    def base_values(self) -> np.ndarray:
        return self.values[base_places(self.base)]

    @property
    def total(self) -> float:
        """Half the sum of squares, with the prior."""
        return float(self.loss.sum())

    @property
    def error(self) -> np.ndarray:
        """Data less prediction, [runs, points]."""
        return np.asarray(self.setting.problem.data.adhesion) - self.adhesion


def fit_model(
    setting: Setting,
    base: str,
    base_values: Sequence[float],
    effects: Sequence[Effect],
    near: float = _PRECISE,
) -> Fitted:
    """The least squares of a curve with effects, starting from the values given.

    `near` is the share of the loss below which a promised step ends the fit.
    """
    effects = in_order(effects)
    model = pack(setting.problem, base, base_values, effects, size_of(base, effects))
    found = fit(model, setting.problem.data, setting.root, np.asarray(near))
    values, loss, gradient, hessian, adhesion, residual, jacobian = map(np.asarray, found)
    free = int(np.sum(model.free != model.values.size - 1))
    return Fitted(
        setting,
        base,
        unpack(values, effects),
        values,
        tuple(model.free[:free].tolist()),
        loss,
        gradient[:, :free],
        hessian[:, :free, :free],
        adhesion,
        residual,
        jacobian[:free],
    )


def nearly_fitted(
    setting: Setting, base: str, base_values: Sequence[float], effects: Sequence[Effect]
) -> Fitted:
    """`fit_model` to about .02 of the log likelihood, which is enough to compare models."""
    return fit_model(setting, base, base_values, effects, _NEAR)


def refitted(fitted: Fitted, effects: Sequence[Effect], near: float = _NEAR) -> Fitted:
    """The curve of a fit with other effects, from the parameters that it has."""
    values = fitted.base_values.tolist()
    return fit_model(fitted.setting, fitted.base, values, effects, near)


def under(setting: Setting, fitted: Fitted, near: float = _NEAR) -> Fitted:
    """The same model with the weights and the departure of another setting."""
    return refitted(fitted._replace(setting=setting), fitted.effects, near)


def nearly_robust(fitted: Fitted, turns: int = _TURNS) -> Fitted:
    """The same model with the weights that its own residual asks for, in turns."""
    for _ in range(turns):
        fitted = under(weighed(fitted), fitted)
    return fitted


def robustly_fitted(fitted: Fitted) -> Fitted:
    """`nearly_robust`, and to the end."""
    near = nearly_robust(fitted, _TURNS - 1)
    return under(weighed(near), near, _PRECISE)


def weighed(fitted: Fitted) -> Setting:
    """The weights of the points by the residual of a model.

    The variance of a point of weight w is sigma^2/w + (share spread slope)^2, the slope that of the
    curve over slip; sigma is 1.48 times the median size where the noise of the slip is less, and
    the share the likeliest one. Points further out than two standard deviations count less.
    """
    setting = fitted.setting
    points = setting.problem.points
    inside = points > 0
    error = fitted.error[inside]
    weight = points[inside]
    by_slip = np.zeros_like(error)
    if setting.spread.any():
        by_slip = (setting.spread * slope_of(fitted))[inside] ** 2
    best = (-np.inf, 0.0, 0.0)
    for share in _SHARES if by_slip.any() else _SHARES[:1]:
        sigma = sigma_of(error, weight, share**2 * by_slip)
        variance = sigma**2 / weight + share**2 * by_slip
        size = np.minimum(np.abs(error) / np.sqrt(variance), 2 * TUNING)
        told = -0.5 * float(np.sum(np.log(variance) + size**2))
        if told > best[0]:
            best = (told, sigma, float(share))
    _, sigma, share = best
    variance = sigma**2 / weight + share**2 * by_slip
    far = np.abs(error) / np.sqrt(variance) / TUNING
    root = np.zeros(points.shape)
    root[inside] = 1 / np.sqrt(variance * np.maximum(far, 1.0))
    return setting._replace(root=root, sigma=sigma, share=share)


def levels_of(fitted: Fitted) -> tuple[np.ndarray, np.ndarray]:
    """The levels of the runs that scatter about the curve, as the errors of a fit show them.

    What a level changes, in units of the noise, at length one, [runs, points]; and the variance of
    the levels, in units of that of noise along it, [runs].

    A run's level is the coefficient of its prediction in its errors. With levels that scatter by s
    the covariance of the errors of a run is I + s^2 v v', v what its level changes in units of the
    noise. s^2 is the mean square of the levels less what independent noise makes of it; blocks of
    one run have none.
    """
    root = fitted.setting.root
    level, error = root * fitted.adhesion, root * fitted.error
    size = (level**2).sum(axis=1)
    used = size > 0
    scatter = 0.0
    if used.any() and not fitted.blocks:
        levels = (level * error).sum(axis=1)[used] / size[used]
        scatter = max(float(np.mean(levels**2) - np.mean(1 / size[used])), 0.0)
    unit = level / np.sqrt(np.maximum(size, 1e-300))[:, None]
    return unit, scatter * size


def sigma_of(error: np.ndarray, weight: np.ndarray, by_slip: np.ndarray) -> float:
    """1.48 times the median size of an error of a point of weight 1, where the slip is calm."""
    size = np.abs(error) * np.sqrt(weight)
    sigma = 1.4826 * float(np.median(size))
    for _ in range(_ROUNDS if by_slip.any() else 0):
        calm = by_slip * weight <= max(sigma**2, float(np.quantile(by_slip * weight, 0.1)))
        left = np.sqrt(np.maximum(1 - 0.5 * np.median((by_slip * weight)[calm]) / sigma**2, 0.25))
        sigma = 1.4826 * float(np.median(size[calm])) * float(left)
    return max(sigma, 1e-9 * float(np.sqrt(np.mean(error**2))), 1e-150)


def slope_of(fitted: Fitted) -> np.ndarray:
    """The change of the prediction per change of the slip, [runs, points]."""
    shift = Covariate(_NUDGE, 0.0, 1.0, column="", acts_on="shift")
    return raw_changes(fitted, [shift])[0] / _NUDGE


def raw_changes(fitted: Fitted, probes: Sequence[Effect]) -> np.ndarray:
    """The change of a model's prediction by each probe added to it, [probes, runs, points]."""
    size = max(size_of(fitted.base, (*fitted.effects, probe)) for probe in probes)
    values = fitted.base_values.tolist()
    models = [
        pack(fitted.setting.problem, fitted.base, values, in_order((*fitted.effects, probe)), size)
        for probe in probes
    ]
    return changes_of(models, fitted.setting.problem.data, fitted.adhesion)


def changes_of(models: Sequence[Model], data: Data, now: np.ndarray) -> np.ndarray:
    """The prediction of each model, of one size, less that of `now`, [models, runs, points]."""

    def some(first: int) -> np.ndarray:
        these = models[first : first + PROBES]
        padded = [*these, *[these[0]] * (PROBES - len(these))]
        stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *padded)
        return np.asarray(changes(stacked, np.asarray(len(these)), data, now))[: len(these)]

    with runtime.threads() as pool:
        return np.concatenate(list(pool.map(some, range(0, len(models), PROBES))))


def side_by_side(task: Callable[[A], Fitted], items: Sequence[A]) -> list[Fitted]:
    """The task on each item, as many at a time as there are cores."""
    # The first one alone: it may have to compile the program, which the others then share.
    found = [task(item) for item in items[:1]]
    with runtime.threads() as pool:
        return found + list(pool.map(task, items[1:]))


def size_of(base: str, effects: Sequence[Effect]) -> tuple[int, int]:
    """The slots and free parameters of the smallest program for a model, which may be of any size.

    Each is compiled when it is needed.
    """
    if not effects:
        return 0, _ALONE
    parameters = sum(len(effect_places(0, effect)) for effect in effects)
    parameters += len(BASES[base].free) + 2 * BELOW_EFFECTS
    times = max(-(-len(effects) // _SLOTS), -(-(parameters - _BESIDE) // _PARAMETERS))
    return _SLOTS * times, _BESIDE + _PARAMETERS * times


def in_order(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects in the order in which they are applied, from the contact outwards."""
    return tuple(sorted(effects, key=lambda effect: effect.ORDER))


def strengths_of(fitted: Fitted, slot: int) -> list[int]:
    """The places in `values` of the strengths of the effect in that place."""
    effect = fitted.effects[slot]
    places = effect_places(slot, effect)
    return [place for name, place in places.items() if name in effect.FACTS.strengths]


def solve(hessian: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """H^-1 g, [..., free], without directions that the data do not determine."""
    diagonal = np.diagonal(hessian, axis1=-2, axis2=-1)
    scale = np.where(diagonal > _FELT, 1 / np.sqrt(np.maximum(diagonal, _FELT)), 0.0)
    values, vectors = eigh(hessian * (scale[..., :, None] * scale[..., None, :]))
    kept = values > DETERMINED
    along = np.einsum("...kl,...k->...l", vectors, gradient * scale)
    shares = np.where(kept, along / np.where(kept, values, 1.0), 0.0)
    return np.einsum("...kl,...l->...k", vectors, shares) * scale


def felt(fitted: Fitted) -> np.ndarray:
    """Which of the free parameters have an influence that the data show, [free].

    One that is a value of a column has none if its standard error, all others known, is beyond the
    range of the column: a step may lie anywhere between two values, and be as wide.
    """
    problem = fitted.setting.problem
    least = np.full(len(fitted.places), _FELT)
    for slot, effect in enumerate(fitted.effects):
        for name, place in effect_places(slot, effect).items():
            if effect.FACTS.parameters[name].unit == "column" and place in fitted.places:
                column = problem.data.columns[problem.columns.index(columns_of(effect)[0])]
                least[fitted.places.index(place)] = np.ptp(column[problem.points > 0]) ** -2.0
    return np.diag(fitted.hessian.sum(0)) > least


def covariance(fitted: Fitted) -> np.ndarray:
    """Covariance of the free parameters, robust to differences between runs, [free, free].

    The sandwich H^-1 (sum of g_i g_i') H^-1 over runs, each run with the gradient that it has when
    the parameters are fitted without it (CR3: MacKinnon and White 1985, J. Econometrics 29). Of a
    parameter without an influence it is 0.
    """
    runs = np.flatnonzero(np.abs(fitted.hessian).sum((1, 2)) > 0)
    free = felt(fitted)
    hessian, gradient = fitted.hessian * (free[:, None] & free), fitted.gradient * free
    whole = hessian.sum(0)
    if runs.size < 2:
        return solve(whole, np.diag(1.0 * free))
    others = whole - hessian[runs]
    steps = solve(others, gradient[runs])
    # Where one run determines a parameter the others tell nothing of it: no step beyond that of
    # the fit to all runs counts.
    plain = solve(np.broadcast_to(whole, others.shape), gradient[runs])
    steps = np.where(np.isfinite(steps), steps, plain)
    return steps.T @ steps * (runs.size - 1) / runs.size


def quantile(fitted: Fitted) -> float:
    """The two-sided 95 % quantile of Student's t for the intervals of a fit, by its runs."""
    runs = int(np.sum(np.abs(fitted.hessian).sum((1, 2)) > 0))
    return float(scipy.stats.t.isf(0.025, max(runs - 1, 1)))
