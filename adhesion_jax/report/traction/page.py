"""The page on a traction system: our figures, those of the paper, and the assumptions."""

from collections.abc import Mapping, Sequence

import pandas as pd

from adhesion_jax.campaign.traction import NOISY, QUIET, WHOLE
from adhesion_jax.metrics.closed_loop import FIGURES
from adhesion_jax.report.page import (
    Block,
    Items,
    Page,
    Paragraph,
    Picture,
    Section,
    Table,
    table_of,
)
from adhesion_jax.traction.plants.reading import TAGS, PlantFile
from adhesion_jax.traction.systems.base import System
from adhesion_jax.wording import plus_minus

#: The figures of a segment that the page shows; metrics.csv has them all.
_SHOWN = ("utilisation", "t95", "tracking_rms", "slip_energy_share", "torque_variation")


def traction_page(
    system: System,
    plant: PlantFile,
    table: pd.DataFrame,
    metrics: pd.DataFrame,
    captions: Mapping[str, str],
    runs: int,
) -> Page:
    """`captions` are those of the pictures that were drawn, by the names of their files."""
    sections = [
        Section("Beside the paper", [Paragraph(_beside(system)), table_of(table)]),
        Section("Every method, without noise", [_metrics_table(metrics, QUIET)]),
    ]
    if runs:
        noise = system.noise
        words = (
            f"Means over {runs} runs with noise of {noise.motor:g} rad/s in the speed of the "
            f"motor and of {noise.train:g} m/s in that of the train, with their standard errors."
        )
        sections.append(Section("With noise", [Paragraph(words), _metrics_table(metrics, NOISY)]))
    pictures: list[Block] = [Picture(name, caption) for name, caption in captions.items()]
    sections.append(Section("Figures", pictures))
    sections.append(Section("What was repaired", [Items(system.repairs)]))
    sections.append(Section("What was assumed", [Items(system.assumptions), *parameters_of(plant)]))
    meanings = [[name, unit, words] for name, (unit, words) in FIGURES.items()]
    sections.append(
        Section("Columns of metrics.csv", [Table(("column", "unit", "meaning"), meanings)])
    )
    return Page(system.title, _verdict(metrics), sections)


def _verdict(metrics: pd.DataFrame) -> str:
    """Utilisation of the first, the best and the worst method, and each run that is not regular."""
    rows = metrics[(metrics["noise"] == QUIET) & (metrics["segment"] == WHOLE)]
    means = rows.groupby("method", sort=False)["utilisation"].mean()
    told = [f"{100 * mean:.1f} % (“{method}”)" for method, mean in means.items()]
    order = [int(place) for place in means.to_numpy().argsort()]
    words = f"Share of the largest adhesion that is used, without noise: {told[0]}."
    if len(told) > 1:
        words += f" The largest share is {told[order[-1]]}, the smallest {told[order[0]]}."
    for _, row in rows[rows["status"] != "regular"].iterrows():
        words += f" On “{row['scenario']}” with “{row['method']}” {row['status']}."
    return words


def _beside(system: System) -> str:
    return (
        f"Each row is a run without noise on the plant of {system.source}. Columns whose names "
        "begin with paper hold the numbers that the source prints."
    )


def _metrics_table(metrics: pd.DataFrame, noise: str) -> Table:
    rows = metrics[metrics["noise"] == noise]
    names = ["scenario", "method", "segment"]
    cells = [
        [
            *(str(row[name]) for name in names),
            *(plus_minus(row[name], row[f"{name}_se"]) for name in _SHOWN),
            str(row["status"]),
        ]
        for _, row in rows.iterrows()
    ]
    headings = [f"{name} ({FIGURES[name][0]})" for name in _SHOWN]
    return Table(
        [*names, *headings, "status"], cells, headings, f"{len(cells)} rows: methods and segments"
    )


def parameters_of(plant: PlantFile) -> Sequence[Block]:
    """What the parameters of a plant are, and where each is from."""
    rows = [
        [
            name,
            ", ".join(f"{value:.6g}" for value in given.value),
            given.unit,
            TAGS.get(given.tag, ""),
            given.source,
        ]
        for name, given in plant.given.items()
    ]
    counted = {
        words: sum(given.tag == tag for given in plant.given.values())
        for tag, words in TAGS.items()
    }
    told = ", ".join(f"{count} {words}" for words, count in counted.items() if count)
    words = (
        f"Parameters of the plant ({plant.title}): {told}."
        if told
        else "The parameters of the plant have no tags."
    )
    headings = ("parameter", "value", "unit", "where from", "source")
    return [Paragraph(words), Table(headings, rows, ("value",))]
