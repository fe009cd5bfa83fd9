"""Speed beside what else computes the same, all in one run on one machine."""

import tempfile
from collections.abc import Mapping, Sequence
from ctypes import CDLL
from pathlib import Path

import click
import pandas as pd

from adhesion_jax import runtime
from adhesion_jax.command_line.command import SEED, Folder, run, start
from adhesion_jax.files import write_table
from experiments.command import bar, written
from experiments.speed import blocks, gpu, jobs, plants, recursions, scaling
from experiments.speed.report import draw_rates, draw_scaling, told
from experiments.speed.turns import Timed, rates


@click.command(context_settings={"show_default": True})
@click.option("--repeats", type=click.IntRange(min=1), default=5)
@click.option("--seed", type=SEED, default=0)
@click.option("--out", type=Folder(), default=Path("out/speed"))
def main(repeats: int, seed: int, out: Path) -> None:
    """Time identifiers, recursions, plants and whole jobs beside other libraries.

    Whole blocks on he2018-blocks beside scipy's differential evolution and others, recursions on
    streams of 10,000 runs beside NumPy, plants beside C; some of them on a GPU, where jax finds
    one. What is timed takes turns, `repeats` times, so that a machine whose speed drifts is fair to
    all; the median is reported, and its range.
    """
    start()
    # All but the jobs on one core: a process that may use two spends up to twice the CPU-seconds.
    cores = runtime.cores_of(runtime.CORES)
    runtime.take_core(cores[-1])
    with written(out, ("speed.csv", "speed.png", "speed_scaling.png")) as (stage, tell):
        with tempfile.TemporaryDirectory() as folder:
            table = _table(plants.compiled(Path(folder)), repeats, seed, cores)
        write_table(stage / "speed.csv", table)
        draw_rates(stage / "speed.png", table)
        draw_scaling(stage / "speed_scaling.png", table)
        tell(told(table))


def _table(
    library: CDLL | str, repeats: int, seed: int, cores: Sequence[int | None]
) -> pd.DataFrame:
    parts: list[tuple[str, str, str, Mapping[str, Timed]]] = [
        ("blocks", blocks.UNIT, blocks.PEER, blocks.entries(seed)),
        *(
            (part, recursions.UNIT, peer, entries)
            for (part, peer), entries in recursions.entries(seed).items()
        ),
        ("plants", plants.UNIT, plants.PEER, plants.entries(library)),
    ]
    total = sum((repeats + 1) * _count(part[3]) for part in parts)
    total += len(scaling.sizes()) + 1 + len(jobs.jobs())
    with bar("turn", total) as progress:
        found = [
            rates(part, unit, peer, entries, repeats, progress)
            for part, unit, peer, entries in parts
        ]
        found.append(scaling.table(repeats, seed, progress))
        found.append(gpu.table(repeats, seed))
        progress(gpu.PART)
        found.append(jobs.table(cores, progress))
    return pd.concat(found, ignore_index=True)


def _count(entries: Mapping[str, Timed]) -> int:
    return sum(entry.work is not None for entry in entries.values())


if __name__ == "__main__":
    run(main)
