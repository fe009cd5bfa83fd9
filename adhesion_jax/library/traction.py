"""`traction_control`: a published traction control system on its plant, or with other parts."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from adhesion_jax import runtime
from adhesion_jax.campaign.cluster import pool_of
from adhesion_jax.campaign.store import read_all, write_rows
from adhesion_jax.campaign.traction import (
    WHOLE,
    Job,
    Judged,
    Named,
    added,
    content,
    job_of,
    judge,
    judged,
)
from adhesion_jax.errors import InputError
from adhesion_jax.files import METADATA, output_directory, write_metadata, write_table
from adhesion_jax.library.results import aligned, recorded, steps_told, text_html
from adhesion_jax.library.shards import check_numbers, compute, extended, opened_for, step_of
from adhesion_jax.report.rendering import write_page
from adhesion_jax.report.traction.operating_point import animate_operating_point, operating_point
from adhesion_jax.report.traction.page import traction_page
from adhesion_jax.report.traction.panels import draw, shown
from adhesion_jax.report.traction.systems import SUBJECTS
from adhesion_jax.runtime import as_in_commands
from adhesion_jax.traction.controllers import CONTROLLERS
from adhesion_jax.traction.observers import OBSERVERS
from adhesion_jax.traction.plants.reading import PlantFile, read_plant, shipped
from adhesion_jax.traction.seekers import SEEKERS
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import NO_SEEKER, Case, System, with_parts
from adhesion_jax.wording import listed

_POINT = "operating_point"
_POINT_CAPTION = "The operating point over the adhesion curves while the surface changes."

#: All that may be written, of whichever system.
TRACTION_FILES = (
    *("table.csv", "metrics.csv", "runs.parquet", METADATA, "report.html"),
    *(f"{_POINT}.png", f"{_POINT}.gif"),
    *(f"{name}.png" for subject in SUBJECTS.values() for name in subject.captions),
)

#: The figures that are told while a job is computed.
_ON_THE_WAY = (
    *("utilisation", "utilisation_se", "tracking_rms", "slip_energy_share"),
    "torque_variation",
)

#: What is said of parts that are not named.
_OF_PAPER = "of the paper"


@dataclass(frozen=True, eq=False, repr=False)
class Traction:
    """The figures of a control system, without noise and over its runs with noise.

    Attributes:
        name: that of the system.
        system: its parts, and the paper they are of.
        plant: the parameters of the train.
        cases: the scenarios and methods that were run.
        job: how the runs are divided.
        judged: the course of the runs without noise, and the metrics of all.
        seconds: by the clock.
    """

    name: str
    system: System
    plant: PlantFile
    cases: Sequence[Case]
    job: Job
    judged: Judged
    seconds: float

    @property
    def table(self) -> pd.DataFrame:
        """The table of the paper: a row for each method and part of a run."""
        return SUBJECTS[self.name].table(self.judged.metrics)

    @property
    def metrics(self) -> pd.DataFrame:
        """A row for each scenario, method, part of a run and noise; columns NAME and NAME_se."""
        return self.judged.metrics

    def write(self, folder: str | PathLike[str], animate: bool = False) -> None:
        """The table, metrics, figures, report and metadata that the command writes."""
        path, subject = output_directory(Path(folder)), SUBJECTS[self.name]
        write_table(path / "table.csv", self.table)
        write_table(path / "metrics.csv", self.metrics)
        runs_shown = [shown(*pair) for pair in zip(self.cases, self.judged.traces, strict=True)]
        captions = {}
        for figure, panels in subject.figures(runs_shown, self.plant.plant).items():
            if panels:
                draw(path / f"{figure}.png", panels)
                caption = subject.captions[figure]
                if any(self._named().values()):
                    caption = (
                        f"{caption.partition(':')[0]} of the paper, with the parts named here."
                    )
                captions[f"{figure}.png"] = caption
        self.plot().savefig(path / f"{_POINT}.png", dpi=130)
        captions[f"{_POINT}.png"] = _POINT_CAPTION
        if animate:
            animate_operating_point(path / f"{_POINT}.gif", runs_shown[0])
        told = (self.system, self.plant, self.table, self.metrics, captions, self.job.runs)
        write_page(path, traction_page(*told))
        write_metadata(path / METADATA, self._metadata())

    @as_in_commands
    def plot(self) -> Figure:
        """The operating point over the adhesion curves while the surface changes, first case."""
        return operating_point(shown(self.cases[0], self.judged.traces[0]))

    def _named(self) -> Mapping[str, str | None]:
        """The parts in the place of the paper's, which are None."""
        asked = {part: self.job.asked[f"--{part}"] for part in ("observer", "seeker", "controller")}
        return {part: None if name == _OF_PAPER else name for part, name in asked.items()}

    def _metadata(self) -> Mapping[str, object]:
        found = self.judged
        return {
            "system": self.name,
            "source": self.system.source,
            "plant": self.plant.title,
            "parameters": {key: given._asdict() for key, given in self.plant.given.items()},
            **self._named(),
            "runs": self.job.runs,
            "seed": self.job.seed,
            "step_s": self.system.step,
            "control_period_s": self.system.control_period or self.system.step,
            "plant_steps": found.steps,
            "plant_steps_per_cpu_second": found.steps / found.seconds,
            "seconds": self.seconds,
            "compile_seconds": found.compile_seconds,
            "run_cpu_seconds": found.seconds,
            **runtime.describe(),
        }

    def __repr__(self) -> str:
        found = self.judged
        took = steps_told(found.steps, found.seconds, found.compile_seconds)
        return f"{aligned(self.table)}\n\n{took}"

    def _repr_html_(self) -> str:
        return self.table.to_html(index=False) + text_html(self.system.title)


