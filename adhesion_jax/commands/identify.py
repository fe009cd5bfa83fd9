"""Which adhesion curve measured points follow."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from adhesion_jax.commands.progress import shown
from adhesion_jax.commands.reading import read
from adhesion_jax.data.events import events_of
from adhesion_jax.library.identify import identify_chosen, with_groups
from adhesion_jax.library.reading import citation_of


def main(
    files: tuple[str, ...],
    curve: tuple[str, ...],
    events: bool | None,
    by: str | None,
    slip_noise: float | None,
    out: Path,
    columns: Mapping[str, object],
    known: Mapping[str, Any],
    dry_run: bool,
) -> None:
    """Write what the measured points of files, or of sets that ship, say of a curve, or all."""
    measured = read(files, with_groups(columns, by), known)
    if dry_run:
        return
    # Nothing holds the log while the curves are fitted to its events.
    logs = events_of(measured, events)
    del measured
    curves = None if "all" in curve else curve
    citation = " ".join(filter(None, map(citation_of, files)))
    with shown() as progress:
        found = identify_chosen(logs, curves, citation, by, slip_noise, progress, out)
    click.echo(f"{found}\n\nWritten to {out}")
