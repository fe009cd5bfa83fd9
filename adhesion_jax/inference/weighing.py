"""What the rows of a noisy slip count for, whichever curve is fitted to them."""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Float

from adhesion_jax.curves import Curve
from adhesion_jax.inference.descent import STRAIGHT, Problem, descended
from adhesion_jax.inference.expected_slip import expected_slip
from adhesion_jax.inference.grouping import evenly
from adhesion_jax.inference.posing import chosen_of, from_start, posed
from adhesion_jax.inference.rows import Rows, thinned
from adhesion_jax.inference.slip import SlipNoise
from adhesion_jax.inference.sums import Variance, huber, law_at

#: A residual below this share of the adhesion is due to the rounding of numbers, not to noise.
EXACT = 1e-10

#: Rounds of fit and of how much of the slip's noise acts, and the most rows of these; the shares of
#: the noise that are considered, and then such about the likeliest, nearer by half in each round;
#: and the values of sigma over the root mean square of the residual.
_WEIGHINGS, _WEIGHED_ROWS = 3, 5000
_ACTIVE, _NEARER = (0.0, 0.25, 0.5, 0.75, 1.0), np.array([-0.125, 0.0, 0.125])
_SIGMAS = np.geomspace(1e-3, 1.0, 60)


def alike(rows: Rows) -> Variance:
    """The variance of rows whose slip is exact, in any unit."""
    return Variance(1.0, 1 / rows.design, np.broadcast_to(0.0, rows.slip.shape))


def weighed(
    curve: Curve,
    start: Float[np.ndarray, " free"],
    rows: Rows,
    slip: SlipNoise,
    slip_is_velocity: bool,
) -> tuple[Rows, SlipNoise, Variance]:
    """Rows at the slips that are to be expected, the noise of slip that acts, and the variances.

    By the slope of one curve without a departure. They are the same for all curves that are fitted:
    with a slope of its own a curve could widen its own noise (Carroll and Ruppert 1988, chapter 3).
    """
    problem, _, _ = posed(curve, start, rows, slip_is_velocity)
    some = thinned(rows, _WEIGHED_ROWS)
    spread = chosen_of(slip.spread, some.slip.size)
    share, active = from_start(start), 1.0
    actives = (1.0,) if slip.given else _ACTIVE
    for turn in range(_WEIGHINGS):
        there, active, variance = _weighing(problem, share, some, spread, actives)
        share, _ = descended(problem, share, there, variance, STRAIGHT, turn > 0)
        if not slip.given:
            actives = np.clip(active + _NEARER / 2**turn, 0.0, 1.0)
    there, _, variance = _weighing(problem, share, rows, slip.spread, (active,))
    return there, slip._replace(sigma=active * slip.sigma, spread=active * slip.spread), variance


def _weighing(
    problem: Problem,
    share: np.ndarray,
    rows: Rows,
    spread: Float[np.ndarray, " rows"],
    actives: Iterable[float],
) -> tuple[Rows, float, Variance]:
    """Rows at the slips that are to be expected, how much of the slip's noise acts, and variances.

    These are sigma^2 over the design weight + (slope x standard deviation of the true slip)^2. Of
    the noise of standard deviation `spread` the share acts, among these, and sigma is such, as is
    likeliest for the residual, by Huber's function.
    """
    parameters = problem.parameters(share)
    floor = EXACT**2 * float(np.mean(rows.adhesion**2))
    best = -np.inf
    for active in actives:
        mean, scatter = expected_slip(rows.slip, active * spread)
        there = rows._replace(slip=mean)
        place = problem.curve, parameters, problem.span
        law, slope = law_at(there, *place, scatter, "by_slip")
        left, felt = rows.adhesion - law, (slope * scatter) ** 2
        few = evenly(left.size, _WEIGHED_ROWS)
        for square in max(float(np.mean(left**2)), floor) * _SIGMAS**2:
            row = square / rows.design[few] + felt[few]
            z = np.abs(left[few]) / np.sqrt(row)
            told = -float(np.sum(0.5 * np.log(row) + huber(z)))
            if told > best:
                relative = 1 / rows.design + felt / square
                variance = Variance(float(np.sqrt(square)), relative, scatter)
                best, found = told, (there, active, variance)
    return found
