"""Measured records: their columns, reading them, and the sets that ship with the package."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from adhesion_jax.data.grouping import as_one as as_one
from adhesion_jax.data.reading import Measured as Measured
from adhesion_jax.data.reading import check_curve as check_curve
from adhesion_jax.data.reading import read_all as read_all
from adhesion_jax.data.reading import read_measured as read_measured
from adhesion_jax.data.reading import to_measured as to_measured
from adhesion_jax.data.reading import to_record as to_record
from adhesion_jax.data.runs import RunSet as RunSet
from adhesion_jax.data.runs import matching as matching
from adhesion_jax.data.runs import to_runs as to_runs


class Shipped(NamedTuple):
    """A data set that comes with the package, and who is to be cited for it."""

    path: Path
    citation: str


#: Command-line name to data set.
SHIPPED: Mapping[str, Shipped] = {
    name: Shipped(Path(__file__).with_name(one["file"]), one["citation"])
    for name, one in tomllib.loads(
        Path(__file__).with_name("shipped.toml").read_text(encoding="utf-8")
    ).items()
}
