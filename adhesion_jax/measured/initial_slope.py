"""The initial slope of Kiencke's curve, which online methods are told, and what its form misses."""

from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from adhesion_jax.curves import CURVES, Peak
from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.measured.identification import fit_curves
from adhesion_jax.measured.log import Log
from adhesion_jax.records import Record

#: Cells of equal width in the root of |slip| from 0 to the largest, and the most samples of a cell:
#: a log is mostly micro-slip, and the curve is to be fitted to all of its slips.
_CELLS, _OF_A_CELL = 60, 40

#: A standard error above this share of the slope is taken as this share: the slope is positive.
_WIDEST = 0.8

#: The form of the curve that the methods have.
_FORM = "kiencke"


class InitialSlope(NamedTuple):
    """Adhesion per slip near slip 0, a0 of Kiencke's curve, and what a log says of that curve.

    `form` has the standard error that the form of the curve makes, relative to mu_max and to
    slip_opt: the difference of the peak of the fitted curve with its departure (`inference.fit`)
    from that of the curve alone. It is zero where the curve misses nothing.
    """

    value: float
    standard_error: float  # 0 where it was given
    given: bool
    fit: MeasuredFit  # of Kiencke's curve, a0 among what is fitted
    alone: Peak  # of the fitted curve, without its departure
    form: Mapping[str, float]
    samples: int  # that it was fitted to

    @property
    def fitted(self) -> tuple[float, float]:
        """The slope of the fit, and its standard error."""
        place = self.fit.curve.free.index("a0")
        value = float(self.fit.parameters[place])
        error = float(self.fit.standard_errors[place])
        # Without a standard error of its own (on its bound, without influence) it is hardly known.
        return value, error if np.isfinite(error) else _WIDEST * value

    @property
    def plausible(self) -> Float[np.ndarray, " lanes"]:
        """The slope, and where it is uncertain what lies one standard error below and above it.

        By its logarithm, so that both are positive.
        """
        if self.standard_error == 0:
            return np.array([self.value])
        share = min(self.standard_error / self.value, _WIDEST)
        return self.value * np.exp(share * np.array([0.0, -1.0, 1.0]))


def initial_slope(log: Log, given: float | None = None) -> InitialSlope:
    """The slope that was given, or a0 of Kiencke's curve fitted to samples of those used.

    They are chosen evenly in the root of |slip|, `_OF_A_CELL` at most of each of `_CELLS` cells.
    """
    chosen = log.used[_chosen(np.abs(log.slip[log.used]))]
    slip, adhesion = jnp.asarray(log.slip[chosen]), jnp.asarray(log.adhesion[chosen])
    every = jnp.ones(chosen.size, dtype=bool)
    record = Record(slip, adhesion, every, every, {})
    one_run, curve = np.zeros(chosen.size, dtype=int), {_FORM: CURVES[_FORM]}
    fits = fit_curves(curve, record, one_run, log.slip_is_velocity, given=0.0).curves
    fit = fits[_FORM]
    alone = fit.curve.peak(fit.conditions, fit.slip_limit)
    found = InitialSlope(0.0, 0.0, given is not None, fit, alone, _form(fit, alone), chosen.size)
    value, error = found.fitted if given is None else (given, 0.0)
    return found._replace(value=value, standard_error=error)


def _form(fit: MeasuredFit, alone: Peak) -> dict[str, float]:
    if not (fit.peak.found and alone.found):
        return {"mu_max": 0.0, "slip_opt": 0.0}
    return {
        "mu_max": abs(float(fit.peak.adhesion) / float(alone.adhesion) - 1),
        "slip_opt": abs(float(fit.peak.slip) / float(alone.slip) - 1),
    }


def _chosen(size: Float[np.ndarray, " samples"]) -> Int[np.ndarray, " chosen"]:
    """Samples in their order, spread evenly over each cell of the root of |slip|."""
    top = float(size.max())
    cell = np.minimum((np.sqrt(size / top) * _CELLS).astype(np.int8), _CELLS - 1)
    order = np.argsort(cell, kind="stable")
    count = np.bincount(cell, minlength=_CELLS)
    begin = np.cumsum(count) - count
    kept = [
        order[start + np.linspace(0, held - 1, min(held, _OF_A_CELL)).astype(int)]
        for start, held in zip(begin, count, strict=True)
        if held
    ]
    return np.sort(np.concatenate(kept))
