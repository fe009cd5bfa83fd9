"""How well the peak would be known, over the largest slip and the number of samples."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from adhesion_jax.inference.noise import RunNoise
from adhesion_jax.planning.excitation import Design, Excitation
from adhesion_jax.planning.information import Information, information_under
from adhesion_jax.planning.truth import PeakOfTruth, Truth, peak_of, sensitivity_of, standard_errors

#: Relative standard errors of slip_opt above which the errors of the peak are rough, since they
#: are those of small errors, and of any quantity above which it is not determined. In simulated
#: measurements on five curves and rails mu_max scattered as planned within 5 % up to an error of
#: slip_opt of 5 %, and within 10 % up to 10 %; beyond that many fits find no peak.
ROUGH, UNDETERMINED = 0.1, 1.0

#: Fewest samples that are considered, since the noise must be seen as well, and most.
FEWEST_SAMPLES, MOST_SAMPLES = 10, 10**9

#: Largest slips that are tried at a time, and how often the best interval of them is divided.
_TRIALS, _DIVISIONS = 8, 3


class Planner(NamedTuple):
    """What a plan depends on, beside its largest slip and its number of samples."""

    truth: Truth
    peak: PeakOfTruth
    noise: RunNoise
    design: Design
    #: Information of runs that was computed, by their largest slip and their number of samples.
    computed: dict[tuple[float, int], Information]


class Plan(NamedTuple):
    """Relative standard errors of the peak of a curve of the right form that is fitted.

    The fit is that of `identify`, by least squares with weights for the noise of the slip alone.
    With H its curvature, M the covariance of its gradient, and g the derivative of mu_max or
    slip_opt by the unknown parameters, they are the square roots of g' H^-1 M H^-1 g, over the
    value; infinite where the samples do not determine a parameter.
    """

    planner: Planner
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


def planner(truth: Truth, noise: RunNoise, design: Design) -> Planner:
    """InputError where the law has no peak, or lacks a condition."""
    return Planner(truth, peak_of(truth), noise, design, {})


def plan_of(
    planner: Planner,
    largest_slips: Float[np.ndarray, " slips"],
    samples: Float[np.ndarray, " numbers"],
) -> Plan:
    """The plan of every pair of a largest slip and a number of samples."""
    columns = [relative_errors(planner, largest_slips, number) for number in samples]
    return Plan(planner, largest_slips, samples, np.stack(columns, axis=1))


def present_of(planner: Planner, largest_slip: float, samples: int, runs: int) -> Present:
    """The place of a measurement in the plan."""
    errors = relative_errors(planner, np.array([largest_slip]), samples)[0]
    further = (
        _slip_that_halves(planner, largest_slip, samples, 0),
        _slip_that_halves(planner, largest_slip, samples, 1),
    )
    return Present(largest_slip, samples, runs, errors, further)


def wanted_of(planner: Planner, largest_slips: Float[np.ndarray, " slips"], error: float) -> Wanted:
    """The fewest samples for each largest slip, and for the best of all slips between them."""
    samples = _fewest_samples(planner, largest_slips, error)
    best = int(np.argmin(samples))
    around = largest_slips[[max(best - 1, 0), min(best + 1, largest_slips.size - 1)]]
    between = np.geomspace(around[0], around[1], 2 * _TRIALS)
    fewer = _fewest_samples(planner, between, error)
    cheapest = int(np.argmin(fewer))
    return Wanted(error, samples, float(between[cheapest]), float(fewer[cheapest]))


def _fewest_samples(
    planner: Planner, largest_slips: Float[np.ndarray, " slips"], error: float
) -> Float[np.ndarray, " slips"]:
    """By bisection; infinite where MOST_SAMPLES would not do."""
    few = np.full(largest_slips.size, FEWEST_SAMPLES - 1.0)
    many = np.full(largest_slips.size, float(MOST_SAMPLES))
    aim = np.array([error, ROUGH])
    reached = np.all(relative_errors(planner, largest_slips, many) <= aim, axis=1)
    while np.any(many - few > 1):
        middle = np.floor((few + many) / 2)
        enough = np.all(relative_errors(planner, largest_slips, middle) <= aim, axis=1)
        few, many = np.where(enough, few, middle), np.where(enough, middle, many)
    return np.where(reached, many, np.inf)


def relative_errors(
    planner: Planner,
    largest_slips: Float[np.ndarray, " slips"],
    samples: float | int | Float[np.ndarray, " slips"],
) -> Float[np.ndarray, "slips 2"]:
    """Of mu_max and slip_opt for each largest slip, with one number of samples or one for each."""
    curvatures, scores = [], []
    for largest, number in np.broadcast(largest_slips, samples):
        excitation = planner.design(float(number))
        of_runs = _information(planner, float(largest), excitation)
        curvatures.append(excitation.repeats * of_runs.curvature)
        scores.append(excitation.repeats * of_runs.score)
    errors = standard_errors(planner.peak, np.stack(curvatures), np.stack(scores))
    return errors / np.array([planner.peak.mu_max, planner.peak.slip_opt])


def _information(planner: Planner, largest_slip: float, excitation: Excitation) -> Information:
    """That of the runs of an excitation, each taken once."""
    which = (largest_slip, excitation.share.size)
    if which not in planner.computed:
        sensitivity = sensitivity_of(planner.truth, largest_slip * excitation.share)
        planner.computed[which] = information_under(planner.noise, sensitivity, excitation.starts)
    return planner.computed[which]


def _slip_that_halves(
    planner: Planner, present_slip: float, samples: int, quantity: int
) -> float | None:
    """The smallest largest slip beyond the present one that halves a standard error.

    With as many samples. `quantity` is 0 for mu_max and 1 for slip_opt; None where no slip does.
    """
    limit = planner.truth.slip_limit
    half = relative_errors(planner, np.array([present_slip]), samples)[0, quantity] / 2
    low, high = present_slip, limit
    for _ in range(_DIVISIONS):
        trials = np.geomspace(low, high, _TRIALS)
        enough = relative_errors(planner, trials, samples)[:, quantity] <= half
        if not enough.any():
            return None
        place = int(np.argmax(enough))
        low, high = trials[max(place - 1, 0)], trials[place]
    return float(high)
