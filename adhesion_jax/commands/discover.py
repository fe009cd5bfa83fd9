"""Which physical effect a law lacks in measured data."""

import json
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from adhesion_jax.commands.progress import shown
from adhesion_jax.commands.reading import read
from adhesion_jax.data.events import events_of
from adhesion_jax.data.gaps import FEW_OF_A_SEARCH
from adhesion_jax.data.runs import matching, to_runs
from adhesion_jax.files import output_directory
from adhesion_jax.library.discover import discover_in, sources_of
from adhesion_jax.simulation.simulator import simulate, write_set


def main(
    train: tuple[str, ...],
    tests: tuple[str, ...],
    curve: tuple[str, ...],
    seed: int,
    planted: tuple[str, ...] | None,
    slip_noise: float | None,
    correct: bool,
    events: bool | None,
    out: Path,
    columns: Mapping[str, object],
    known: Mapping[str, Any],
    dry_run: bool,
) -> None:
    """Write what a curve lacks in the runs, or in simulated ones where effects are planted."""
    if planted is None:
        measured = read(train, columns, known, FEW_OF_A_SEARCH)
        judged = read(tests, columns, known, FEW_OF_A_SEARCH) if tests else []
        if dry_run:
            return
    output_directory(out)
    if planted is not None:
        write_set(out, simulate(planted, seed=seed))
        train, tests = (str(out / "train.csv.gz"),), (str(out / "test.csv.gz"),)
        measured, judged = read(train, {}, {}), read(tests, {}, {})
    logs, judging = events_of(measured, events), events_of(judged, events) if judged else []
    # Nothing holds the logs while effects are searched in their events.
    del measured, judged
    used = " ".join(filter(None, (log.sentence for log in logs)))
    if used:
        click.echo(f"{textwrap.fill(used, 96)}\n")
    with shown() as progress:
        runs = to_runs([log.points for log in logs])
        test = matching(runs, to_runs([log.points for log in judging])) if judging else None
        sources = sources_of(logs, train)
        # Events alone are drawn in the end: the rows of other logs are held by the runs.
        del judging
        logs = [log for log in logs if log.events is not None]
        found = discover_in(
            runs, test, logs, sources, curve, seed, slip_noise, correct, progress, out
        )
    click.echo(f"{found}\n\nWritten to {out} in {found.findings.seconds:.0f} s")
    if planted is not None:
        truth = json.loads((out / "truth.json").read_text())
        click.echo(f"Planted: {', '.join(truth['effects']) or 'nothing'}")
