"""How well a fitted model predicts what it was not fitted to, and what another one gains on it."""

from typing import NamedTuple

import numpy as np
import scipy

from adhesion_jax.discovery.model.fitting import DETERMINED, Fitted, levels_of, solve
from adhesion_jax.linear_algebra import eigh

#: Largest number of folds of the cross-validation; of fewer runs each is a fold.
_FOLDS = 40


def held_out_loss(fitted: Fitted) -> np.ndarray:
    """Half the sum of squares of each run under parameters fitted without it, [runs].

    The parameters without a fold f are one Gauss-Newton step from those of all runs:
    theta - (H - H_f)^-1 (g - g_f). The loss of a run is taken for quadratic.
    """
    runs = np.flatnonzero(np.abs(fitted.hessian).sum((1, 2)) > 0)
    loss = fitted.loss.copy()
    if not runs.size:
        # No point of the model was finite.
        return np.full(loss.shape, np.inf)
    folds = np.array_split(runs, min(_FOLDS, runs.size))
    hessian = np.stack([fitted.hessian[fold].sum(0) for fold in folds])
    gradient = np.stack([fitted.gradient[fold].sum(0) for fold in folds])
    shifts = -solve(fitted.hessian.sum(0) - hessian, fitted.gradient.sum(0) - gradient)
    for fold, shift in zip(folds, shifts, strict=True):
        loss[fold] += fitted.gradient[fold] @ shift
        loss[fold] += 0.5 * np.einsum("rkl,k,l->r", fitted.hessian[fold], shift, shift)
    return loss


def expected_loss(fitted: Fitted) -> np.ndarray:
    """Minus the log density of each run, predicted from the other data, [runs].

    A run is predicted from the other runs, with the uncertainty that its parameters then have: with
    l the loss of the run, c the components of its gradient and e the eigenvalues of its Hessian,
    both in units of the Hessian of all runs, this is l + sum of c^2/(2 (1 - e)) - ln(1 - e)/2
    (Laplace). Blocks of one run are different parts of the curve, and without one of them its part
    would be extrapolated. Therefore each point of a block is predicted from all others, with the
    residual r/(1 - h), where h = J H^-1 J' is its leverage. Allen 1974, Technometrics 16, 125-127.
    """
    if not fitted.blocks:
        return _predicted(fitted)
    jacobian = fitted.jacobian.reshape(fitted.jacobian.shape[0], -1)
    inverse = solve(fitted.hessian.sum(0), np.eye(jacobian.shape[0]))
    leverage = np.einsum("kp,kl,lp->p", jacobian, inverse, jacobian).reshape(fitted.residual.shape)
    alone = fitted.residual / np.maximum(1 - leverage, 1e-3)
    return 0.5 * (alone**2).sum(axis=1)


def _predicted(fitted: Fitted) -> np.ndarray:
    """`expected_loss` of whole runs, [runs], beside levels of runs that scatter.

    The parameters are those of generalised least squares, one Gauss-Newton step from the fit.
    """
    unit, variance = levels_of(fitted)
    share = variance / (1 + variance)
    along_level = (unit * fitted.residual).sum(axis=1)
    of_level = np.einsum("rt,krt->rk", unit, fitted.jacobian)
    crossed = share[:, None] * of_level
    loss = fitted.loss + 0.5 * (np.log1p(variance) - share * along_level**2)
    gradient = fitted.gradient - along_level[:, None] * crossed
    hessian = fitted.hessian - of_level[:, :, None] * crossed[:, None, :]
    whole = hessian.sum(0)
    if share.any():
        step = -solve(whole, gradient.sum(0))
        moved = hessian @ step
        loss = loss + (gradient + 0.5 * moved) @ step
        gradient = gradient + moved
    scale = 1 / np.sqrt(np.maximum(np.diag(whole), 1e-300))
    values, vectors = eigh(whole * scale[:, None] * scale)
    kept = values > DETERMINED * values.max(initial=0.0)
    root = scale[:, None] * vectors[:, kept] / np.sqrt(values[kept])
    within = root.T @ hessian @ root
    # If a single run determines a parameter, its gradient is zero at the minimum. A fit that only
    # came near leaves some gradient, which the last step would remove: it is subtracted.
    left = np.einsum("rkl,l->rk", within, gradient.sum(0) @ root)
    shares, axes = eigh(within)
    along = np.einsum("rkl,rk->rl", axes, gradient @ root - left)
    free = 1 - np.clip(shares, 0.0, 1 - 1e-6)
    return loss + 0.5 * (along**2 / free - np.log(free)).sum(axis=1)


class Gain(NamedTuple):
    """The difference of the expected losses of two models, with its standard error."""

    total: float
    error: float
    skewness: float = 0.0  # of the gains of the runs, over the root of their number
    freedom: float = np.inf  # degrees of freedom of the error

    @property
    def deviate(self) -> float:
        """The normal deviate of the one-sided p that the true gain is not above zero.

        Student's t = total/error is too small where a few runs gain most, because their gains widen
        the error as well. Hall's cubic removes the skewness s: t + s t^2/3 + s^2 t^3/27 + s/6. Hall
        1992, J. R. Statist. Soc. B 54, 221-228. Its slope is zero at t = -3/s: where one run loses
        much, no gain of the others would be sure. So s is not taken below -1.5/t.
        """
        if not 0 < self.error < np.inf:
            return np.inf if self.total > 0 and self.error == 0 else 0.0
        t = self.total / self.error
        s = max(self.skewness, -1.5 / t) if t > 0 else self.skewness
        even = t + s * t**2 / 3 + s**2 * t**3 / 27 + s / 6
        return float(scipy.stats.norm.isf(scipy.stats.t.sf(even, self.freedom)))


def gain(less: Fitted, more: Fitted) -> Gain:
    """The gain of the model `more` on the model `less`, both of the same data and weights.

    Its error is that of the scatter of the runs, or of the blocks of one run.
    """
    return gain_of(expected_loss(less) - expected_loss(more))


def gain_of(gains: np.ndarray) -> Gain:
    """The sum of gains by run, with its error."""
    used = gains[gains != 0]
    if used.size < 2:
        return Gain(float(gains.sum()), np.inf)
    # If a single run determines a parameter, leaving it out makes its predicted loss unbounded.
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        error = float(np.sqrt(used.size) * np.std(used, ddof=1))
        about = used - np.mean(used)
        skewness = float(np.sum(about**3) / np.sum(about**2) ** 1.5)
    return Gain(
        float(gains.sum()), error, skewness if np.isfinite(skewness) else 0.0, used.size - 1
    )
