"""Where a campaign's results are kept: written whole or not at all."""

import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq


@contextmanager
def staged(directory: Path) -> Iterator[Path]:
    """A folder to write into whose files appear in `directory` when all are complete.

    Files of the same names are replaced, others are left alone. After an error nothing appears.
    """
    with tempfile.TemporaryDirectory(dir=directory, prefix=".partial-") as name:
        stage = Path(name)
        yield stage
        for file in sorted(stage.iterdir()):
            os.replace(file, directory / file.name)


class EstimateWriter:
    """Appends tables of estimates to one parquet file, a row group a table."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._writer: pq.ParquetWriter | None = None

    def append(self, rows: pd.DataFrame) -> None:
        table = pa.Table.from_pandas(rows, preserve_index=False)
        if self._writer is None:
            self._writer = pq.ParquetWriter(self._path, table.schema, compression="zstd")
        self._writer.write_table(table)

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()


def write_table(path: Path, table: pd.DataFrame) -> None:
    """As CSV at full precision; what does not apply is left empty."""
    table.to_csv(path, index=False)


def write_metadata(path: Path, metadata: Mapping[str, object]) -> None:
    path.write_text(json.dumps(metadata, indent=2) + "\n")


def read_estimates(path: Path, columns: list[str], identifier: str) -> pd.DataFrame:
    """Some columns of the estimates of one identifier."""
    return pd.read_parquet(path, columns=columns, filters=[("identifier", "==", identifier)])
