"""How well the peak would be known, over the largest slip and the number of samples."""

import dataclasses
from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solveh_banded

from adhesion_jax.data import Measured
from adhesion_jax.data.grouping import group
from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.inference.noise import RunNoise
from adhesion_jax.planning.truth import (
    Sensitivity,
    Truth,
    peak_of,
    sensitivity_of,
    standard_errors,
)

#: Largest number of samples of a log from which its information is computed.
_MOST_SAMPLES = 200_000

#: Number of samples of a piece of a single long run.
_PIECE = 2000


class Excitation(NamedTuple):
    """Runs that begin at `starts`; all of them are taken `repeats` times."""

    share: Float[np.ndarray, " points"]  # slip over the largest slip
    starts: Int[np.ndarray, " runs"]
    repeats: float

    @property
    def runs(self) -> float:
        return self.repeats * self.starts.size

    @property
    def samples(self) -> float:
        return self.repeats * self.share.size


class Sweeps(NamedTuple):
    """Runs that rise evenly from slip 0 to the largest; too few samples for one are a short one."""

    samples_per_run: int

    def __call__(self, samples: float) -> Excitation:
        runs = max(1, round(samples / self.samples_per_run))
        share = np.linspace(0.0, 1.0, max(2, round(samples / runs)))
        return Excitation(share, np.zeros(1, dtype=int), float(runs))


class Again(NamedTuple):
    """The runs of a log again and again, all its slips stretched by one factor."""

    share: Float[np.ndarray, " points"]
    starts: Int[np.ndarray, " runs"]
    samples: int  # of the whole log

    def __call__(self, samples: float) -> Excitation:
        return Excitation(self.share, self.starts, samples / self.share.size)


#: Called with a number of samples, it gives an excitation of about that number.
Design: TypeAlias = Sweeps | Again


def again(slip: Float[np.ndarray, " points"], starts: Int[np.ndarray, " runs"]) -> Again:
    """The design of a log; of a long one evenly chosen runs stand for all."""
    chosen, fewer = _some_runs(slip.size, starts)
    return Again(slip[chosen] / np.abs(slip).max(), fewer, slip.size)


