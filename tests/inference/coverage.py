"""How often the intervals of an identification hold the truth, beside plain least squares.

    python tests/inference/coverage.py --sets 200 --cells white,slow --out coverage.csv --workers 2

A row of the file is one draw of a cell. Columns *_low and *_high are the ends of an interval of
95 %; ls_* is Burckhardt's curve by plain least squares.
"""

import argparse
import csv
import math
import os
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.optimize import least_squares
from scipy.stats import beta
from stranger_runs import CELLS, draw

#: A worker has one core: libraries read this when they are imported.
ONE_THREAD = {
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false",
}
QUANTITIES = ("mu_max", "slip_opt")
COLUMNS = (
    "cell",
    "seed",
    *(f"{name}{end}" for name in QUANTITIES for end in ("", "_low", "_high", "_true")),
    "ls_mu_max",
    "ls_slip_opt",
    "vetoes",
    "seconds",
    "error",
)


def plain_least_squares(frame: pd.DataFrame) -> tuple[float, float]:
    """Peak of c1 (1 - exp(-c2 s)) - c3 s by least squares, among slips up to the largest of all.

    Given c2 the other two are linear; they are found within their bounds by starting from several
    values of c2 (Burckhardt 1993, Fahrwerktechnik: Radschlupf-Regelsysteme).
    """
    slip, adhesion = frame["slip_ratio"].to_numpy(), frame["adhesion"].to_numpy()

    def curve(c: np.ndarray, s: np.ndarray) -> np.ndarray:
        return -c[0] * np.expm1(-c[1] * np.abs(s)) * np.sign(s) - c[2] * s

    fits = [
        least_squares(
            lambda c: curve(c, slip) - adhesion,
            (0.3, c2, 0.3),
            bounds=((0.0, 1.0, -5.0), (5.0, 1000.0, 20.0)),
            x_scale=(0.1, 30.0, 0.3),
        )
        for c2 in (20.0, 60.0, 180.0)
    ]
    c = min(fits, key=lambda fit: fit.cost).x
    grid = np.linspace(0.0, slip.max(), 20_001)
    values = curve(c, grid)
    return float(values.max()), float(grid[values.argmax()])


def one(name: str, seed: int) -> dict[str, object]:
    """The row of one draw; what the package raises is told in the column error."""
    import adhesion_jax as aj  # in the worker alone, once its environment says one thread

    cell = CELLS[name]
    frame = draw(cell, seed)
    row: dict[str, object] = dict.fromkeys(COLUMNS, "")
    row |= {"cell": name, "seed": seed}
    for quantity in QUANTITIES:
        row[f"{quantity}_true"] = getattr(cell.truth, quantity)
    row["ls_mu_max"], row["ls_slip_opt"] = plain_least_squares(frame)
    start = time.perf_counter()
    try:
        found = aj.identify(frame)
        for quantity in QUANTITIES:
            row[quantity] = float(getattr(found, quantity))
            low, high = getattr(found, f"{quantity}_interval")
            row |= {f"{quantity}_low": float(low), f"{quantity}_high": float(high)}
        row["vetoes"] = " ".join(map(str, getattr(found, "vetoes", ())))
    except Exception as error:
        row["error"] = f"{type(error).__name__}: {error}"
    row["seconds"] = time.perf_counter() - start
    return row


def clopper_pearson(hits: int, tries: int) -> tuple[float, float]:
    """Interval of 95 % of a share. Clopper and Pearson 1934, Biometrika 26."""
    if tries == 0:
        return 0.0, 1.0
    low = 0.0 if hits == 0 else beta.ppf(0.025, hits, tries - hits + 1)
    high = 1.0 if hits == tries else beta.ppf(0.975, hits + 1, tries - hits)
    return float(low), float(high)


def _rmse(error: pd.Series) -> float:
    return math.sqrt((error**2).mean())


def summary(rows: pd.DataFrame) -> pd.DataFrame:
    """A row a cell and quantity.

    A set without any peak has no interval of slip_opt: it counts in no_peak, not in the coverage of
    slip_opt. A set that ended in an error counts in errors alone.
    """
    made = []
    for cell, all_sets in rows.groupby("cell", sort=False):
        sets = all_sets[all_sets["error"] == ""]
        for name in QUANTITIES:
            ends = sets[[f"{name}_low", f"{name}_high"]].astype(float)
            # A largest adhesion always exists: where it has no interval, the truth was missed.
            known = ends.notna().all(axis=1) | (name == "mu_max")
            truth = sets[f"{name}_true"].astype(float)
            held = ends[f"{name}_low"].le(truth) & ends[f"{name}_high"].ge(truth)
            low, high = clopper_pearson(int(held.sum()), int(known.sum()))
            error = sets[name].astype(float) - truth
            made.append(
                {
                    "cell": cell,
                    "quantity": name,
                    "sets": len(sets),
                    "coverage": held[known].mean(),
                    "cp_low": low,
                    "cp_high": high,
                    "bias": error.mean(),
                    "rmse": _rmse(error),
                    "ls_rmse": _rmse(sets[f"ls_{name}"].astype(float) - truth),
                    "width": (ends[f"{name}_high"] - ends[f"{name}_low"]).median(),
                    "veto": (sets["vetoes"] != "").mean(),
                    "no_peak": sets["slip_opt"].astype(float).isna().mean(),
                    "errors": len(all_sets) - len(sets),
                    "seconds": sets["seconds"].astype(float).median(),
                }
            )
    return pd.DataFrame(made)


def measure(cells: Sequence[str], sets: int, first: int, workers: int, out: Path) -> pd.DataFrame:
    """All rows, each written to the file as soon as it is there."""
    os.environ.update(ONE_THREAD)  # which the workers inherit, before they import anything
    rows = []
    with (
        out.open("w", newline="", encoding="utf-8") as file,
        ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool,
    ):
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        # Seed by seed, so that an early end leaves every cell with as many sets.
        jobs = [
            pool.submit(one, cell, seed) for seed in range(first, first + sets) for cell in cells
        ]
        for job in as_completed(jobs):
            rows.append(job.result())
            writer.writerow(rows[-1])
            file.flush()
    order = {cell: place for place, cell in enumerate(cells)}
    rows.sort(key=lambda row: (order[str(row["cell"])], row["seed"]))
    return pd.DataFrame(rows)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=200, help="draws of every cell")
    parser.add_argument("--first", type=int, default=0, help="seed of the first draw")
    parser.add_argument("--cells", default=",".join(CELLS), help="their names, by commas")
    parser.add_argument("--out", type=Path, required=True, help="file with a row a draw")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    asked = parser.parse_args()
    cells = asked.cells.split(",")
    unknown = [cell for cell in cells if cell not in CELLS]
    if unknown:
        parser.error(f"there is no cell {', '.join(unknown)}; there are {', '.join(CELLS)}")
    rows = measure(cells, asked.sets, asked.first, asked.workers, asked.out)
    table = summary(rows)
    print(table.to_string(index=False, float_format=lambda value: f"{value:.4g}"))
    for error, sets in rows.loc[rows["error"] != "", "error"].value_counts().head(3).items():
        print(f"{sets} sets: {error}")


if __name__ == "__main__":
    main()
