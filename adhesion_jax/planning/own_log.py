"""What a plan takes from one's own log: the fitted curve, the noise, and the slips."""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from adhesion_jax.curves import adhesion_of
from adhesion_jax.data import Measured, to_record
from adhesion_jax.data.grouping import group
from adhesion_jax.measured.fit import MeasuredFit
from adhesion_jax.planning.excitation import Again, again
from adhesion_jax.planning.noise import Noise, noise_of_record
from adhesion_jax.planning.truth import Truth, sensitivity_of


class OwnLog(NamedTuple):
    """A log as the beginning of a plan."""

    truth: Truth
    noise: Noise
    design: Again
    largest_slip: float
    samples: int
    runs: int
    in_time: bool  # whether the order of the samples in time is known


def own_log(fit: MeasuredFit, measured: Measured, stated: Mapping[str, float]) -> OwnLog:
    """The fitted curve as the truth, and the noise of its residual where none is `stated`.

    Parameters that the fit holds are taken as known.
    """
    record = to_record(measured)
    free = tuple(
        name for name, held in zip(fit.curve.free, fit.held.tolist(), strict=True) if not held
    )
    curve = dataclasses.replace(fit.curve, free=free)
    truth = Truth(curve, dict(fit.conditions), fit.slip_limit, fit.slip_unit)
    runs = group([measured]).run
    order = np.argsort(runs, kind="stable")
    starts = np.flatnonzero(np.diff(runs[order], prepend=-1))
    needed = {name: record.conditions[name] for name in curve.NEEDS}
    residual = np.asarray(record.adhesion) - np.asarray(adhesion_of(curve, record.slip, needed))
    slip, residual = np.asarray(record.slip)[order], residual[order]
    in_time = "time_s" in measured.table
    found = noise_of_record(
        residual, sensitivity_of(truth, slip), starts, stated.get("slip_noise", 0.0), in_time
    )
    return OwnLog(
        truth,
        found._replace(**stated),
        again(slip, starts),
        float(np.abs(slip).max()),
        slip.size,
        starts.size,
        in_time,
    )
