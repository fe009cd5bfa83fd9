"""Simulated campaigns of one size, so that all tests of discovery share compiled programs."""

import tempfile
from pathlib import Path

from adhesion_jax.data import read_runs
from adhesion_jax.discovery.model.problem import prepare
from adhesion_jax.effects.conditions import calendar_of

#: 17 runs of 100 points to train with, 7 to test on.
SIZE = {"runs": 24, "points": 100}


def runs_of(table):
    """A table as it is read from a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "runs.parquet"
        table.reset_index(drop=True).to_parquet(path)
        return read_runs([path])


def problem_of(table):
    runs = runs_of(table)
    record = runs.record
    return prepare(record, calendar_of(record), runs.blocks)
