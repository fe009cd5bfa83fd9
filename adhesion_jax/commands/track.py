"""What online methods know of the largest adhesion after each sample of a log."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from adhesion_jax.commands.progress import shown
from adhesion_jax.commands.reading import read
from adhesion_jax.commands.record import columns_of, record
from adhesion_jax.data import check_curve
from adhesion_jax.library.track import METHODS, track


def main(
    log: str,
    identifiers: tuple[str, ...],
    initial_slope: float | None,
    events: bool | None,
    out: Path,
    columns: Mapping[str, object],
    known: Mapping[str, Any],
    dry_run: bool,
    asked: Mapping[str, object],
) -> None:
    """Write what the methods make of the log of a file, or of a set that ships."""
    (measured,) = read([log], columns, known)
    if dry_run:
        check_curve(measured)
        return
    with shown() as progress:
        found = track(
            measured,
            identifiers or METHODS,
            initial_slope,
            events=events,
            report=lambda done, total: progress("following", done / total),
            out=out,
        )
    record(out, asked, columns_of([measured]))
    click.echo(f"{found}\n\nWritten to {out}")
