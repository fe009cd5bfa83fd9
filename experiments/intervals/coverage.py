"""How often the one answer of an identification holds the true peak, over simulated records."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from scipy.stats import binomtest

from adhesion_jax.campaign.pool import Processes
from adhesion_jax.curves import CURVES, Curve
from adhesion_jax.inference.noise import RunNoise
from adhesion_jax.measured.answer import answered, fit_curves, searched
from adhesion_jax.records import Record
from experiments.campaigns.noise import noise_of_runs
from experiments.intervals.truths import KNOWN, UNKNOWN, Truth

#: Runs of a record, samples of a run, samples a second.
RUNS, SAMPLES, RATE_HZ = 12, 200, 10.0

#: Largest slip of a run; standard deviation of adhesion.
LARGEST_SLIP, SIGMA = 0.15, 0.01

#: The curves that are offered: those that need no column beside the slip.
OFFERED: Mapping[str, Curve] = {name: curve for name, curve in CURVES.items() if not curve.NEEDS}


class Cell(NamedTuple):
    """What is simulated: a true curve, and the noise of its records."""

    truth: str  # `known`, or a name of UNKNOWN
    noise: str
    size: RunNoise = RunNoise(SIGMA)


KNOWN_CELLS = (
    Cell("known", "white"),
    Cell("known", "AR(1) 0.5", RunNoise(SIGMA, 0.5)),
    Cell("known", "AR(1) 0.95", RunNoise(SIGMA, 0.95)),
    Cell("known", "run scatter 1 %", RunNoise(SIGMA, run_scatter=0.01)),
    Cell("known", "slow level 3 %", RunNoise(SIGMA, slow_level=0.03, slow_rows=100)),
    Cell("known", "slip noise", RunNoise(SIGMA, slip_noise=0.002)),
)
UNKNOWN_CELLS = tuple(Cell(name, "white") for name in UNKNOWN)


def coverage_study(
    cells: Sequence[Cell], sets: int, progress: Callable[[str], None], workers: int = 1
) -> pd.DataFrame:
    """A row for each record set of each cell: the answer, and whether it holds the true peak."""
    tasks = [(cell, seed) for cell in cells for seed in range(sets)]
    rows = []
    with Processes(workers).mapped(one_set, tasks) as results:
        for (cell, _), row in zip(tasks, results, strict=True):
            rows.append(row)
            progress(f"{cell.truth}, {cell.noise}")
    return pd.DataFrame(rows)


def one_set(cell: Cell, seed: int) -> dict[str, object]:
    """Simulate one record set, identify it as `identify` does, and judge the one answer.

    The global search of the least squares start is made once for each curve and truth, on points
    without noise: what is studied is the interval, not the search. Whether the slip has noise is
    asked of the data where it has.
    """
    truth = truth_of(cell)
    record = drawn(cell, truth, seed)
    run = np.repeat(np.arange(RUNS), SAMPLES)
    asked = None if cell.size.slip_noise else 0.0
    with jax.enable_x64(True):
        fits = fit_curves(OFFERED, record, run, False, asked, starts=_searched_once(cell.truth))
    answer = answered(fits.curves)
    row: dict[str, object] = {"truth": cell.truth, "noise": cell.noise, "set": seed}
    for name, found, true in (
        ("mu_max", answer.mu_max, truth.mu_max),
        ("slip_opt", answer.slip_opt, truth.slip_opt),
    ):
        row |= {name: found.value, f"{name}_lo": found.low, f"{name}_hi": found.high}
        row[f"{name}_true"] = true
        row[f"{name}_held"] = bool(found.low <= true <= found.high)
    best = max(answer.weights, key=lambda name: answer.weights[name])
    return row | {
        "heaviest": best,
        "weight": answer.weights[best],
        "slip_noise": fits.curves[best].noise.slip_noise,
        "degrees": fits.curves[best].degrees,
        "not_converged": sum(not fit.converged for fit in fits.curves.values()),
    }


def truth_of(cell: Cell) -> Truth:
    return KNOWN if cell.truth == "known" else UNKNOWN[cell.truth]


def drawn(cell: Cell, truth: Truth, seed: int) -> Record:
    """Each run goes up to the largest slip and back; all have the same programme of slip."""
    generator = np.random.default_rng([seed, *cell.truth.encode(), *cell.noise.encode()])
    slip = np.tile(_programme(), RUNS)
    mean = truth.adhesion(slip)
    noise = noise_of_runs(cell.size, mean.reshape(RUNS, SAMPLES), generator).ravel()
    measured = slip + cell.size.slip_noise * generator.standard_normal(slip.size)
    return _record(measured, mean + noise)


def _programme() -> np.ndarray:
    half = np.linspace(0.002, LARGEST_SLIP, SAMPLES // 2)
    return np.concatenate([half, half[::-1]])


def _record(slip: np.ndarray, adhesion: np.ndarray) -> Record:
    every = jnp.ones(slip.size, dtype=bool)
    time = jnp.asarray(np.tile(np.arange(SAMPLES) / RATE_HZ, RUNS))
    return Record(jnp.asarray(slip), jnp.asarray(adhesion), every, every, {"time_s": time})


@cache
def _searched_once(truth: str) -> Mapping[str, np.ndarray]:
    slip = np.tile(_programme(), RUNS)
    exact = _record(slip, truth_of(Cell(truth, "")).adhesion(slip))
    return searched(OFFERED, exact)


def coverage_rates(rows: pd.DataFrame) -> pd.DataFrame:
    """For each cell, and for the unknown curves together: coverage, its interval, and the width.

    Coverage with its 95 % interval after Clopper and Pearson 1934; the width is the median, and
    relative to that of the known curve in white noise.
    """
    unknown = rows[rows["truth"] != "known"]
    keys = rows[["truth", "noise"]].drop_duplicates().itertuples(index=False, name=None)
    groups = [(*key, rows[(rows["truth"] == key[0]) & (rows["noise"] == key[1])]) for key in keys]
    if len(unknown):
        groups.append(("not among those fitted", "white", unknown))
    usual = rows[(rows["truth"] == "known") & (rows["noise"] == "white")]
    found = []
    for truth, noise, part in groups:
        for quantity in ("mu_max", "slip_opt"):
            held, sets = int(part[f"{quantity}_held"].sum()), len(part)
            interval = binomtest(held, sets).proportion_ci(method="exact")
            width = (part[f"{quantity}_hi"] - part[f"{quantity}_lo"]).median()
            narrow = (usual[f"{quantity}_hi"] - usual[f"{quantity}_lo"]).median()
            error = part[quantity] - part[f"{quantity}_true"]
            found.append(
                {
                    "truth": truth,
                    "noise": noise,
                    "quantity": quantity,
                    "sets": sets,
                    "coverage": held / sets,
                    "low": interval.low,
                    "high": interval.high,
                    "bias": float(error.mean()),
                    "rmse": float(np.sqrt((error**2).mean())),
                    "width": float(width),
                    "width_ratio": float(width / narrow) if len(usual) else np.nan,
                }
            )
    return pd.DataFrame(found)
