"""`python -m experiments.discover`: which physical effect a law lacks in measured data."""

import json
from collections.abc import Sequence
from pathlib import Path

import click
from tqdm import tqdm

from adhesion_jax.commands.command import Folder, output_directory
from adhesion_jax.curves import CURVES
from adhesion_jax.data import SHIPPED
from adhesion_jax.data.runs import matching, read_runs
from adhesion_jax.discovery.engine import discover
from adhesion_jax.errors import InputError
from adhesion_jax.files import staged
from adhesion_jax.report.discovery.files import DISCOVERY_FILES, printed, write_discovery
from adhesion_jax.simulation.simulator import simulate, write_set


@click.command()
@click.argument("train", nargs=-1)
@click.option("--test", "tests", multiple=True, help="File of runs for the error before and after.")
@click.option("--base", default="auto", help=f"auto, or {', '.join(CURVES)}.", show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option(
    "--simulate",
    "planted",
    default=None,
    metavar="EFFECTS",
    help="Instead of TRAIN: a simulated campaign with these effects, by commas, or none.",
)
@click.option(
    "--slip-noise",
    type=click.FloatRange(min=0, min_open=True),
    default=None,
    help="Standard deviation of the noise of the wheel speed in m/s (of slip, where there is no "
    "vehicle speed); by default it is estimated.",
)
@click.option(
    "--out",
    type=Folder(),
    default=Path("out/discover"),
    help="Folder for report.html, report.md, report.json, law.json and figures.",
    show_default=True,
)
def main(
    train: tuple[str, ...],
    tests: tuple[str, ...],
    base: str,
    seed: int,
    planted: str | None,
    slip_noise: float | None,
    out: Path,
) -> None:
    """Find what an adhesion curve lacks in the runs of TRAIN, and what it is worth.

    TRAIN is one or more .csv, .csv.gz or .parquet files of the columns that experiments.identify
    takes, with a column run (or time_s, from whose gaps runs are told), or the name of a data set
    that ships with the package: eurosprinter, roller-rig. Nothing is fitted to the runs of --test.
    """
    if (planted is None) == (not train):
        raise InputError("Name the files of TRAIN, or a campaign by --simulate, but not both.")
    if planted is not None and tests:
        raise InputError("--test does not go with --simulate, which draws its own test runs.")
    output_directory(out)
    if planted is not None:
        names = [name.strip() for name in planted.split(",") if name.strip() not in ("", "none")]
        write_set(out, simulate(names, seed=seed))
        train, tests = (str(out / "train.csv.gz"),), (str(out / "test.csv.gz"),)
    with tqdm(total=100, unit="%", bar_format=_BAR, leave=False) as bar:

        def progress(words: str, share: float) -> None:
            bar.set_description_str(words)
            bar.update(100 * share - bar.n)

        progress("reading", 0.0)
        runs = read_runs(_paths(train))
        test = matching(runs, read_runs(_paths(tests))) if tests else None
        findings = discover(
            runs,
            test,
            base,
            seed,
            progress,
            source=", ".join(train),
            citation=_citation(train),
            slip_noise=slip_noise,
        )
        progress("writing the report", 0.97)
        with staged(out, DISCOVERY_FILES) as stage:
            write_discovery(stage, findings)
    click.echo(f"{printed(findings)}\n\nWritten to {out} in {findings.seconds:.0f} s")
    if planted is not None:
        truth = json.loads((out / "truth.json").read_text())
        click.echo(f"Planted: {', '.join(truth['effects']) or 'nothing'}")


_BAR = "{desc}: {percentage:3.0f} %|{bar}| {elapsed}<{remaining}"


def _paths(names: Sequence[str]) -> list[Path]:
    return [SHIPPED[name].path if name in SHIPPED else Path(name) for name in names]


def _citation(names: Sequence[str]) -> str:
    return " ".join(SHIPPED[name].citation for name in names if name in SHIPPED)
