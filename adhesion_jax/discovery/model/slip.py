"""Noise of the slip signal: its size, and whether adhesion follows the slip without the noise."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy
from scipy.linalg import eigh

from adhesion_jax.discovery.model.bases import bic, first_fits, fits_alone, starts_under
from adhesion_jax.discovery.model.fitting import (
    Fitted,
    Setting,
    in_noise_units,
    noise_of,
    raw_changes,
    squares,
)
from adhesion_jax.discovery.model.noise import MODES, Noise, determinant, white_noise, whitening
from adhesion_jax.discovery.model.problem import Problem, corrected
from adhesion_jax.discovery.types import Interval
from adhesion_jax.effects.slip_bias import SlipBias
from adhesion_jax.effects.slip_likelihood import FALLS_WITH, likeliest
from adhesion_jax.effects.slip_noise import ExpectedSlip, SlipNoise
from adhesion_jax.records import Record

#: Shares of the likeliest roughness of the slip that are tried on adhesion.
_SHARES = (1.0, 0.5, 0.25)

#: Noise of the slip is considered if the curve at the expected slip leaves less than this share of
#: the sum of squares that it leaves at the measured slip. By hand.
_NOTICEABLE = 0.98

#: Noise of the slip is claimed if the p of the likelihood ratio of adhesion, with two degrees of
#: freedom, is at most this. By hand: no sign flips stand behind this p.
_SIGNIFICANT = 1e-4

#: Number of turns in which slope and weights are found.
_WEIGHTINGS = 4

#: Change of the slip by which the slope of the curve is found.
_NUDGE = 1e-6

#: A mode of the adhesion error due to slip errors is slow, and kept apart, if its variance exceeds
#: this share of that of the noise of a point.
_LEAST_MODE = 0.1

#: Share of the points that is kept whatever the noise of their slip.
_LEAST_KEPT = 0.1


class Roughness(NamedTuple):
    """The likeliest noise of the slip signal, taken by itself."""

    effect: SlipNoise
    sigma: Interval


class NoisySlip(NamedTuple):
    """Noise of the slip signal that adhesion does not follow."""

    effect: SlipNoise
    sigma: Interval
    p: float
    rmse_after: float  # of adhesion predicted by the curve at the expected slip


def roughness(record: Record, fitted: Fitted, given: float | None) -> Roughness | None:
    """The noise of greatest likelihood for the slip signal; None if adhesion does not notice it.

    Whether the noise falls with the vehicle speed is decided by the likelihood. If the noise of the
    wheel speed is `given` in m/s, only the roughness of the true slip is estimated, and the result
    is returned whatever adhesion shows. None for runs that are not in time.
    """
    if not fitted.setting.problem.in_time:
        return None
    names = [name for name in FALLS_WITH if not name or name in record.conditions]
    if given is not None:
        names = names[:1]
    problem = fitted.setting.problem
    signals = (likeliest(record, problem.worth, name, given) for name in names)
    signal = min(signals, key=lambda one: one.loss)
    sigma = Interval(float(signal.effect.sigma), signal.low, signal.high)
    found = Roughness(signal.effect, sigma)
    if given is not None:
        return found
    noise = white_noise(fitted.setting.noise.weight, float(fitted.setting.noise.sigma))

    def left(effect: SlipNoise | None) -> float:
        other = corrected(problem, record, effect)
        setting = Setting(other, noise, np.asarray(problem.data.adhesion))
        # From new starts: the curve at the noisy slip may be far from that at the expected one.
        return min(squares(start) for start in starts_under(setting, [fitted.base]))

    # A true slip with a smooth acceleration has less roughness than the likeliest one.
    rough = float(found.effect.roughness)
    tried = [dataclasses.replace(found.effect, roughness=share * rough) for share in _SHARES]
    errors = [left(effect) for effect in tried]
    smallest = int(np.argmin(errors))
    if errors[smallest] >= _NOTICEABLE * left(None):
        return None
    return found._replace(effect=tried[smallest])


def with_slip_errors(problem: Problem, noise: Noise, curves: Sequence[str]) -> Setting:
    """The data and their noise with the adhesion errors due to errors of the expected slip.

    These follow from the slope of the likeliest of the `curves`, which is found in turns with the
    weights of the points and then kept for all models: with its own slope a model could widen its
    own noise. (Variance function by a preliminary estimate: Carroll and Ruppert 1988, chapter 3.)
    Points where the slip adds more variance than the noise of adhesion are left out: there the
    curve bends within the error of the slip, and neighbouring points have the same error.
    """
    adhesion = np.asarray(problem.data.adhesion)
    fitted_to = noise.weight
    # As if white: otherwise errors of the slip between events would be taken for slow noise.
    pilot = problem._replace(blocks=True, in_time=False)
    for _ in range(_WEIGHTINGS):
        fits = first_fits(fits_alone(Setting(pilot, noise, adhesion), curves))
        fitted = min(fits.values(), key=lambda fitted: fitted.total)
        extra, shared = _slip_moments(fitted)
        sigma = float(fitted.setting.noise.sigma)
        own = sigma**2 / np.where(problem.points > 0, problem.points, 1.0)
        kept = extra <= np.maximum(own, np.quantile(extra[fitted_to > 0], _LEAST_KEPT))
        noise = fitted.setting.noise._replace(
            weight=fitted_to * kept, variance=extra * kept, covariance=shared * kept
        )
    noise = _with_modes(noise, fitted, kept)
    return Setting(problem._replace(points=problem.points * kept), noise, adhesion)


def _with_modes(noise: Noise, fitted: Fitted, kept: np.ndarray) -> Noise:
    """The noise with the slow part of the adhesion errors due to the slip as modes.

    These are the modes of largest variance of the covariance g(s) C(s, t) g(t) of each run.
    """
    # Multiplied by its root, so that all points have the same noise sigma.
    root = np.sqrt(np.where(noise.weight > 0, noise.weight, 1.0))
    slope = _slope(fitted) * kept * root
    least = _LEAST_MODE * float(noise.sigma) ** 2
    modes, fast, shared = np.zeros((*slope.shape, MODES)), slope * 0.0, slope * 0.0
    for run, errors in enumerate(error_covariances(fitted.setting.problem.expected)):
        whole = slope[run, :, None] * errors * slope[run]
        most = min(MODES, len(whole))
        values, vectors = eigh(whole, subset_by_index=[len(whole) - most, len(whole) - 1])
        # The largest first.
        modes[run, :, :most] = (vectors * np.sqrt(np.where(values > least, values, 0.0)))[:, ::-1]
        rest = whole - modes[run] @ modes[run].T
        fast[run] = np.maximum(np.diag(rest), 0.0)
        shared[run, 1:] = np.diag(rest, 1)
    some = int(modes.any(axis=(0, 1)).sum())
    shared[:, 1:] /= root[:, 1:] * root[:, :-1]
    own = modes[:, :, :some] / root[:, :, None]
    return noise._replace(variance=fast / root**2, covariance=shared, modes=own)


def error_covariances(expected: ExpectedSlip) -> Iterator[np.ndarray]:
    """The covariance of the errors of the expected slip, run by run, [points, points].

    The errors of slip and rate are a Markov chain backwards in time: their covariance at s and at
    t > s is G(s) ... G(t - 1) P(t).
    """
    for gains, errors in zip(np.asarray(expected.gains), np.asarray(expected.errors), strict=True):
        found = np.zeros((len(errors), len(errors)))
        shared = errors
        for apart in range(len(errors)):
            if apart:
                shared = gains[:-apart] @ shared[1:]
            place = np.arange(len(shared))
            found[place, place + apart] = found[place + apart, place] = shared[:, 0, 0]
        yield found


def _slip_moments(fitted: Fitted) -> tuple[np.ndarray, np.ndarray]:
    """Variance of adhesion due to slip errors, and its covariance with the point before."""
    expected, slope = fitted.setting.problem.expected, _slope(fitted)
    last = np.concatenate([slope[:, :1], slope[:, :-1]], axis=1)
    shared = np.asarray(slope * last * expected.covariance)
    return slope**2 * np.asarray(expected.variance), shared


def _slope(fitted: Fitted) -> np.ndarray:
    """The derivative of the adhesion of a model by the slip, [runs, points]."""
    return raw_changes(fitted, [SlipBias(bias=_NUDGE)])[0] / _NUDGE


def noise_of_slip(
    rough: Roughness, exact: Mapping[str, Fitted], corrected: Mapping[str, Fitted]
) -> NoisySlip | None:
    """The noise of the slip, if adhesion follows the expected slip rather than the measured one.

    Compared are the likelihoods of adhesion over all points, of the best curve at either slip:
    `exact` are the fits at the measured slip, `corrected` those at the expected one.
    """
    measured, expected = (min(fits.values(), key=bic) for fits in (exact, corrected))
    weight = measured.setting.noise.weight
    problem = expected.setting.problem
    variance, covariance = _slip_moments(expected)
    error = expected.adhesion - np.asarray(problem.data.adhesion)
    noise = noise_of(
        problem,
        white_noise(weight, float(expected.setting.noise.sigma))._replace(
            variance=variance, covariance=covariance
        ),
        error,
        expected.adhesion,
    )
    setting = Setting(problem, noise, expected.adhesion)
    white = in_noise_units(setting, error[None])[0]
    half_deviance = 0.5 * (white**2).sum() + determinant(whitening(noise, setting.level)).sum()
    p = float(scipy.stats.chi2.sf(2 * max(measured.total - float(half_deviance), 0.0), 2))
    if p > _SIGNIFICANT:
        return None
    inside = expected.setting.noise.weight > 0
    return NoisySlip(rough.effect, rough.sigma, p, float(np.sqrt(np.mean(error[inside] ** 2))))
