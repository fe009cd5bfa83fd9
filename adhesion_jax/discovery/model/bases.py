"""The base curve below the effects: its fits from several starts, and the choice among curves."""

from collections.abc import Sequence

import numpy as np

from adhesion_jax.curves import BASES
from adhesion_jax.discovery.model.fitting import (
    Fitted,
    Setting,
    nearly_fitted,
    nearly_robust,
    robustly_fitted,
    side_by_side,
    under,
)
from adhesion_jax.discovery.model.prediction import expected_loss, gain_of
from adhesion_jax.discovery.model.problem import Problem

#: Prior sizes of the departure among which runs left out choose.
_BENDS = (0.01, 0.03, 0.1, 0.3, 1.0)

#: Standard deviation of the noise of the first fits, relative to the adhesion.
_FIRST_SIGMA = 0.1


def best_alone(problem: Problem, spread: np.ndarray, bases: Sequence[str]) -> Fitted:
    """The curve that fits best with its departure, each from the best of its starts.

    The size of the departure is the least with which runs left out are predicted as well as with
    any, within a standard error.

    `spread` [runs, points] is the standard deviation of the slip.
    """
    size = np.abs(np.asarray(problem.data.adhesion)[problem.points > 0])
    top = float(np.quantile(size, 0.98))
    sigma = max(_FIRST_SIGMA * float(np.sqrt(np.mean(size**2))), 1e-12)
    setting = Setting(problem, spread, np.sqrt(problem.points) / sigma, sigma, 1.0)
    starts = [(base, start) for base in bases for start in BASES[base].starts(top)]
    fits = side_by_side(lambda one: nearly_fitted(setting, *one, ()), starts)
    best = [min((one for one in fits if one.base == base), key=_cost) for base in bases]
    robust = side_by_side(nearly_robust, best)
    same = min(robust, key=lambda fitted: fitted.setting.sigma).setting
    chosen = min(robust, key=lambda one: _cost(under(same, one)))
    bent: list[Fitted] = []
    for bend in _BENDS:
        softer = same._replace(problem=problem._replace(bend=bend))
        bent.append(under(softer, bent[-1] if bent else chosen))
    losses = [expected_loss(one) for one in bent]
    lowest = min(losses, key=lambda one: float(one.sum()))
    # The least bend that is not surely worse: what is hidden is not to be taken for a bend.
    enough = (gain_of(loss - lowest) for loss in losses)
    least = next(place for place, one in enumerate(enough) if one.total <= one.error)
    return robustly_fitted(bent[least])


def _cost(fitted: Fitted) -> float:
    """Half the deviance and half a log of the points a parameter of the curve. Schwarz 1978."""
    points = int((fitted.setting.root > 0).sum())
    return fitted.total + 0.5 * len(BASES[fitted.base].free) * float(np.log(points))
