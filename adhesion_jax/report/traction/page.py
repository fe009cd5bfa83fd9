"""The page on a traction system: our figures, those of the paper, and the assumptions."""

from collections import Counter
from collections.abc import Mapping

import pandas as pd

from adhesion_jax.campaign.traction import FAILED, NOISY, QUIET, WHOLE
from adhesion_jax.metrics.closed_loop import FIGURES
from adhesion_jax.report.page import Page, Table, table_of
from adhesion_jax.report.rendering import page_of, sentences_of
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
    whole = metrics[metrics["segment"] == WHOLE]
    is_quiet, failed = whole["noise"] == QUIET, whole["status"].str.contains(FAILED)
    sound = whole[is_quiet & ~whole["method"].isin(whole["method"][is_quiet & failed])]
    used = sound.groupby("method", sort=False)["utilisation"].mean()
    told = whole[(is_quiet & (whole["status"] != "regular")) | failed]
    verdict = sentences_of("traction_verdict.txt", rows=told.to_dict("records"), used=used)
    return page_of(
        "traction_page.txt",
        system.title,
        " ".join(verdict),
        captions,
        system=system,
        pictures=captions,
        runs=runs,
        beside=table_of(table),
        quiet=_metrics_table(metrics, QUIET),
        noisy=_metrics_table(metrics, NOISY),
        columns=columns_table(FIGURES),
        **words_of_plant(plant),
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


def words_of_plant(plant: PlantFile) -> Mapping[str, object]:
    """What `plant.txt` tells: the parameters of a plant, and where they are from."""
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
    tags = Counter(given.tag for given in plant.given.values())
    headings = ("parameter", "value", "unit", "where from", "source")
    return {
        "plant": plant,
        "counted": [f"{tags[tag]} {words}" for tag, words in TAGS.items() if tags[tag]],
        "parameters": Table(headings, rows, ("value",)),
    }


def columns_table(columns: Mapping[str, tuple[str, str]]) -> Table:
    """Unit and meaning of each column of a table."""
    rows = [[name, unit, words] for name, (unit, words) in columns.items()]
    return Table(("column", "unit", "meaning"), rows)
