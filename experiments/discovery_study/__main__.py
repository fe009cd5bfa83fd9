"""Measure how often the discovery is right: false claims, detection, confusions, random effects."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import pandas as pd

from adhesion_jax.command_line.command import run, start
from adhesion_jax.files import write_table
from experiments import campaigns
from experiments.discovery_study.judging import Discover, discovered, row
from experiments.discovery_study.rates import confusion, rates, shares
from experiments.discovery_study.report import (
    draw_confusion,
    draw_detection,
    draw_random,
    study_text,
)
from experiments.discovery_study.tasks import study_tasks
from experiments.study import Study, conduct, sized

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


@sized(SIZES, Path("out/discovery_study"))
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
) -> None:
    """The study of any `discover`, written to `out`.

    `sizes` are the arguments of `study_tasks`. Where other processes compute, they must be able to
    import `discover`; the rows are the same, save the times.
    """
    asked = {"what is studied": f"{discover.__module__}.{discover.__qualname__}"}
    folders = (Path(campaigns.__file__).parent, Path(__file__).parent)
    own = [path for folder in folders for path in sorted(folder.iterdir())]
    source = [path for path in own if path.suffix in (".py", ".toml")]
    job = Study(study_tasks(**sizes), partial(row, discover), sizes, asked, source)
    conduct(job, out, OWN_FILES, workers, resume, written)


def written(sets: pd.DataFrame, folder: Path) -> str:
    """The words of a study, whose tables and figures are written to the folder."""
    hits, removed, parts = rates(sets), shares(sets), set(sets["part"])
    write_table(folder / "rates.csv", hits)
    if "confusion" in parts:
        counts = confusion(sets)
        counts.to_csv(folder / "confusion.csv")
        draw_confusion(folder / "confusion.png", counts, hits)
        draw_detection(folder / "detection.png", hits)
    if "random" in parts:
        write_table(folder / "shares.csv", removed)
        draw_random(folder / "random.png", sets)
    return study_text(hits, removed, sets)


if __name__ == "__main__":
    run(main)
