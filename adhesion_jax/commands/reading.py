"""What every command that takes measurements does first: it reads them and says what it read."""

from collections.abc import Mapping, Sequence
from typing import Any

import click

from adhesion_jax.commands.progress import shown
from adhesion_jax.data import Measured
from adhesion_jax.data.corrections import corrections_of
from adhesion_jax.data.gaps import FEW
from adhesion_jax.data.reading import NotUnderstoodError
from adhesion_jax.library.reading import all_of
from adhesion_jax.report.measured.understood import columns_table, understood


def read(
    files: Sequence[str],
    columns: Mapping[str, object],
    known: Mapping[str, Any],
    few: float = FEW,
) -> list[Measured]:
    """The measurements of the files; what was understood of each is printed, refused or not.

    `known` are arguments of `corrections_of`, and `few` is that of `read_measured`.
    """
    corrections = corrections_of(**known)
    with shown() as progress:
        try:
            found = all_of(files, columns, corrections, progress, few)
        except NotUnderstoodError as refused:
            click.echo(f"Columns as understood so far:\n{columns_table(refused.understood)}\n")
            raise
    click.echo("\n\n".join(map(understood, found)) + "\n")
    return found
