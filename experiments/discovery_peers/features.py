"""The input of the peers of the discovery: the best base curve, features, folds of runs."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Float

from adhesion_jax.curves import CURVES, Curve, with_free_values
from experiments.campaigns.base import refitted
from experiments.campaigns.runs import BASE_CURVES

#: Columns of the slip, which the base curve contains already: naming them names no cause.
OWN = ("base_adhesion", "slip_size")

#: Number of blocks that a log without runs is cut into; folds and tests go by them.
_BLOCKS = 12

#: How the parameters go with the level of adhesion and with the steepness of the rise, as powers.
_SCALES: Mapping[str, Mapping[str, tuple[int, int]]] = {
    "Burckhardt": {"c1": (1, 0), "c2": (0, 1), "c3": (1, 0)},
    "Kiencke": {"a0": (1, 1), "p1": (0, 1), "p2": (0, 2)},
    "PolachFalling": {"mu0": (1, 0), "stiffness": (1, 1)},
    "Exponential": {"b": (0, 1), "c": (1, 0)},
}


class Problem(NamedTuple):
    """Features and residual, folded to the side of traction: both change sign with slip."""

    columns: tuple[str, ...]
    train: np.ndarray  # [rows, columns]
    residual: np.ndarray  # [rows]
    runs: np.ndarray  # [rows]
    test: np.ndarray  # [rows of test, columns]


class Base(NamedTuple):
    train: np.ndarray  # adhesion of the best base curve, [rows]
    test: np.ndarray


def in_runs(table: pd.DataFrame) -> pd.DataFrame:
    """The table with a column of runs; where there is none, contiguous blocks stand for them."""
    if "run" in table:
        return table
    return table.assign(run=np.arange(len(table)) * _BLOCKS // len(table))


def fit_base(train: pd.DataFrame, test: pd.DataFrame) -> Base:
    """The base curve of the smallest BIC, by least squares from three starts."""
    slip, adhesion = (train[name].to_numpy(float) for name in ("slip_ratio", "adhesion"))
    level = float(np.quantile(np.abs(adhesion), 0.9)) / 0.3
    best: tuple[float, Curve] | None = None
    for family in BASE_CURVES:
        curve = CURVES[family]
        for steeper in (0.5, 1.0, 2.0):
            started = _scaled(curve, level, steeper)
            fitted, left = refitted(started, slip, adhesion, _conditions(train))
            score = len(train) * 2 * np.log(left) + len(curve.free) * np.log(len(train))
            if best is None or score < best[0]:
                best = (score, fitted)
    assert best is not None
    return Base(_evaluated(best[1], train), _evaluated(best[1], test))


def make_problem(train: pd.DataFrame, test: pd.DataFrame, base: Base, dynamic: bool) -> Problem:
    """Standardised features of both tables, the residual of the training table."""
    tables = [
        _features(table, adhesion, dynamic)
        for table, adhesion in ((train, base.train), (test, base.test))
    ]
    columns = [name for name in tables[0].columns.astype(str) if tables[0][name].std() > 0]
    centre, spread = tables[0][columns].mean(), tables[0][columns].std()
    features = [((table[columns] - centre) / spread).to_numpy(float) for table in tables]
    sign = np.sign(train["slip_ratio"].to_numpy(float))
    residual = sign * (train["adhesion"].to_numpy(float) - base.train)
    return Problem(tuple(columns), features[0], residual, train["run"].to_numpy(), features[1])


def _features(table: pd.DataFrame, base: np.ndarray, dynamic: bool) -> pd.DataFrame:
    known = [name for name in table if name not in ("run", "slip_ratio", "adhesion")]
    features = table[known].astype(float).copy()
    if "slip_velocity_mps" in features:
        features["slip_velocity_mps"] = features["slip_velocity_mps"].abs()
    slip = table["slip_ratio"].astype(float)
    features["mode"] = np.sign(slip)
    features["slip_size"], features["base_adhesion"] = slip.abs(), np.abs(base)
    if not dynamic:
        return features
    run = table["run"]
    for steps in (2, 5, 10):
        for name in OWN:
            late = features[name].groupby(run).shift(steps).fillna(features[name])
            features[f"{name}_change_over_{steps}"] = features[name] - late
    time = table["time_s"] - table.groupby("run")["time_s"].transform("first")
    speed = features["vehicle_speed_mps"]
    features["acceleration"] = speed.groupby(run).diff(5).fillna(0.0)
    step = time.groupby(run).diff().fillna(0.0)
    power = features["base_adhesion"] * features["slip_size"] * speed
    features["work"] = (power * step).groupby(run).cumsum()
    features["time_in_run"] = time
    if "sanding" in features:
        features["sand_before"] = (
            features["sanding"].groupby(run).transform(lambda flag: flag.ewm(halflife=30).mean())
        )
    return features


def folds(runs: np.ndarray, count: int = 4) -> list[np.ndarray]:
    """Rows of each fold, whole runs."""
    names = np.random.default_rng(0).permutation(np.unique(runs))
    return [np.flatnonzero(np.isin(runs, part)) for part in np.array_split(names, count)]


def _scaled(curve: Curve, level: float, steeper: float) -> Curve:
    powers = _SCALES[type(curve).__name__]
    scaled = [
        getattr(curve, name) * level**of_level * steeper**of_slope
        for name, (of_level, of_slope) in powers.items()
    ]
    whole = with_free_values(replace(curve, free=tuple(powers)), jnp.array(scaled))
    return replace(whole, free=curve.free)


def _conditions(table: pd.DataFrame) -> dict[str, Float[Array, " rows"]]:
    return {"vehicle_speed_mps": jnp.asarray(table["vehicle_speed_mps"].to_numpy(float))}


def _evaluated(curve: Curve, table: pd.DataFrame) -> np.ndarray:
    slip = jnp.asarray(table["slip_ratio"].to_numpy(float))
    return np.asarray(curve(slip, _conditions(table)))
