"""Fits of a curve with effects to measured runs."""

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, TypeVar

import jax
import numpy as np
import scipy

from adhesion_jax import runtime
from adhesion_jax.curves import BASES
from adhesion_jax.discovery.model.levenberg_marquardt import fit
from adhesion_jax.discovery.model.noise import (
    Noise,
    determinant,
    estimated,
    slip_variance,
    whitening,
)
from adhesion_jax.discovery.model.problem import Problem
from adhesion_jax.discovery.model.program import (
    PROBES,
    Model,
    base_places,
    changes,
    effect_places,
    pack,
    unpack,
    whiten,
)
from adhesion_jax.effects import Effect

#: Sizes of the program: (slots, free parameters). The larger one is compiled when it is needed.
_SIZES = ((8, 32), (12, 64))

#: If the curvature along each parameter is scaled to one, the data do not determine a direction
#: whose curvature is below this.
DETERMINED = 1e-7

#: A fit ends where a step promises to lower its loss by no more than this share, which is little
#: more than the rounding of the loss: parameters are as precise as the square root of it.
_PRECISE = 1e-14

#: The same for fits that are only compared with others.
_NEAR = 1e-5

#: Noise and fit are estimated in turns until half the deviance falls by less than this.
_STANDS = 0.1

#: Largest number of turns of noise and fit.
_TURNS = 4

#: A noise is rejected if refitting a model with effects under it multiplies the sum of squared
#: errors by more than this. By hand.
MOST_SQUARES_REFITTED = 1.1

A = TypeVar("A")


class Setting(NamedTuple):
    """The data, and the noise under which models are fitted."""

    problem: Problem
    noise: Noise
    level: np.ndarray  # [runs, points]: the adhesion that the random level of a run multiplies


class Fitted(NamedTuple):
    """A model at its least squares under a noise; sums of squares are in units of that noise."""

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
        """Whether the runs are blocks of one run."""
        return self.setting.problem.blocks

    @property
    def log(self) -> bool:
        """Whether the runs are blocks of one run in time."""
        return self.blocks and self.setting.problem.in_time

    @property
    def base_values(self) -> np.ndarray:
        return self.values[list(base_places(self.base))]

    @property
    def total(self) -> float:
        """Minus the log likelihood, up to a constant of the data."""
        return float(self.loss.sum() + self.determinant.sum())


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
    """`fit_model` to about .02 of the log likelihood, which is enough to compare models."""
    return fit_model(setting, base, base_values, effects, _NEAR)


def precise(fitted: Fitted) -> Fitted:
    """The same model under the same noise, fitted to full precision."""
    return fit_model(fitted.setting, fitted.base, fitted.base_values.tolist(), fitted.effects)


def likeliest(
    setting: Setting, base: str, base_values: Sequence[float], effects: Sequence[Effect]
) -> Fitted:
    """The model and its noise of greatest likelihood, estimated in turns from those given."""
    return with_own_noise(nearly_fitted(setting, base, base_values, effects))


def with_own_noise(fitted: Fitted) -> Fitted:
    """The same model, fit and noise estimated in turns until the likelihood changes no more.

    If much is missing, the noise of greatest likelihood may have levels of the runs that are nearly
    free: a fit under it follows the shape within the runs and misses every level. Therefore a noise
    that raises the sum of squared errors of a model with effects too much is rejected.
    """
    # For a curve without effects any rise is allowed: what it misses is what is searched for.
    allowed = MOST_SQUARES_REFITTED * squares(fitted) if fitted.effects else np.inf
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
    """The same data with the noise of greatest likelihood for the residual of a model."""
    setting = fitted.setting
    problem = setting.problem
    residual = np.asarray(problem.data.adhesion) - fitted.adhesion
    return Setting(
        problem, noise_of(problem, setting.noise, residual, fitted.adhesion), fitted.adhesion
    )


def with_noise_left(fitted: Fitted) -> Fitted:
    """The same fit with the noise estimated from its residual, whichever it was fitted under."""
    problem = fitted.setting.problem._replace(even=False)
    uneven = fitted._replace(setting=fitted.setting._replace(problem=problem))
    return fitted._replace(setting=own_noise(uneven))


def noise_of(problem: Problem, start: Noise, residual: np.ndarray, level: np.ndarray) -> Noise:
    """The noise of greatest likelihood for a residual; `start` has its weights and slip noise."""
    in_order = (problem.in_time or not problem.blocks) and not problem.even
    by_run = not (problem.blocks or problem.even)
    return estimated(start, residual, level, in_order, by_run)


def raw_changes(fitted: Fitted, probes: Sequence[Effect]) -> np.ndarray:
    """The change of a model's prediction by each probe added to it, [probes, runs, points]."""
    setting = fitted.setting
    size = max(size_of(fitted.base, (*fitted.effects, probe)) for probe in probes)
    models = [packed(setting, fitted, (*fitted.effects, probe), size) for probe in probes]

    def some(first: int) -> np.ndarray:
        these = models[first : first + PROBES]
        padded = these + [these[0]] * (PROBES - len(these))
        stacked = jax.tree.map(lambda *leaves: np.stack(leaves), *padded)
        return np.asarray(changes(stacked, setting.problem.data, fitted.adhesion))[: len(these)]

    with runtime.threads() as pool:
        return np.concatenate(list(pool.map(some, range(0, len(models), PROBES))))