@recorded
@as_in_commands
def traction_control(
    system: str,
    plant: str | PathLike[str] | None = None,
    observer: str | None = None,
    seeker: str | None = None,
    controller: str | Sequence[str] | None = None,
    runs: int = 32,
    seed: int = 0,
    step: float | None = None,
    workers: int = 1,
    out: str | PathLike[str] | None = None,
    resume: bool = False,
    extend: int = 0,
    animate: bool = False,
    cluster: str | None = None,
) -> Traction:
    """Run a published control system on its plant, without noise and with it.

    Args:
        system: a name of SYSTEMS.
        plant: a TOML file, or the name of a plant that ships; by default that of the paper.
        observer: a name of OBSERVERS, in the place of that of the paper.
        seeker: a name of SEEKERS, in the place of that of the paper, or none. One of your own is
            put there: `SEEKERS["mine"] = Mine()`.
        controller: a name of CONTROLLERS, in the place of that of the paper, or several, which
            then stand side by side.
        runs: number of runs with noise.
        seed: of the noise.
        step: of the plant, s.
        workers: processes, which a script must start under `if __name__ == "__main__":`.
        out: a folder for the files of the command; what is finished stays there in shards.
        resume: go on with a job that was interrupted.
        extend: further runs for the job in the folder.
        animate: draw the operating point as a moving picture there, too.
        cluster: local:N, or the address of a scheduler of Dask, whose workers compute.

    Returns:
        The table of the paper, the metrics of all parts of the runs, and their course.

    Raises:
        InputError: a name or a file cannot be used.
    """
    began = time.perf_counter()
    check_numbers(runs, workers, seed, fewest=0)
    controllers = [controller] if controller is None or isinstance(controller, str) else controller
    if not controllers or len({*controllers}) < len(controllers):
        raise InputError("controller is one name or several, each of them once.")
    if animate and out is None:
        raise InputError("animate draws into a folder; name it as out.")
    for kind, given, known in (
        ("system", system, [*SYSTEMS]),
        ("observer", observer, [*OBSERVERS]),
        ("seeker", seeker, [NO_SEEKER, *SEEKERS]),
        *(("controller", name, [*CONTROLLERS]) for name in controllers),
    ):
        if given is not None and given not in known:
            raise InputError(f"There is no {kind} {given}; name {listed(known, 'or')}.")
    chosen = SYSTEMS[system]
    chosen = chosen._replace(step=step_of(step, chosen.step))
    source = str(chosen.plant if plant is None else plant)
    train = read_plant(shipped().get(source, Path(source)))
    of_paper = chosen.cases(chosen.step)
    cases = [case for name in controllers for case in with_parts(of_paper, observer, seeker, name)]
    runs = extended(out, runs, resume, extend)
    asked = {
        "--system": system,
        "--plant": source,
        "--observer": observer or _OF_PAPER,
        "--seeker": seeker or _OF_PAPER,
        "--controller": ",".join(name or _OF_PAPER for name in controllers),
        "--step": f"{chosen.step:g}",
    }
    job = job_of(system, chosen, cases, train.plant, runs, seed, asked)

    def told(found: Judged) -> Traction:
        return Traction(system, chosen, train, cases, job, found, time.perf_counter() - began)

    if out is None:
        return told(judge(job, workers))
    directory = output_directory(Path(out))
    with (
        pool_of(workers, cluster) as pool,
        opened_for("traction", [job], directory, TRACTION_FILES, resume, extend) as (folder, stage),
    ):
        compute(content, [job], folder, lambda _: pool)
        found = told(judged(job, read_all(folder, job.name, job.shards)))
        write_rows(stage / "runs.parquet", folder, [job])
        found.write(stage, animate)
    return found


def stored_tables(record: Mapping[str, Any], folder: Path) -> str:
    """The figures, for a terminal, of those runs that are there of the job of a record."""
    cases = [Named(**case) for case in record["cases"]]
    metrics = added(cases, read_all(folder, record["name"], record["shards"])).metrics
    shown = metrics[metrics["segment"] == WHOLE]
    columns = ["scenario", "method", "noise", *_ON_THE_WAY, "status"]
    return f"\nmeans over the finished runs, of the whole run each\n{aligned(shown[columns])}"
