"""Measure how often the discovery is right: false claims, detection, confusions, random effects."""

import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import click
import pandas as pd

from adhesion_jax.command_line.command import SEED, Folder, run, start
from adhesion_jax.errors import InputError
from adhesion_jax.files import output_directory, write_metadata, write_table
from experiments import campaigns
from experiments.command import described
from experiments.discovery_study.rates import confusion, rates, shares
from experiments.discovery_study.report import (
    draw_confusion,
    draw_detection,
    draw_random,
    study_text,
)
from experiments.discovery_study.running import Discover, discovered, row
from experiments.discovery_study.tasks import study_tasks
from experiments.study import Study, studied

OWN_FILES = (
    *("sets.csv", "rates.csv", "confusion.csv", "shares.csv", "metadata.json"),
    *("detection.png", "confusion.png", "random.png"),
)

#: Options that tell how many sets are made: their defaults and help.
SIZES: Mapping[str, tuple[int, str]] = {
    "null": (200, "Sets with nothing hidden in them; the noise of half of them is slow."),
    "powers": (10, "Sets of each effect and strength."),
    "pairs": (24, "Sets with two effects of different families."),
    "random": (100, "Sets with an effect that is a random smooth function of one or two columns."),
    "logs": (0, "Logs of each kind, with nothing hidden but the noise of the slip."),
    "log-effects": (0, "Logs with each of three effects, the kinds of logs by turns."),
}


def _sized(command: Callable[..., None]) -> Callable[..., None]:
    """The command with the options of SIZES."""
    for name, (default, words) in reversed([*SIZES.items()]):
        size = click.IntRange(min=0)
        command = click.option(f"--{name}", type=size, default=default, help=words)(command)
    return command


@click.command(context_settings={"show_default": True})
@_sized
@click.option(
    "--workers",
    type=click.IntRange(min=1),
    default=1,
    help="Processes; the results do not depend on their number.",
)
@click.option("--seed", type=SEED, default=0)
@click.option("--resume", is_flag=True, help="Compute what an interrupted study left over.")
@click.option("--out", type=Folder(), default=Path("out/discovery_study"))
def main(workers: int, resume: bool, out: Path, **sizes: int) -> None:
    """Run the discovery on simulated sets and count what it gets right."""
    start()
    study(sizes, out, discovered, workers, resume)


def study(
    sizes: Mapping[str, int],
    out: Path,
    discover: Discover,
    workers: int = 1,
    resume: bool = False,
) -> pd.DataFrame:
    """The study of any `discover`, written to `out`; its rates.

    `sizes` are the arguments of `study_tasks`. Where other processes compute, they must be able to
    import `discover`; the rows are the same, save the times.
    """
    tasks = study_tasks(**sizes)
    if not tasks:
        raise InputError("A study of no sets says nothing; give --null or --powers above 0.")
    directory = output_directory(out)
    began = time.perf_counter()
    asked = {f"--{name.replace('_', '-')}": str(size) for name, size in sizes.items()}
    asked["what is studied"] = f"{discover.__module__}.{discover.__qualname__}"
    folders = (Path(campaigns.__file__).parent, Path(__file__).parent)
    own = [path for folder in folders for path in sorted(folder.iterdir())]
    source = [path for path in own if path.suffix in (".py", ".toml")]
    job = Study(tasks, partial(row, discover), asked, source)
    with studied(job, directory, OWN_FILES, workers, resume) as (sets, stage):
        hits, removed = rates(sets), shares(sets)
        write_table(stage / "sets.csv", sets)
        write_table(stage / "rates.csv", hits)
        parts = {task.part for task in tasks}
        if "confusion" in parts:
            counts = confusion(sets)
            counts.to_csv(stage / "confusion.csv")
            draw_confusion(stage / "confusion.png", counts, hits)
            draw_detection(stage / "detection.png", hits)
        if "random" in parts:
            write_table(stage / "shares.csv", removed)
            draw_random(stage / "random.png", sets)
        config = {**sizes, "workers": workers, "resumed": resume}
        write_metadata(stage / "metadata.json", described(config, began))
    click.echo(study_text(hits, removed, sets))
    click.echo(f"\nWritten to {directory} in {time.perf_counter() - began:.0f} s")
    return hits


if __name__ == "__main__":
    run(main)