def side_by_side(task: Callable[[A], Fitted], items: Sequence[A]) -> list[Fitted]:
    """The task on each item, as many at a time as there are cores."""
    # The first one alone: it may have to compile the program, which the others then share.
    found = [task(item) for item in items[:1]]
    with runtime.threads() as pool:
        return found + list(pool.map(task, items[1:]))


def packed(
    setting: Setting, fitted: Fitted, effects: Sequence[Effect], size: tuple[int, int]
) -> Model:
    """The curve of a fit with other effects as numbers, for a program of that size."""
    values = fitted.base_values.tolist()
    return pack(fitted.base, values, in_order(effects), (*setting.problem.columns, ""), *size)


def size_of(base: str, effects: Sequence[Effect]) -> tuple[int, int]:
    """The size of the smallest program for such a model; `has_room` says whether there is one."""
    return next(_sizes(len(BASES[base].free), effects))


def has_room(effects: Sequence[Effect], new: Effect) -> bool:
    """Whether a program has room for one more effect, whatever the base curve."""
    return any(_sizes(max(len(curve.free) for curve in BASES.values()), (*effects, new)))


def _sizes(free: int, effects: Sequence[Effect]) -> Iterator[tuple[int, int]]:
    parameters = free + sum(len(effect_places(0, effect)) for effect in effects)
    return (size for size in _SIZES if len(effects) <= size[0] and parameters <= size[1])


def in_order(effects: Sequence[Effect]) -> tuple[Effect, ...]:
    """The effects in the order in which they are applied, from the contact outwards."""
    return tuple(sorted(effects, key=lambda effect: effect.ORDER))


def loss_without(fitted: Fitted, slots: Sequence[int]) -> float:
    """Rise of half the deviance without the effects in those places of its own, to second order.

    Half of Wald's statistic of their strengths s: s' (H^-1)_ss^-1 s/2.
    """
    gone = strengths_of(fitted, slots)
    chosen = [fitted.places.index(place) for place in gone]
    strengths = fitted.values[gone]
    spread = solve(fitted.hessian.sum(0), np.eye(len(fitted.places)))[np.ix_(chosen, chosen)]
    return 0.5 * float(strengths @ np.linalg.pinv(spread, hermitian=True) @ strengths)


def p_of(fitted: Fitted, slots: Sequence[int]) -> float:
    """The p of the hypothesis that the strengths of the effects in those places are all zero.

    Their other parameters are held, for they mean nothing where the strengths are zero. Wald's
    statistic W of k strengths with their covariance over R runs (`covariance`): then
    (R - k)/(k (R - 1)) W has the distribution F of k and R - k degrees of freedom. Hotelling 1931,
    Ann. Math. Stat. 2, 360-378.
    """
    strengths = strengths_of(fitted, slots)
    held = {
        place
        for slot in slots
        for place in effect_places(slot, fitted.effects[slot]).values()
        if place not in strengths
    }
    free = [number for number, place in enumerate(fitted.places) if place not in held]
    chosen = [free.index(fitted.places.index(place)) for place in strengths]
    less = fitted._replace(
        gradient=fitted.gradient[:, free], hessian=fitted.hessian[:, free][:, :, free]
    )
    spread = covariance(less)[np.ix_(chosen, chosen)]
    runs = int((np.abs(fitted.hessian).sum((1, 2)) > 0).sum())
    # In the units of their errors; directions that the data do not determine count for nothing.
    size = np.sqrt(np.maximum(np.diag(spread), 1e-300))
    values, vectors = np.linalg.eigh(spread / np.outer(size, size))
    kept = values > DETERMINED
    along = (fitted.values[strengths] / size) @ vectors[:, kept]
    count = int(kept.sum())
    if not 0 < count < runs:
        return 1.0
    wald = float((along**2 / values[kept]).sum())
    ratio = (runs - count) / (count * (runs - 1)) * wald
    return float(scipy.stats.f.sf(ratio, count, runs - count))


def strengths_of(fitted: Fitted, slots: Sequence[int]) -> list[int]:
    """The places in `values` of the strengths of the effects in those places."""
    return [
        place
        for slot, effect in enumerate(fitted.effects)
        if slot in slots
        for name, place in effect_places(slot, effect).items()
        if name in effect.STRENGTHS
    ]


def squares(fitted: Fitted) -> float:
    """Sum of squared errors of adhesion, points weighted, less where their slip is noisy."""
    noise = fitted.setting.noise
    error = fitted.adhesion - np.asarray(fitted.setting.problem.data.adhesion)
    share = noise.weight / (1 + noise.weight * slip_variance(noise) / noise.sigma**2)
    return float((share * np.asarray(error) ** 2).sum())


def solve(hessian: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """H^-1 g, [..., free], without directions that the data do not determine."""
    diagonal = np.diagonal(hessian, axis1=-2, axis2=-1)
    scale = np.sqrt(np.maximum(diagonal, 1e-300))
    values, vectors = np.linalg.eigh(hessian / (scale[..., :, None] * scale[..., None, :]))
    kept = values > DETERMINED
    along = np.einsum("...kl,...k->...l", vectors, gradient / scale)
    shares = np.where(kept, along / np.where(kept, values, 1.0), 0.0)
    return np.einsum("...kl,...l->...k", vectors, shares) / scale


def covariance(fitted: Fitted) -> np.ndarray:
    """Covariance of the free parameters, robust to differences between runs, [free, free].

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
