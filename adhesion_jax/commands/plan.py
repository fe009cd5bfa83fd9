"""How far the slip must go, and how many samples it takes, to know the peak."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
import pandas as pd

from adhesion_jax.commands.progress import shown
from adhesion_jax.commands.reading import read
from adhesion_jax.curves import Law
from adhesion_jax.data.events import events_of
from adhesion_jax.effects.saved import load_law
from adhesion_jax.files import output_directory, staged, write_table
from adhesion_jax.library.identify import Identification, identify_chosen
from adhesion_jax.library.plan import PLAN_FILES, plan
from adhesion_jax.library.reading import citation_of
from adhesion_jax.measured.saved import load_curve
from adhesion_jax.planning.check import check_plan
from adhesion_jax.planning.plan import Plan
from adhesion_jax.report.plan.words import checked


def main(
    log: str | None,
    rail: str | None,
    curves: str | None,
    law: str | None,
    curve: tuple[str, ...] | None,
    columns: Mapping[str, object],
    known: Mapping[str, Any],
    dry_run: bool,
    events: bool | None,
    conditions: tuple[tuple[str, float], ...],
    check: int | None,
    seed: int,
    out: Path,
    **asked: object,
) -> None:
    """Write the plan for a rail, a curve, a law or a log, and where asked what simulations say."""
    source: str | Law | Identification | None = rail
    if log is not None:
        measured = read([log], columns, known)
        if dry_run:
            return
        chosen = events_of(measured, events)
        del measured  # nothing holds the log while curves are fitted to its events
        citation = citation_of(log)
        source = identify_chosen(chosen, curve, citation)
    elif curves is not None:
        source = load_curve(Path(curves), curve or ())
    elif law is not None:
        source = load_law(law)
    assert source is not None
    found = plan(source, conditions=dict(conditions), **asked)  # type: ignore[arg-type]
    words = f"{found}"
    with staged(output_directory(out), PLAN_FILES) as stage:
        found.write(stage)
        if check is not None:
            table = _checked(found.plan, check, seed)
            write_table(stage / "check.csv", table)
            words += f"\n\n{checked(table, check)}"
    click.echo(f"{words}\n\nWritten to {out}")


def _checked(planned: Plan, measurements: int, seed: int) -> pd.DataFrame:
    with shown() as progress:
        return check_plan(planned, measurements, seed, progress)