def _some_runs(
    points: int, starts: Int[np.ndarray, " runs"]
) -> tuple[Int[np.ndarray, " chosen"], Int[np.ndarray, " fewer"]]:
    """Samples of whole runs, evenly chosen, if a log is long, and where they begin.

    A single run is cut into pieces, which then are the runs.
    """
    if points <= _MOST_SAMPLES:
        return np.arange(points), starts
    if starts.size == 1:
        starts = np.arange(0, points, _PIECE)
    ends = np.append(starts[1:], points)
    kept = slice(None, None, -(-points // _MOST_SAMPLES))
    chosen = [np.arange(start, end) for start, end in zip(starts[kept], ends[kept], strict=True)]
    begins = np.cumsum([0, *(run.size for run in chosen[:-1])])
    return np.concatenate(chosen), begins


class Information(NamedTuple):
    """Of the weighted sum of squares of the residuals, by the unknown parameters."""

    curvature: Float[np.ndarray, "free free"]  # H = J' W J
    score: Float[np.ndarray, "free free"]  # J' W V W J, the covariance of the gradient


def weights_under(noise: RunNoise, sensitivity: Sensitivity) -> Float[np.ndarray, " points"]:
    """The weights of `identify`, 1/(sigma^2 + (slope x noise of the slip)^2).

    What neighbours have in common is no part of them.
    """
    return 1 / (noise.sigma**2 + (sensitivity.slope * noise.slip_noise) ** 2)


def information_under(
    noise: RunNoise, sensitivity: Sensitivity, starts: Int[np.ndarray, " runs"]
) -> Information:
    """That of the samples of runs that begin at `starts`.

    J is the sensitivity to the parameters, W the weights, and V the covariance of the noise: that
    of e, of the errors of the slip, to the first order, and of both levels, each of which
    multiplies the adhesion (`inference.noise`).
    """
    weight = weights_under(noise, sensitivity)
    pull = weight * sensitivity.by_parameters
    along = pull * sensitivity.adhesion
    of_runs = np.add.reduceat(along, starts, axis=1)
    slow = np.exp(-1 / noise.slow_rows) if noise.slow_rows else 0.0
    score = (
        noise.sigma**2 * pull @ _correlated(pull, noise.autocorrelation, starts).T
        + (pull * (sensitivity.slope * noise.slip_noise) ** 2) @ pull.T
        + noise.slow_level**2 * along @ _correlated(along, slow, starts).T
        + noise.run_scatter**2 * of_runs @ of_runs.T
    )
    return Information(pull @ sensitivity.by_parameters.T, score)


def _correlated(
    columns: Float[np.ndarray, "free points"], r: float, starts: Int[np.ndarray, " runs"]
) -> Float[np.ndarray, "free points"]:
    """Each column times the correlations r^|lag| within runs, whose inverse is tridiagonal."""
    points = columns.shape[1]
    ends = np.zeros(points)  # of runs that a sample is: none, one, or both
    ends[starts] += 1
    ends[np.append(starts[1:], points) - 1] += 1
    bands = np.full((2, points), -r)
    bands[0, starts] = 0.0
    bands[1] = 1 + r**2 * (1 - ends)
    return (1 - r**2) * solveh_banded(bands, columns.T).T


#: Relative standard errors of slip_opt above which the errors of the peak are rough, since they
#: are those of small errors, and of any quantity above which it is not determined. In simulated
#: measurements on five curves and rails mu_max scattered as planned within 5 % up to an error of
#: slip_opt of 5 %, and within 10 % up to 10 %; beyond that many fits find no peak.
ROUGH, UNDETERMINED = 0.1, 1.0

#: Fewest samples that are considered, since the noise must be seen as well, and most.
FEWEST_SAMPLES, MOST_SAMPLES = 10, 10**9

#: Largest slips that are tried at a time, and how often the best interval of them is divided.
_TRIALS, _DIVISIONS = 8, 3


class Plan(NamedTuple):
    """Relative standard errors of the peak of a curve of the right form that is fitted.

    The fit is that of `identify`, by least squares with weights for the noise of the slip alone.
    With H its curvature, M the covariance of its gradient, and g the derivative of mu_max or
    slip_opt by the unknown parameters, they are the square roots of g' H^-1 M H^-1 g, over the
    value; infinite where the samples do not determine a parameter.
    """

    planner: "Planner"
    largest_slips: Float[np.ndarray, " slips"]
    samples: Float[np.ndarray, " numbers"]
    errors: Float[np.ndarray, "slips numbers 2"]  # of mu_max and of slip_opt


class Present(NamedTuple):
    """A measurement that is there, and what would halve the errors of its peak.

    As many samples that reach as far in slip as `further`, the one for mu_max and the other for
    slip_opt, None where no slip does; or, whatever the noise, four times as many runs like these.
    """

    largest_slip: float
    samples: int
    runs: int
    errors: Float[np.ndarray, " 2"]  # relative, of mu_max and of slip_opt
    further: tuple[float | None, float | None]


class Wanted(NamedTuple):
    """The fewest samples, for each largest slip, with which mu_max has a relative error.

    And slip_opt one of at most ROUGH, without which that of mu_max is rough.
    """

    error: float
    samples: Float[np.ndarray, " slips"]  # infinite where MOST_SAMPLES would not do
    cheapest_slip: float  # the largest slip, between those of the plan, that needs the fewest
    cheapest: float


class Planner:
    """What a plan depends on, beside its largest slip and its number of samples.

    InputError where the law has no peak, or lacks a condition.
    """

    def __init__(self, truth: Truth, noise: RunNoise, design: Design) -> None:
        self.truth, self.noise, self.design, self.peak = truth, noise, design, peak_of(truth)
        #: Information of runs that was computed, by their largest slip and number of samples.
        self.computed: dict[tuple[float, int], Information] = {}

    def plan(
        self, largest_slips: Float[np.ndarray, " slips"], samples: Float[np.ndarray, " numbers"]
    ) -> Plan:
        """The plan of every pair of a largest slip and a number of samples."""
        columns = [self.errors(largest_slips, number) for number in samples]
        return Plan(self, largest_slips, samples, np.stack(columns, axis=1))

    def present(self, largest_slip: float, samples: int, runs: int) -> Present:
        """The place of a measurement in the plan."""
        errors = self.errors(np.array([largest_slip]), samples)[0]
        further = [self._slip_that_halves(largest_slip, samples, quantity) for quantity in (0, 1)]
        return Present(largest_slip, samples, runs, errors, (further[0], further[1]))

    def wanted(self, largest_slips: Float[np.ndarray, " slips"], error: float) -> Wanted:
        """The fewest samples for each largest slip, and for the best of all slips between them."""
        samples = self._fewest_samples(largest_slips, error)
        best = int(np.argmin(samples))
        around = largest_slips[[max(best - 1, 0), min(best + 1, largest_slips.size - 1)]]
        between = np.geomspace(around[0], around[1], 2 * _TRIALS)
        fewer = self._fewest_samples(between, error)
        cheapest = int(np.argmin(fewer))
        return Wanted(error, samples, float(between[cheapest]), float(fewer[cheapest]))

    def _fewest_samples(
        self, largest_slips: Float[np.ndarray, " slips"], error: float
    ) -> Float[np.ndarray, " slips"]:
        """By bisection; infinite where MOST_SAMPLES would not do."""
        few = np.full(largest_slips.size, FEWEST_SAMPLES - 1.0)
        many = np.full(largest_slips.size, float(MOST_SAMPLES))
        aim = np.array([error, ROUGH])
        reached = np.all(self.errors(largest_slips, many) <= aim, axis=1)
        while np.any(many - few > 1):
            middle = np.floor((few + many) / 2)
            enough = np.all(self.errors(largest_slips, middle) <= aim, axis=1)
            few, many = np.where(enough, few, middle), np.where(enough, middle, many)
        return np.where(reached, many, np.inf)

    def errors(
        self,
        largest_slips: Float[np.ndarray, " slips"],
        samples: float | int | Float[np.ndarray, " slips"],
    ) -> Float[np.ndarray, "slips 2"]:
        """Of mu_max and slip_opt, relative, for each largest slip.

        With one number of samples, or one for each.
        """
        curvatures, scores = [], []
        for largest, number in np.broadcast(largest_slips, samples):
            excitation = self.design(float(number))
            which = (float(largest), excitation.share.size)
            if which not in self.computed:  # that of the runs, each taken once
                sensitivity = sensitivity_of(self.truth, float(largest) * excitation.share)
                found = information_under(self.noise, sensitivity, excitation.starts)
                self.computed[which] = found
            of_runs = self.computed[which]
            curvatures.append(excitation.repeats * of_runs.curvature)
            scores.append(excitation.repeats * of_runs.score)
        errors = standard_errors(self.peak, np.stack(curvatures), np.stack(scores))
        return errors / np.array([self.peak.mu_max, self.peak.slip_opt])

    def _slip_that_halves(self, present_slip: float, samples: int, quantity: int) -> float | None:
        """The smallest largest slip beyond the present one that halves a standard error.

        With as many samples; None where no slip does. `quantity` is 0 for mu_max and 1 for
        slip_opt.
        """
        half = self.errors(np.array([present_slip]), samples)[0, quantity] / 2
        low, high = present_slip, self.truth.slip_limit
        for _ in range(_DIVISIONS):
            trials = np.geomspace(low, high, _TRIALS)
            enough = self.errors(trials, samples)[:, quantity] <= half
            if not enough.any():
                return None
            place = int(np.argmax(enough))
            low, high = trials[max(place - 1, 0)], trials[place]
        return float(high)


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
    runs = group(measured).run
    order = np.argsort(runs, kind="stable")
    starts = np.flatnonzero(np.diff(runs[order], prepend=-1))
    slip = measured.table[measured.slip].to_numpy(float)[order]
    largest = float(np.abs(slip).max())
    return OwnLog(
        # A wheel that spins may have a slip beyond 1.
        Truth(curve, dict(fit.conditions), max(fit.slip_limit, largest), fit.slip_unit),
        found._replace(**stated),
        again(slip, starts),
        largest,
        slip.size,
        starts.size,
        "time_s" in measured.table,
        fit.misfit,
    )
