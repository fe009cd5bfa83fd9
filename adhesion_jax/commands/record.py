"""How results came about, beside them: metadata.json, from which `adhesion rerun` repeats them."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from adhesion_jax import runtime
from adhesion_jax.data import Measured
from adhesion_jax.files import METADATA, staged, write_metadata

#: The columns of each file as they were understood.
Columns = Mapping[str, object]


def columns_of(files: Sequence[Measured]) -> Columns:
    """For JSON, which has null in the place of NaN."""
    return {one.name: json.loads(one.understood.to_json(orient="records")) for one in files}


def record(folder: Path, asked: Mapping[str, object], columns: Columns | None = None) -> None:
    """Write metadata.json: what was asked, how columns were understood, versions and machine.

    What a result has written there before stays.
    """
    path = folder / METADATA
    told = json.loads(path.read_text(encoding="utf-8")) if path.exists() else runtime.describe()
    understood = {"columns": columns} if columns else {}
    with staged(folder, [METADATA]) as stage:
        write_metadata(stage / METADATA, {**asked, **understood, **told})
