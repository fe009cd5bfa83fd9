"""`adhesion discover`: which physical effect a law lacks in measured data."""

import json
import textwrap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from adhesion_jax.command_line.catalogue import catalogue
from adhesion_jax.command_line.command import SEED, Names, begin, command, out_folder
from adhesion_jax.command_line.listing import listing
from adhesion_jax.command_line.progress import shown
from adhesion_jax.command_line.reading import Log, read, reading, slip_events, slip_noise
from adhesion_jax.command_line.record import record
from adhesion_jax.errors import InputError
from adhesion_jax.plugins import Part

NAMES = catalogue().names

_RUNS = Log(NAMES["data"])


class Plantable(Names):
    """Names of the package, of --effects, or parts FILE.py:NAME."""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        own = ctx.params.get("effects")
        names = [part.name for part in own] if isinstance(own, tuple) else []
        asked = Names((*self.names, *names), self.kind).convert(value, param, ctx)
        if "none" in asked and len(asked) > 1:
            raise InputError(f"--simulate {value} has none beside others; name one of both.")
        return asked


@command(
    "discover roller-rig",
    "discover train.csv --test test.csv --effects mine.py:Mine --out out/mine",
    "discover --simulate humidity,patch",
)
@click.argument("train", type=_RUNS, nargs=-1)
@reading
@slip_events
@click.option(
    "--test",
    "tests",
    type=_RUNS,
    multiple=True,
    help="File of runs for the error before and after.",
)
@click.option(
    "--curve",
    type=Names((*NAMES["curves"], "auto"), "curve"),
    default="auto",
    help=f"Base curves to choose from: auto, {', '.join(NAMES['curves'])}, or FILE.py:NAME, "
    "divided by commas.",
)
@click.option("--seed", type=SEED, default=0)
@click.option(
    "--effects",
    type=Names((), "effect"),
    is_eager=True,  # their names may be planted
    metavar="FILE.py:NAME[,...]",
    help="Effects of your own, which are searched for beside those of the package.",
)
@click.option(
    "--simulate",
    "planted",
    type=Plantable((*NAMES["effects"], "none"), "effect"),
    metavar="EFFECTS",
    help="Instead of TRAIN: a simulated campaign with these effects, by commas, or none.",
)
@slip_noise
@click.option(
    "--correct",
    is_flag=True,
    help="Where boosted trees predict what the law leaves, predict --test with them as well.",
)
@out_folder("discover", "report.html, report.md, report.json, law.json and figures")
@listing(data=NAMES["data"], curves=NAMES["curves"], effects=NAMES["effects"])
def main(
    train: tuple[str, ...],
    tests: tuple[str, ...],
    curve: tuple[Any, ...],
    seed: int,
    effects: tuple[Part, ...] | None,
    planted: tuple[Any, ...] | None,
    slip_noise: float | None,
    correct: bool,
    events: bool | None,
    out: Path,
    columns: Mapping[str, object],
    known: Mapping[str, Any],
    dry_run: bool,
) -> None:
    """Find what an adhesion curve lacks in the runs of TRAIN, and what it is worth.

    TRAIN is one or more files of the columns that adhesion identify takes, with a column run (or
    time_s, from whose gaps runs are told), or the name of a data set that ships with the package:
    eurosprinter, roller-rig. Nothing is fitted to the runs of --test.
    """
    if (planted is None) == (not train):
        raise InputError("Name the files of TRAIN, or a campaign by --simulate, but not both.")
    if planted is not None and (tests or columns or known or dry_run):
        raise InputError(
            "--test, --dry-run and what columns and sensors are do not go with --simulate, which "
            "draws runs of its own."
        )
    _, curves, planted = begin(effects, curve, planted)
    from adhesion_jax.data.events import events_of
    from adhesion_jax.data.runs import matching, to_runs
    from adhesion_jax.files import output_directory
    from adhesion_jax.library.discover import discover_in, sources_of
    from adhesion_jax.library.results import columns_of
    from adhesion_jax.simulation.simulator import simulate, write_set

    if planted is not None:
        names = tuple(name for name in planted if name != "none")
        write_set(output_directory(out), simulate(names, seed=seed))
        train, tests = (str(out / "train.csv.gz"),), (str(out / "test.csv.gz"),)
    measured = read(train, columns, known, for_search=True)
    judged = read(tests, columns, known, for_search=True) if tests else []
    if dry_run:
        return
    output_directory(out)
    logs, judging = events_of(measured, events), events_of(judged, events) if judged else []
    understood = columns_of([*measured, *judged])
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
        asked = curves, seed, slip_noise, correct, progress, out
        found = discover_in(runs, test, logs, sources, understood, *asked)
    record(out)
    click.echo(f"{found}\n\nWritten to {out} in {found.findings.seconds:.0f} s")
    if planted is not None:
        truth = json.loads((out / "truth.json").read_text())
        click.echo(f"Planted: {', '.join(truth['effects']) or 'nothing'}")
