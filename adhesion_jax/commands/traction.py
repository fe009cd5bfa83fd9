"""Run a published traction control system on its plant and judge it."""

import time
from pathlib import Path

import click
import pandas as pd
from tqdm import tqdm

from adhesion_jax import runtime
from adhesion_jax.campaign.traction import judge, planned
from adhesion_jax.files import output_directory, staged, write_metadata, write_table
from adhesion_jax.report.page_html import page_html
from adhesion_jax.report.traction import SUBJECTS
from adhesion_jax.report.traction.operating_point import (
    animate_operating_point,
    draw_operating_point,
)
from adhesion_jax.report.traction.page import traction_page
from adhesion_jax.report.traction.panels import draw
from adhesion_jax.report.traction.runs import Drawing, shown
from adhesion_jax.traction.plants.reading import PlantFile, read_plant, shipped
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import with_parts

_POINT = "operating_point"
_POINT_CAPTION = "The operating point over the adhesion curves while the surface changes."

#: All that the command may write, of whichever system.
OWN_FILES = (
    *("table.csv", "metrics.csv", "metadata.json", "report.html"),
    *(f"{_POINT}.png", f"{_POINT}.gif"),
    *(f"{name}.png" for subject in SUBJECTS.values() for name in subject.captions),
)


def main(
    name: str,
    plant_name: str | None,
    observer: str | None,
    seeker: str | None,
    controller: str | None,
    runs: int,
    seed: int,
    step: float | None,
    animate: bool,
    out: Path,
) -> None:
    """Run a published control system on its plant: its table, its figures and its metrics.

    Every scenario of the paper runs once without noise and `--runs` times with noise. With an
    observer, a seeker or a controller named, it takes the place of the paper's own.
    """
    began = time.perf_counter()
    system, subject = SYSTEMS[name], SUBJECTS[name]
    system = system._replace(step=step or system.step)
    plant = _plant(plant_name or system.plant)
    cases = with_parts(system.cases(system.step), observer, seeker, controller)
    plan = planned(system, cases, plant.plant, runs, seed)
    directory = output_directory(out)
    with staged(directory, OWN_FILES) as stage:
        with tqdm(total=len(plan.units), unit="unit") as bar:

            def progress(method: str) -> None:
                bar.set_description(method)
                bar.update()

            judged = judge(plan, progress)
        table = subject.table(judged.metrics)
        write_table(stage / "table.csv", table)
        write_table(stage / "metrics.csv", judged.metrics)
        runs_shown = [shown(*pair) for pair in zip(cases, judged.traces, strict=True)]
        captions = {}
        for figure, panels in subject.figures(Drawing(runs_shown, plant.plant)).items():
            if panels:
                draw(stage / f"{figure}.png", panels)
                captions[f"{figure}.png"] = subject.captions[figure]
        draw_operating_point(stage / f"{_POINT}.png", runs_shown[0])
        captions[f"{_POINT}.png"] = _POINT_CAPTION
        if animate:
            animate_operating_point(stage / f"{_POINT}.gif", runs_shown[0])
        page = traction_page(system, plant, table, judged.metrics, captions, runs)
        pictures = {picture: (stage / picture).read_bytes() for picture in captions}
        (stage / "report.html").write_text(page_html(page, pictures), encoding="utf-8")
        seconds = time.perf_counter() - began
        write_metadata(
            stage / "metadata.json",
            {
                "system": name,
                "source": system.source,
                "plant": plant.title,
                "parameters": {key: given._asdict() for key, given in plant.given.items()},
                "observer": observer,
                "seeker": seeker,
                "controller": controller,
                "runs": runs,
                "seed": seed,
                "step_s": system.step,
                "control_period_s": system.control_period or system.step,
                "plant_steps": judged.steps,
                "plant_steps_per_cpu_second": judged.steps / judged.seconds,
                "seconds": seconds,
                "compile_seconds": judged.compile_seconds,
                "run_cpu_seconds": judged.seconds,
                **runtime.describe(),
            },
        )
    click.echo(_aligned(table))
    rate = judged.steps / judged.seconds / 1e6
    click.echo(
        f"\n{judged.steps:.3g} plant steps in {judged.seconds:.0f} CPU-seconds "
        f"({rate:.1f} million a CPU-second), compiled in {judged.compile_seconds:.0f} s; "
        f"written to {directory} in {seconds:.0f} s"
    )


def _plant(name: str) -> PlantFile:
    """The plant of a file, or of the name of one that ships."""
    return read_plant(shipped().get(name, Path(name)))


def _aligned(table: pd.DataFrame) -> str:
    return table.to_string(index=False, float_format=lambda x: f"{x:.4g}", na_rep="")
