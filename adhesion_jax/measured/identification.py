"""Every curve fitted to one measured record, with or without noise in its slip."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from adhesion_jax import runtime
from adhesion_jax.curves import Curve
from adhesion_jax.measured.fit import MeasuredFit, fitted, missing_columns
from adhesion_jax.measured.points import arranged
from adhesion_jax.measured.slip import SlipErrors, exact, likely_errors
from adhesion_jax.measured.start import least_squares
from adhesion_jax.records import Record

#: Adhesion follows the expected slip and not the measured one, if that raises the log density of
#: what was left out by more than this multiple of the standard error of the gain.
_GAIN = 2.0


class Fits(NamedTuple):
    """The fit of every curve, by name, and the errors of the slip that they assume."""

    curves: Mapping[str, MeasuredFit]
    slip: SlipErrors


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
    slip_noise: float | None = None,
    progress: Callable[[str, float], None] = runtime.silent,
    starts: Starts = searched,
) -> Fits:
    """Fit every curve that can be evaluated on the record, in the order of `curves`.

    `run` is the run of each point, from 0. `slip_noise` is the standard deviation of the noise of
    the wheel speed in m/s (of the slip, where there is no vehicle speed; 0 for an exact slip); if
    it is not given, and the points are in time, it is estimated, and taken into account where the
    points left out are then predicted better. `progress` is called with words and the share done.
    """
    known = {n: c for n, c in curves.items() if not missing_columns(c, record.conditions)}
    if slip_noise:
        errors = likely_errors(record, run, slip_noise)
        errors = errors or exact(record)
        return _fitted(known, record, run, errors, slip_is_velocity, starts, progress)
    plain = _fitted(known, record, run, exact(record), slip_is_velocity, starts, progress)
    errors = None if slip_noise == 0 else likely_errors(record, run, None)
    if errors is None:
        return plain
    name = max(plain.curves, key=lambda name: plain.curves[name].log_density)
    best = {name: known[name]}
    trial = _fitted(best, record, run, errors, slip_is_velocity, starts, runtime.silent)
    gain = trial.curves[name].left_out - plain.curves[name].left_out
    if not gain.sum() > _GAIN * np.sqrt(gain.size) * np.std(gain):
        return plain
    return _fitted(known, record, run, errors, slip_is_velocity, starts, progress)


def _fitted(
    curves: Mapping[str, Curve],
    record: Record,
    run: np.ndarray,
    errors: SlipErrors,
    slip_is_velocity: bool,
    starts: Starts,
    progress: Callable[[str, float], None],
) -> Fits:
    progress("search", 0.0)
    begun = starts(curves, record._replace(slip=jnp.asarray(errors.slip)))
    needed = {name for curve in curves.values() for name in curve.NEEDS}
    points = arranged(record, run, errors, needed)
    found = {}
    for done, (name, curve) in enumerate(curves.items()):
        progress(name, done / len(curves))
        found[name] = fitted(curve, begun[name], points, slip_is_velocity)
    progress("fits", 1.0)
    return Fits(found, errors)
