"""Every curve fitted to one measured record, each by itself."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from adhesion_jax import runtime
from adhesion_jax.curves import CURVES, Curve
from adhesion_jax.inference.fit import MeasuredFit, fitted, missing_columns
from adhesion_jax.inference.rows import Rows, arranged
from adhesion_jax.inference.slip import SPEED, SlipNoise, slip_noise
from adhesion_jax.inference.start import least_squares
from adhesion_jax.inference.weighing import alike, weighed
from adhesion_jax.records import Record

#: A curve of three parameters that needs no further column.
_WEIGHING = "kiencke"


class Fits(NamedTuple):
    """The fit of every curve, by name, the noise of the slip, and the measured rows."""

    curves: Mapping[str, MeasuredFit]
    slip: SlipNoise
    rows: Rows

    @property
    def best(self) -> str:
        """The name of that which predicts best what was left out of it."""
        return max(self.curves, key=lambda name: self.curves[name].log_density)


Starts = Callable[[Mapping[str, Curve], Record], Mapping[str, Float[np.ndarray, " free"]]]


def searched(
    curves: Mapping[str, Curve], record: Record
) -> Mapping[str, Float[np.ndarray, " free"]]:
    """The least squares start of each curve; nearly all the time is compilation."""
    with runtime.threads() as pool:
        found = pool.map(lambda curve: least_squares(curve, record), curves.values())
        return dict(zip(curves, found, strict=True))


def fit_curves(
    curves: Mapping[str, Curve],
    record: Record,
    run: Int[np.ndarray, " points"],
    slip_is_velocity: bool,
    given: float | None = None,
    progress: Callable[[str, float], None] = runtime.silent,
    starts: Starts = searched,
) -> Fits:
    """Fit every curve that can be evaluated on the record, in the order of `curves`.

    `run` is the run of each point, from 0. `given` is the standard deviation of the noise of the
    wheel speed in m/s (of the slip, where there is no vehicle speed; 0 for an exact slip); if it is
    not given, and the points are in time, it is estimated. `progress` is called with words and the
    share done.
    """
    known = {n: c for n, c in curves.items() if not missing_columns(c, record.conditions)}
    needed = {name for curve in known.values() for name in curve.NEEDS}
    rows = arranged(record, run, {*needed, *({SPEED} & record.conditions.keys())})
    slip = slip_noise(rows, rows.conditions.get(SPEED), given)
    progress("search", 0.0)
    # The curve whose slope weighs rows of noisy slip, whichever curves are asked for.
    usual = {_WEIGHING: CURVES[_WEIGHING]} if slip.sigma else {}
    begun = starts({**usual, **known}, record)
    expected, weights = rows, alike(rows)
    for name, curve in usual.items():
        expected, slip, weights = weighed(curve, begun[name], rows, slip, slip_is_velocity)
    found = {}
    for done, (name, curve) in enumerate(known.items()):
        progress(name, done / len(known))
        found[name] = fitted(curve, begun[name], expected, slip, weights, slip_is_velocity)
    progress("fits", 1.0)
    return Fits(found, slip, rows)
