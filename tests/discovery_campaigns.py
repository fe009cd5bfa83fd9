"""Campaigns of one size, so that all tests of discovery share compiled programs."""

import tempfile
from pathlib import Path

import jax
import numpy as np
import pandas as pd
from scipy.signal import lfilter

from adhesion_jax.curves.bent import BELOW_EFFECTS
from adhesion_jax.data import read_all, to_runs
from adhesion_jax.data.runs import in_blocks
from adhesion_jax.discovery.model.fitting import Setting, nearly_fitted, robustly_fitted
from adhesion_jax.discovery.model.packing import _APART
from adhesion_jax.discovery.model.problem import prepare
from adhesion_jax.discovery.search.state import Selection, settled
from adhesion_jax.effects.conditions import calendar_of

#: 17 runs of 100 points to train with, 7 to test on.
SIZE = {"runs": 24, "points": 100}

#: The campaigns of `campaign`: padded to the same arrays as those of SIZE.
RUNS, POINTS = 20, 100

#: Burckhardt's curve c1 (1 - exp(-c2 l)) - c3 l of the campaigns.
TRUE = (0.32, 60.0, 0.35)


def runs_of(table):
    """A table as a search takes it."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "runs.parquet"
        table.reset_index(drop=True).to_parquet(path)
        return in_blocks(to_runs(read_all([path])))


def problem_of(table):
    runs = runs_of(table)
    calendar, there = calendar_of(runs.record), np.arange(max(len(runs.weights), RUNS))
    there = there < len(runs.weights)
    record, worth = jax.tree.map(_with_runs, (runs.record, runs.weights))
    record = record._replace(mask=record.mask & there[:, None], fresh=record.fresh & there[:, None])
    return prepare(record, calendar, runs.blocks, worth, runs.named)


def _with_runs(values):
    """With masked runs after those that there are, up to the arrays that all tests share."""
    return np.pad(values, ((0, max(RUNS - len(values), 0)), (0, 0)), mode="edge")


def setting_of(table, sigma=0.01, spread=0.0):
    """A table with one standard deviation for all points, and one of the slip."""
    problem = problem_of(table)
    whole = spread + np.zeros(problem.points.shape)
    return Setting(problem, whole, np.sqrt(problem.points) / sigma, sigma, 1.0)


def alone(table, base="burckhardt", start=TRUE):
    """A curve fitted to a table with its departure, with the weights that its residual asks for."""
    return robustly_fitted(nearly_fitted(setting_of(table), base, start, ()))


def state_of(table, *accepted):
    """A search that has accepted these effects on Burckhardt's curve."""
    return settled(Selection(alone(table)), accepted)


def seen(null, adhesion):
    """What a model leaves of other adhesion [rows], to first order fitted to it."""
    fitted = null.fitted
    away = np.asarray(adhesion) - fitted.adhesion[null.inside]
    whole = fitted.setting.root[null.inside] * away
    return null._replace(residual=whole - null.basis @ (null.basis.T @ whole))


def factor_spreads(problem):
    """Prior standard deviations of the factors of a departure, then of braking.

    They are b/(2 j - 1), and none is above a tenth.
    """
    first = problem.bend / (2 * np.arange(BELOW_EFFECTS) + 1)
    whole = np.concatenate([first, _APART * first])[: problem.branches * BELOW_EFFECTS]
    return np.minimum(whole, 0.1)


def curve(slip, c=TRUE):
    size = np.abs(slip)
    return np.sign(slip) * (c[0] * -np.expm1(-c[1] * size) - c[2] * size)


def campaign(draw, runs=RUNS, points=POINTS, kind="traction"):
    """Runs of slip that rises and returns, at 10 Hz, without noise; three columns constant within.

    `warm` and `old` are numbers, `place` a name; `gust` and `load` move within runs.
    """
    run = np.repeat(np.arange(runs), points)
    time = np.tile(0.1 * np.arange(points), runs)
    top = draw.uniform(0.10, 0.15, runs)[run]
    slip = 0.001 + top * np.sin(np.pi * time / time.max()) ** 2
    if kind == "both":
        slip = np.where(run % 2, -slip, slip)
    gust = lfilter([np.sqrt(1 - 0.95**2)], [1, -0.95], draw.normal(size=(runs, points + 200)))
    return pd.DataFrame(
        {
            "run": run,
            "time_s": 300.0 * run + time,
            "slip_ratio": slip,
            "warm": draw.uniform(-1, 1, runs)[run],
            "old": draw.exponential(size=runs)[run],
            "place": np.array([*"abcd"])[draw.permutation(np.arange(runs) % 4)][run],
            "gust": gust[:, 200:].ravel(),
            "load": 9.0 + draw.normal(size=runs)[run] + 0.3 * np.sin(0.7 * time + run),
        }
    )


def noise(draw, runs=RUNS, points=POINTS, sigma=0.006, correlation=0.8, degrees=np.inf):
    """AR(1) within each run, of Student's t with these degrees of freedom."""
    if np.isinf(degrees):
        white = draw.normal(size=(runs, points + 50))
    else:
        white = draw.standard_t(degrees, size=(runs, points + 50)) * np.sqrt(1 - 2 / degrees)
    whole = lfilter([np.sqrt(1 - correlation**2)], [1, -correlation], white, axis=1)
    return sigma * whole[:, 50:].ravel()


def levels(draw, table, scatter=0.03):
    """A factor for each run."""
    return (1 + scatter * draw.normal(size=table["run"].nunique()))[table["run"]]
