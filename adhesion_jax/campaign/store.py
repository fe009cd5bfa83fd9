"""The file of the estimates of a campaign: one parquet file, one row group per table."""

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq


class EstimateWriter:
    """Appends tables of estimates to one parquet file, one row group per table.

    A column that a table does not have stays empty in its rows.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self._path, self._columns = path, columns
        self._writer: pq.ParquetWriter | None = None

    def append(self, rows: pd.DataFrame) -> None:
        rows = rows.reindex(columns=list(self._columns))
        table = pa.Table.from_pandas(rows, preserve_index=False)
        if self._writer is None:
            self._writer = pq.ParquetWriter(self._path, table.schema, compression="zstd")
        self._writer.write_table(table)

    def close(self) -> None:
        if self._writer is not None:
            self._writer.close()


def read_estimates(path: Path, columns: list[str], identifier: str) -> pd.DataFrame:
    """Some columns of the estimates of one identifier."""
    return pd.read_parquet(path, columns=columns, filters=[("identifier", "==", identifier)])
