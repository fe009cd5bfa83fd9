"""The discovery as its studies ask for it: tables in, findings out."""

from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

import pandas as pd

from adhesion_jax.discovery.findings import Findings


def discover_tables(train: pd.DataFrame, test: pd.DataFrame | None, seed: int) -> Findings:
    """What a user gets who has the tables as files, reading included."""
    read_runs = import_module("adhesion_jax.data").read_runs
    discover = import_module("adhesion_jax.discovery.engine").discover
    with TemporaryDirectory() as folder:
        paths = {}
        for name, table in (("train", train), ("test", test)):
            if table is not None:
                paths[name] = Path(folder) / f"{name}.csv"
                table.to_csv(paths[name], index=False, float_format="%.9g")
        sets = {name: read_runs([path]) for name, path in paths.items()}
    findings: Findings = discover(sets["train"], sets.get("test"), base="auto", seed=seed)
    return findings
