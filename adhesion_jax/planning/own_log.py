"""What a plan takes from one's own log: the fitted curve, the noise, and the slips."""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from adhesion_jax.data import Measured
from adhesion_jax.data.grouping import group
from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.inference.noise import RunNoise
from adhesion_jax.planning.excitation import Again, again
from adhesion_jax.planning.truth import Truth


class OwnLog(NamedTuple):
    """A log as the beginning of a plan."""

    truth: Truth
    noise: RunNoise
    design: Again
    largest_slip: float
    samples: int
    runs: int
    in_time: bool  # whether the order of the samples in time is known
    misfit: float  # what the curve misses: its root mean square over the samples, relative


def own_log(fit: MeasuredFit, measured: Measured, stated: Mapping[str, float]) -> OwnLog:
    """The fitted curve as the truth, and the noise of its fit where none is `stated`.

    Parameters that the fit holds are taken as known. The slips are the measured ones, and their
    noise is the mean one by which the fit weighs its points. One that is stated is that of the
    wheel speed in m/s, as for `identify`, where the slip is a ratio and the speed is known.
    """
    free = tuple(
        name for name, held in zip(fit.curve.free, fit.held.tolist(), strict=True) if not held
    )
    curve = dataclasses.replace(fit.curve, free=free)
    found = fit.noise._replace(slip_noise=float(np.sqrt(np.mean(fit.slip_spread**2))))
    if "slip_noise" in stated and {"slip_ratio", "vehicle_speed_mps"} <= {*measured.table}:
        speed = measured.table["vehicle_speed_mps"].to_numpy(float)
        per_speed = float(np.sqrt(np.mean(speed**-2.0)))
        stated = {**stated, "slip_noise": stated["slip_noise"] * per_speed}
    runs = group([measured]).run
    order = np.argsort(runs, kind="stable")
    starts = np.flatnonzero(np.diff(runs[order], prepend=-1))
    slip = measured.table[measured.slip].to_numpy(float)[order]
    return OwnLog(
        Truth(curve, dict(fit.conditions), fit.slip_limit, fit.slip_unit),
        found._replace(**stated),
        again(slip, starts),
        float(np.abs(slip).max()),
        slip.size,
        starts.size,
        "time_s" in measured.table,
        fit.misfit,
    )
