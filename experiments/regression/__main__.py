"""Hold the accuracy and the speed of every identifier against a baseline and say what moved."""

import sys
from pathlib import Path

import click
import pandas as pd
from tqdm import tqdm

from adhesion_jax import runtime
from adhesion_jax.command_line.command import Folder, run, start
from adhesion_jax.files import write_table
from adhesion_jax.identifiers import IDENTIFIERS
from experiments.command import written
from experiments.regression.compare import REGRESSIONS, compare, faster_of, moved_text, suspects
from experiments.regression.measuring import accuracy_steps, measure_accuracy, measure_speed
from experiments.regression.table import assemble, read_baseline

#: Runs in the baseline and in what is compared with it; the comparison rests on equal numbers.
RUNS = 1024

#: How often every identifier is timed, and a suspect again.
TURNS, TURNS_AGAIN = 5, 9

#: How many times more a suspect is timed, until it is as fast as before. A method that has become
#: slower is so every time; a machine that others use is slow for minutes.
ATTEMPTS = 4

#: Seeds of the baseline and of what is held against it: independent runs, the same every time.
BASELINE_SEED, CHECK_SEED = 0, 1


@click.command(context_settings={"show_default": True})
@click.option(
    "--baseline",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("results/baseline.csv"),
    help="The table to hold against; ratios of speed are best kept on one kind of processor.",
)
@click.option("--update", is_flag=True, help="Write the baseline anew and compare nothing.")
@click.option(
    "--out",
    type=Folder(),
    default=Path("out/regression"),
    help="Folder for the fresh table and the comparison.",
)
def main(baseline: Path, update: bool, out: Path) -> None:
    """Measure every identifier on a small fixed set; exit status 1 where one got worse."""
    start()
    before = None if update else read_baseline(baseline)
    bad = False
    names = (baseline.name,) if update else ("regression.csv", "comparison.csv")
    with written(baseline.parent if update else out, names) as (stage, tell):
        # On one core: a process that may use two spends up to three times the CPU-seconds.
        runtime.take_core(runtime.cores_of(runtime.CORES)[-1])
        fresh = _measured(BASELINE_SEED if update else CHECK_SEED, before)
        write_table(stage / names[0], fresh)
        if before is None:
            tell(f"The baseline is now {baseline}")
        else:
            compared = compare(before, fresh)
            write_table(stage / "comparison.csv", compared)
            tell(moved_text(compared))
            bad = bool(compared["verdict"].isin(REGRESSIONS).any())
    sys.exit(int(bad))


def _measured(seed: int, before: pd.DataFrame | None) -> pd.DataFrame:
    """The fresh table; who seems slower than before is timed again."""
    steps = accuracy_steps(IDENTIFIERS, RUNS) + (TURNS + 1) * len(IDENTIFIERS)
    with tqdm(total=steps, desc="compiling", unit="step", disable=None) as bar:

        def progress(name: str) -> None:
            bar.set_description(name)
            bar.update()

        accuracy = measure_accuracy(IDENTIFIERS, RUNS, seed, progress)
        fresh = assemble(accuracy, measure_speed(IDENTIFIERS, TURNS, progress))
        for _ in range(ATTEMPTS):
            slow = suspects(compare(before, fresh)) if before is not None else ()
            if not slow:
                break
            bar.total += (TURNS_AGAIN + 1) * len(slow)
            again = {name: IDENTIFIERS[name] for name in slow}
            fresh = faster_of(fresh, measure_speed(again, TURNS_AGAIN, progress))
    return fresh


if __name__ == "__main__":
    run(main)
