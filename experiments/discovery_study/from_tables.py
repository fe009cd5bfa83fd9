"""The discovery as its studies ask for it: tables in, findings out."""

from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd

from adhesion_jax.data import RunSet, matching, read_runs
from adhesion_jax.discovery.engine import discover
from adhesion_jax.discovery.types import Findings


def discover_tables(train: pd.DataFrame, test: pd.DataFrame | None, seed: int) -> Findings:
    """The findings that a user gets from these tables as files; reading them is included."""
    with TemporaryDirectory() as folder:
        runs = _runs(Path(folder) / "train.parquet", train)
        other = None if test is None else matching(runs, _runs(Path(folder) / "test.parquet", test))
    return discover(runs, other, seed=seed)


def _runs(path: Path, table: pd.DataFrame) -> RunSet:
    table.to_parquet(path, index=False)
    return read_runs([path])
