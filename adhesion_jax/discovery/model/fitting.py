"""Fitting a curve with effects to a campaign, and what its runs say of models not fitted."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple, TypeVar

import jax
import numpy as np
from scipy import stats

from adhesion_jax.curves import BASES
from adhesion_jax.discovery.model.noise import (
    Noise,
    determinant,
    estimated,
    made_of_slip,
    whitening,
)
from adhesion_jax.discovery.model.problem import Problem
from adhesion_jax.discovery.model.program import (
    PROBES,
    Model,
    base_places,
    changes,
    effect_places,
    fit,
    pack,
    unpack,
    whiten,
)
from adhesion_jax.effects import Effect

#: Sizes of the program: (slots, free parameters). The larger is compiled when it is needed.
_SIZES = ((8, 32), (12, 64))

#: Folds of cross-validation: each run its own, up to this many.
_FOLDS = 40


#: A direction whose curvature is below this share of the largest is not determined by the data.
_DETERMINED = 1e-7

#: A fit has arrived where a step promises to lower its loss by no more than the first share; by the
#: second, where it is only compared with others.
_PRECISE, _NEAR = 1e-12, 1e-5

#: Noise and fit are found in turns until the half deviance falls by less than this.
_STANDS = 0.1

#: Under the right noise the sum of squares of a fit is at most this many times that without it.
_MISSED = 1.1

#: So many neighbouring blocks of one run are one stretch of it.
_STRETCH = 3

#: Turns of noise and fit, at most.
_TURNS = 4


A = TypeVar("A")


class Setting(NamedTuple):
    """A campaign and a noise that models are fitted under."""

    problem: Problem
    noise: Noise
    level: np.ndarray  # [runs, points]: the adhesion that the level of a run multiplies


class Fitted(NamedTuple):
    """A model at its least squares under a noise, in units of which its sums of squares are."""

    setting: Setting
    base: str
    effects: tuple[Effect, ...]  # in the order in which they are applied
    values: np.ndarray
    places: tuple[int, ...]  # of the free parameters in `values`
    loss: np.ndarray  # [runs]: half the sum of squares
    determinant: np.ndarray  # [runs]: half the log determinant of the covariance of the noise
    gradient: np.ndarray  # [runs, free]
    hessian: np.ndarray  # [runs, free, free]
    adhesion: np.ndarray  # [runs, points]
    residual: np.ndarray  # [runs, points], whitened, prediction less data
    jacobian: np.ndarray  # [free, runs, points], whitened

    @property
    def blocks(self) -> bool:
        """Whether its runs are blocks of one run."""
        return self.setting.problem.blocks

    @property
    def log(self) -> bool:
        """Whether they are blocks of one run in time."""
        return self.blocks and self.setting.problem.in_time

    @property
    def base_values(self) -> np.ndarray:
        return self.values[list(base_places(self.base))]

    @property
    def total(self) -> float:
        """Minus the log likelihood, less a constant of the data."""
        return float(self.loss.sum() + self.determinant.sum())


def fit_model(
    setting: Setting,
    base: str,
    base_values: Sequence[float],
    effects: Sequence[Effect],
    near: float = _PRECISE,
) -> Fitted:
    """The least squares of a curve with effects, from where its parameters are."""
    effects = in_order(effects)
    size = size_of(base, effects)
    model = pack(base, base_values, effects, (*setting.problem.columns, ""), *size)
    white = whitening(setting.noise, setting.level)
    found = fit(model, setting.problem.data, white, np.asarray(near))
    free = int(np.sum(np.asarray(model.free) != model.values.size - 1))
    values = np.asarray(found.values)
    return Fitted(
        setting,
        base,
        unpack(values, effects),
        values,
        tuple(np.asarray(model.free)[:free].tolist()),
        np.asarray(found.loss),
        determinant(white),
        np.asarray(found.gradient)[:, :free],
        np.asarray(found.hessian)[:, :free, :free],
        np.asarray(found.adhesion),
        np.asarray(found.residual),
        np.asarray(found.jacobian)[:free],
    )


def nearly_fitted(
    setting: Setting, base: str, base_values: Sequence[float], effects: Sequence[Effect]
) -> Fitted:
    """The same to about .02 of the log likelihood, which is enough to compare models."""
    return fit_model(setting, base, base_values, effects, _NEAR)


def precise(fitted: Fitted) -> Fitted:
    """The same model under the same noise, fitted until nothing moves."""
    return fit_model(fitted.setting, fitted.base, fitted.base_values.tolist(), fitted.effects)


def likeliest(
    setting: Setting, base: str, base_values: Sequence[float], effects: Sequence[Effect]
) -> Fitted:
    """The model and its noise of greatest likelihood, found in turns from those given."""
    return with_own_noise(nearly_fitted(setting, base, base_values, effects))


def with_own_noise(fitted: Fitted) -> Fitted:
    """The same model, its noise found with it in turns until the likelihood stands.

    Where much is missing, the noise of greatest likelihood can be one of runs whose levels are as
    good as free: a fit under it follows the shape within the runs and misses every level. A noise
    under which the fit misses the data by more is not taken.
    """
    # A curve alone has nothing else to follow; what it misses is what is looked for.
    allowed = _MISSED * squares(fitted) if fitted.effects else np.inf
    for _ in range(_TURNS):
        values = fitted.base_values.tolist()
        again = nearly_fitted(own_noise(fitted), fitted.base, values, fitted.effects)
        if not again.total < fitted.total or squares(again) > allowed:
            return fitted
        gained, fitted = fitted.total - again.total, again
        if gained < _STANDS:
            break
    return fitted


def own_noise(fitted: Fitted) -> Setting:
    """The noise of greatest likelihood for what a model leaves."""
    setting = fitted.setting
    problem = setting.problem
    residual = np.asarray(problem.data.adhesion) - fitted.adhesion
    return Setting(
        problem, noise_of(problem, setting.noise, residual, fitted.adhesion), fitted.adhesion
    )


def noise_of(problem: Problem, start: Noise, residual: np.ndarray, level: np.ndarray) -> Noise:
    """The noise of greatest likelihood for a residual of a campaign, with what `start` fixes."""
    in_order = (problem.in_time or not problem.blocks) and not problem.even
    by_run = not (problem.blocks or problem.even)
    return estimated(start, residual, level, in_order, by_run)


def raw_changes(fitted: Fitted, probes: Sequence[Effect]) -> np.ndarray:
    """What each probe adds to the prediction of a model, [probes, runs, points]."""
    setting = fitted.setting
    size = max(size_of(fitted.base, (*fitted.effects, probe)) for probe in probes)
    models = [packed(setting, fitted, (*fitted.effects, probe), size) for probe in probes]

    def some(first: int) -> np.ndarray:
        these = models[first : first + PROBES]
        padded = these + [these[0]] * (PROBES - len(these))
        stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *padded)
        return np.asarray(changes(stacked, setting.problem.data, fitted.adhesion))[: len(these)]

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return np.concatenate(list(pool.map(some, range(0, len(models), PROBES))))


def side_by_side(task: Callable[[A], Fitted], items: Sequence[A]) -> list[Fitted]:
    """The task on each item, as many at a time as there are cores."""
    # The first by itself, for the program may have to be compiled, and once is enough.
    found = [task(item) for item in items[:1]]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return found + list(pool.map(task, items[1:]))


def packed(
    setting: Setting, fitted: Fitted, effects: Sequence[Effect], size: tuple[int, int]
) -> Model:
    """The model of a fit with other effects, as numbers, for a program of that size."""
    values = fitted.base_values.tolist()
    return pack(fitted.base, values, in_order(effects), (*setting.problem.columns, ""), *size)


def size_of(base: str, effects: Sequence[Effect]) -> tuple[int, int]:
    """The smallest program that such a model fits into; there is one where there is room."""
    return next(_sizes(len(BASES[base].free), effects))


def has_room(effects: Sequence[Effect], new: Effect) -> bool:
    """Whether a program has room for one effect more, whatever the base curve."""
    return any(_sizes(max(len(curve.free) for curve in BASES.values()), (*effects, new)))


def _sizes(free: int, effects: Sequence[Effect]) -> Iterator[tuple[int, int]]:
    parameters = free + sum(len(effect_places(0, effect)) for effect in effects)
    return (size for size in _SIZES if len(effects) <= size[0] and parameters <= size[1])


def in_order(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """From the contact outwards."""
    return tuple(sorted(effects, key=lambda effect: effect.ORDER))


def held_out_loss(fitted: Fitted) -> np.ndarray:
    """Half the sum of squares of each run, predicted without that run, [runs].

    The parameters without a fold are one Gauss-Newton step from those of all:
    theta - (H - H_f)^-1 (g - g_f), and the loss of a run is quadratic there.
    """
    runs = np.flatnonzero(np.abs(fitted.hessian).sum((1, 2)) > 0)
    loss = fitted.loss.copy()
    if not runs.size:
        # Not one point of the model was finite.
        return np.full(loss.shape, np.inf)
    folds = np.array_split(runs, min(_FOLDS, runs.size))
    for fold, shift in zip(folds, steps_without(fitted, folds), strict=True):
        loss[fold] += fitted.gradient[fold] @ shift
        loss[fold] += 0.5 * np.einsum("rkl,k,l->r", fitted.hessian[fold], shift, shift)
    return loss


def expected_loss(fitted: Fitted) -> np.ndarray:
    """Minus the log density of each run, predicted without what is predicted, [runs].

    Of runs that is each without the whole of it, with what is not known of the parameters without
    it: for the loss l of a run, and its gradient and Hessian in units of the Hessian of all, with
    components c and eigenvalues e, l + sum of c^2/(2 (1 - e)) - ln(1 - e)/2 (Laplace). Blocks of
    one run are different parts of the curve, and without one of them its part would be
    extrapolated: they are predicted point by point, with residuals r/(1 - h), where h = J H^-1 J'
    is the leverage of a point. Allen 1974, Technometrics 16, 125-127.
    """
    if not fitted.blocks:
        return fitted.determinant + _predicted(fitted)
    jacobian = fitted.jacobian.reshape(fitted.jacobian.shape[0], -1)
    inverse = solve(fitted.hessian.sum(0), np.eye(jacobian.shape[0]))
    leverage = np.einsum("kp,kl,lp->p", jacobian, inverse, jacobian).reshape(fitted.residual.shape)
    alone = fitted.residual / np.maximum(1 - leverage, 1e-3)
    return 0.5 * (alone**2).sum(axis=1) + fitted.determinant


def _predicted(fitted: Fitted) -> np.ndarray:
    """Half the sum of squares of each run to be expected of the others, and its determinant."""
    whole = fitted.hessian.sum(0)
    scale = 1 / np.sqrt(np.maximum(np.diag(whole), 1e-300))
    values, vectors = np.linalg.eigh(whole * scale[:, None] * scale)
    kept = values > _DETERMINED * values.max(initial=0.0)
    root = scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])
    within = root.T @ fitted.hessian @ root
    # Where one run alone determines a parameter its gradient is nothing at the minimum itself: what
    # a fit that has only come near leaves of it is taken off, as the last step would.
    left = np.einsum("rkl,l->rk", within, fitted.gradient.sum(0) @ root)
    shares, axes = np.linalg.eigh(within)
    along = np.einsum("rkl,rk->rl", axes, fitted.gradient @ root - left)
    free = 1 - np.clip(shares, 0.0, 1 - 1e-6)
    return fitted.loss + 0.5 * (along**2 / free - np.log(free)).sum(axis=1)


class Gain(NamedTuple):
    """By how much one model lowers the expected loss of another, and the standard error of that."""

    total: float
    error: float
    skewness: float = 0.0  # of what the runs gain, over the root of their number
    freedom: float = np.inf  # degrees of freedom of the error

    @property
    def deviate(self) -> float:
        """How surely it is above zero, as a normal deviate.

        Student's t = total/error, where a few runs gain most, is too small: their gain is counted
        in the error as well. Hall's cubic takes the skewness s out, t + s t^2/3 + s^2 t^3/27 + s/6.
        Hall 1992, J. R. Statist. Soc. B 54, 221-228.
        """
        if not 0 < self.error < np.inf:
            return np.inf if self.total > 0 and self.error == 0 else 0.0
        t, s = self.total / self.error, self.skewness
        even = t + s * t**2 / 3 + s**2 * t**3 / 27 + s / 6
        return float(stats.norm.isf(stats.t.sf(even, self.freedom)))


def least_gain(fitted: Fitted, share: float) -> float:
    """A share of half the number of points, which is the loss that noise alone makes."""
    return 0.5 * share * float((np.asarray(fitted.setting.noise.weight) > 0).sum())


def gain(less: Fitted, more: Fitted) -> Gain:
    """What `more` gains on `less`.

    The error comes from the scatter of the runs. Blocks of one run differ by their places on the
    curve, which is no chance: there it is that of the noise alone, whose log likelihood ratio of
    two predictions has the sum of squares of their difference for a variance.
    """
    gains = expected_loss(less) - expected_loss(more)
    if less.blocks:
        return Gain(float(gains.sum()), float(np.linalg.norm(more.residual - less.residual)))
    used = gains[gains != 0]
    if used.size < 2:
        return Gain(float(gains.sum()), np.inf)
    # Without a run that alone determines a parameter the loss of that run has no bound.
    with np.errstate(over="ignore", invalid="ignore"):
        error = float(np.sqrt(used.size) * np.std(used, ddof=1))
        skewness = float(stats.skew(used) / np.sqrt(used.size))
    return Gain(
        float(gains.sum()), error, skewness if np.isfinite(skewness) else 0.0, used.size - 1
    )


def best_stretch(less: Fitted, more: Fitted) -> float:
    """What `more` gains on `less` where it gains most, in neighbouring blocks of one run."""
    gains = expected_loss(less) - expected_loss(more)
    return float(np.convolve(gains, np.ones(_STRETCH)).max())


def loss_without(fitted: Fitted, effects: Sequence[Effect]) -> float:
    """By how much the half deviance would rise without some of its effects, to second order.

    Half Wald's statistic of their strengths, s' (H^-1)_ss^-1 s/2.
    """
    gone = [
        place
        for slot, effect in enumerate(fitted.effects)
        if any(effect is one for one in effects)
        for name, place in effect_places(slot, effect).items()
        if name in effect.STRENGTHS
    ]
    chosen = [fitted.places.index(place) for place in gone]
    strengths = fitted.values[gone]
    spread = solve(fitted.hessian.sum(0), np.eye(len(fitted.places)))[np.ix_(chosen, chosen)]
    return 0.5 * float(strengths @ np.linalg.pinv(spread, hermitian=True) @ strengths)


def squares(fitted: Fitted) -> float:
    """Sum of squared errors of adhesion, each point for as much as the noise of its slip leaves."""
    noise = fitted.setting.noise
    error = (fitted.adhesion - np.asarray(fitted.setting.problem.data.adhesion)) * noise.weight
    return float((np.asarray(error) ** 2 / (1 + made_of_slip(noise) / noise.sigma**2)).sum())


def steps_without(fitted: Fitted, folds: Sequence[np.ndarray]) -> np.ndarray:
    """How far the parameters move when the runs of each fold are left out, [folds, free]."""
    hessian = np.stack([fitted.hessian[fold].sum(0) for fold in folds])
    gradient = np.stack([fitted.gradient[fold].sum(0) for fold in folds])
    return -solve(fitted.hessian.sum(0) - hessian, fitted.gradient.sum(0) - gradient)


def solve(hessian: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """H^-1 g, [..., free], directions that the data do not determine left out."""
    diagonal = np.diagonal(hessian, axis1=-2, axis2=-1)
    scale = np.sqrt(np.maximum(diagonal, 1e-300))
    values, vectors = np.linalg.eigh(hessian / (scale[..., :, None] * scale[..., None, :]))
    kept = values > 1e-7
    along = np.einsum("...kl,...k->...l", vectors, gradient / scale)
    shares = np.where(kept, along / np.where(kept, values, 1.0), 0.0)
    return np.einsum("...kl,...l->...k", vectors, shares) / scale


def covariance(fitted: Fitted) -> np.ndarray:
    """Of the free parameters, robust to what differs from run to run, [free, free].

    The sandwich H^-1 (sum of g_i g_i') H^-1 over runs, times R/(R - 1). White 1982.
    """
    runs = np.abs(fitted.hessian).sum((1, 2)) > 0
    count = max(int(runs.sum()), 2)
    steps = solve(fitted.hessian.sum(0), fitted.gradient[runs])
    return steps.T @ steps * count / (count - 1)


def in_noise_units(setting: Setting, signals: np.ndarray) -> np.ndarray:
    """Signals [signals, runs, points], whitened."""
    found, white = np.empty(signals.shape), whitening(setting.noise, setting.level)
    for first in range(0, len(signals), PROBES):
        some = signals[first : first + PROBES]
        # One program whatever the number of signals.
        padded = np.zeros((1 if len(signals) == 1 else PROBES, *some.shape[1:]))
        padded[: len(some)] = some
        whole = whiten(white, padded)
        found[first : first + PROBES] = np.asarray(whole)[: len(some)]
    return found
