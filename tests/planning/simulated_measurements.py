"""Whether measurements scatter as a plan says: simulated ones, fitted as `identify` does."""

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Bool, Float

from adhesion_jax.curves import Conditions, Law, Scalar, free_values
from adhesion_jax.inference.noise import RunNoise
from adhesion_jax.optim.levenberg_marquardt import fit
from adhesion_jax.planning.plan import Excitation, Plan, weights_under
from adhesion_jax.planning.truth import Truth, curve_of, sensitivity_of, with_parameters
from experiments.campaigns.simulator import noise_of_runs

#: Number of cells that are checked, and the largest relative standard error of slip_opt in them:
#: a plan is one of small errors.
CELLS, _SMALL = 6, 0.05

#: Simulated measurements that are fitted at a time, and the largest number of steps of a fit.
_TOGETHER, _STEPS = 250, 50


def check_plan(plan: Plan, measurements: int, seed: int) -> pd.DataFrame:
    """Six cells of a plan of sweeps, evenly chosen among those that know slip_opt to 5 %.

    Each cell is measured `measurements` times by simulation. Columns: largest_slip, samples, runs,
    measurements; of mu_max the relative standard error as planned and as simulated, their ratio
    (simulated over planned) with its standard error, and the bias in standard errors; failed, the
    number of fits that did not end at a peak.
    """
    cells = np.argwhere(plan.errors[..., 1] <= _SMALL)
    chosen = np.unique(np.linspace(0, len(cells) - 1, min(CELLS, len(cells))).astype(int))
    of = plan.planner
    rows = []
    for number, (i, j) in enumerate(cells[chosen].tolist()):
        excitation, largest = of.design(plan.samples[j]), float(plan.largest_slips[i])
        generator = np.random.default_rng([seed, number])
        found = estimates(of.truth, of.noise, excitation, largest, measurements, generator)
        known = found[np.isfinite(found)]
        planned, simulated = plan.errors[i, j, 0], known.std(ddof=1) / of.peak.mu_max
        ratio = simulated / planned
        rows.append(
            {
                "largest_slip": largest,
                "samples": round(excitation.samples),
                "runs": round(excitation.runs),
                "measurements": measurements,
                "planned": planned,
                "simulated": simulated,
                "ratio": ratio,
                "ratio_se": ratio / np.sqrt(2 * (known.size - 1)),
                "bias": (known.mean() / of.peak.mu_max - 1) / planned,
                "failed": found.size - known.size,
            }
        )
    return pd.DataFrame(rows)


def estimates(
    truth: Truth,
    noise: RunNoise,
    excitation: Excitation,
    largest_slip: float,
    measurements: int,
    generator: np.random.Generator,
) -> Float[np.ndarray, " measurements"]:
    """The mu_max of each simulated measurement; NaN where a fit fails.

    The fit is by least squares, with the weights of the plan. Errors of the slip are in the slips
    that it is given.
    """
    slip = largest_slip * excitation.share
    sensitivity = sensitivity_of(truth, slip)
    root, runs = np.sqrt(weights_under(noise, sensitivity)), round(excitation.repeats)
    as_mean = noise.slip_noise == 0  # runs at the same slips are as good as their mean
    found = []
    for _ in range(-(-measurements // _TOGETHER)):
        shape = (_TOGETHER, runs, slip.size)
        measured_slip = slip + noise.slip_noise * generator.standard_normal(shape)
        mean = np.broadcast_to(sensitivity.adhesion, shape)
        adhesion = mean + noise_of_runs(noise, mean, generator)
        if as_mean:
            measured_slip = measured_slip[:, :1]
            adhesion = adhesion.mean(axis=1, keepdims=True)
        mu_max, good = _fitted(
            truth.law, measured_slip, adhesion, root, truth.conditions, truth.slip_limit
        )
        found.append(np.where(good, mu_max, np.nan))
    return np.concatenate(found)[:measurements]


@jax.jit
def _fitted(
    law: Law,
    slips: Float[Array, "measurements runs points"],
    adhesions: Float[Array, "measurements runs points"],
    root: Float[Array, " points"],
    conditions: Conditions,
    slip_limit: Scalar,
) -> tuple[Float[Array, " measurements"], Bool[Array, " measurements"]]:
    """Mu_max of each fit from the truth, and whether it ended at a least sum that has a peak."""

    def one(
        slip: Float[Array, "runs points"], adhesion: Float[Array, "runs points"]
    ) -> tuple[Array, Array]:
        def misfit(values: Float[Array, " free"]) -> Float[Array, " samples"]:
            away = with_parameters(law, values)(slip, conditions) - adhesion
            return (root * away).ravel()

        start = free_values(curve_of(law))
        anywhere = jnp.full_like(start, jnp.inf)
        found = fit(misfit, start, -anywhere, anywhere, _STEPS)
        peak = with_parameters(law, found.x).peak(conditions, slip_limit)
        return peak.adhesion, peak.found & found.converged

    mu_max, good = jax.vmap(one)(slips, adhesions)
    return mu_max, good
