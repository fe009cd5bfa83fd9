"""What results share: numbers that mean the same in a program of another precision, and HTML."""

import html
from typing import Any, TypeVar

import jax
import numpy as np
import pandas as pd

from adhesion_jax.report.page import Table

T = TypeVar("T")


def of_numbers(result: T) -> T:
    """The result with numbers of Python and arrays of NumPy in place of arrays of jax.

    Those lose digits when they are read where jax is in single precision, and a law made of them
    cannot be called in another precision.
    """

    def without_jax(leaf: Any) -> Any:
        if not isinstance(leaf, jax.Array):
            return leaf
        return np.asarray(leaf) if leaf.ndim else leaf.item()

    found: T = jax.tree.map(without_jax, result)
    return found


def text_html(text: str) -> str:
    return f"<pre style='white-space: pre-wrap'>{html.escape(text)}</pre>"


def table_html(table: Table) -> str:
    return pd.DataFrame(list(table.rows), columns=list(table.headings)).to_html(index=False)
