"""What results share: numbers that mean the same in a program of another precision, and HTML."""

import html
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Protocol, TypeVar, runtime_checkable

import jax
import numpy as np
import pandas as pd

from adhesion_jax.files import output_directory, staged
from adhesion_jax.report.page import Table

T = TypeVar("T")


@runtime_checkable
class _Writes(Protocol):
    def write(self, folder: Path) -> None: ...


W = TypeVar("W", bound=_Writes)


def written(found: W, out: str | PathLike[str] | None, files: Sequence[str]) -> W:
    """The result, whose files, of which these are possible, are in the folder `out` if it is named.

    They appear there when all are complete, in the place of those of an earlier result.
    """
    if out is not None:
        with staged(output_directory(Path(out)), files) as stage:
            found.write(stage)
    return found


def of_numbers(result: T) -> T:
    """The result with numbers of Python and arrays of NumPy in place of arrays of jax.

    Those lose digits when they are read where jax is in single precision, and a law made of them
    cannot be called in another precision.
    """

    def without_jax(leaf: Any) -> Any:
        if not isinstance(leaf, (jax.Array, np.generic)):
            return leaf
        return np.asarray(leaf) if leaf.ndim else leaf.item()

    found: T = jax.tree.map(without_jax, result)
    return found


def text_html(text: str) -> str:
    return f"<pre style='white-space: pre-wrap'>{html.escape(text)}</pre>"


def table_html(table: Table) -> str:
    return pd.DataFrame(list(table.rows), columns=list(table.headings)).to_html(index=False)
