"""The initial slope of Kiencke's curve, which the online methods have to be told."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from adhesion_jax.curves import CURVES
from adhesion_jax.measured.fit import MeasuredFit, fit_measured
from adhesion_jax.measured.log import Log
from adhesion_jax.measured.residual import Residual, residual_structure
from adhesion_jax.records import Record

#: Cells of equal width in the root of |slip| from 0 to the largest, and the most samples of a cell:
#: a log is mostly micro-slip, and the curve is to be fitted to all of its slips.
_CELLS, _OF_A_CELL = 60, 40

#: A standard error above this share of the slope is taken as this share: the slope is positive.
_WIDEST = 0.8


class InitialSlope(NamedTuple):
    """Adhesion per slip near slip 0, and the fit that it is of; none where it was given."""

    value: float
    standard_error: float  # 0 where it was given
    fit: MeasuredFit | None
    left: Residual | None
    samples: int  # that it was fitted to

    @property
    def plausible(self) -> Float[np.ndarray, " lanes"]:
        """The slope, and where it is uncertain what lies one standard error below and above it.

        By its logarithm, so that both are positive.
        """
        if self.standard_error == 0:
            return np.array([self.value])
        share = min(self.standard_error / self.value, _WIDEST)
        return self.value * np.exp(share * np.array([0.0, -1.0, 1.0]))


def given(value: float) -> InitialSlope:
    return InitialSlope(value, 0.0, None, None, 0)


def estimated(log: Log) -> InitialSlope:
    """a0 of Kiencke's curve, all three parameters free, by least squares over the samples used.

    They are chosen evenly in the root of |slip|, `_OF_A_CELL` at most of each of `_CELLS`
    cells. InputError where these are too few, or where the fit gives no slope.
    """
    chosen = log.used[_chosen(np.abs(log.slip[log.used]))]
    slip, adhesion = jnp.asarray(log.slip[chosen]), jnp.asarray(log.adhesion[chosen])
    every = jnp.ones(chosen.size, dtype=bool)
    record = Record(slip, adhesion, every, every, {})
    fit = fit_measured(CURVES["kiencke"], record, log.slip_is_velocity)
    place = fit.curve.free.index("a0")
    error = float(fit.standard_errors[place])
    left = residual_structure(fit, record, np.zeros(chosen.size, dtype=int))
    value = float(fit.parameters[place])
    # Without a standard error of its own (on its bound, without influence) it is hardly known.
    return InitialSlope(
        value, error if np.isfinite(error) else _WIDEST * value, fit, left, chosen.size
    )


def _chosen(size: Float[np.ndarray, " samples"]) -> Int[np.ndarray, " chosen"]:
    """Samples in their order, spread evenly over each cell of the root of |slip|."""
    top = float(size.max())
    cell = np.minimum((np.sqrt(size / top) * _CELLS).astype(int), _CELLS - 1)
    order = np.argsort(cell, kind="stable")
    count = np.bincount(cell, minlength=_CELLS)
    begin = np.cumsum(count) - count
    kept = [
        order[start + np.linspace(0, held - 1, min(held, _OF_A_CELL)).astype(int)]
        for start, held in zip(begin, count, strict=True)
        if held
    ]
    return np.sort(np.concatenate(kept))
