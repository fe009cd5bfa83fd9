"""A discovery in files and on the terminal, and its page."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from adhesion_jax.data.events import Chosen
from adhesion_jax.discovery.types import Findings, FoundEffect
from adhesion_jax.effects.saved import FORMAT, save_law
from adhesion_jax.files import METADATA, write_metadata, write_table
from adhesion_jax.report.discovery.figures import draw_discovery
from adhesion_jax.report.discovery.tables import (
    base_table,
    effects_table,
    errors_table,
    level_columns,
    parameters_table,
    ranking,
    ranking_frame,
    ranking_table,
    residual_columns,
    shape_columns,
    title,
)
from adhesion_jax.report.discovery.words import (
    acts_on,
    candidates,
    class_sentence,
    error,
    evidence,
    humanised,
    kind_of_run,
    opinion_sentence,
    verdict,
)
from adhesion_jax.report.events import EVENTS_FIGURE, draw_events
from adhesion_jax.report.page import CAPTIONS, Page
from adhesion_jax.report.rendering import (
    WIDTH,
    filled,
    in_columns,
    one_line,
    page_markdown,
    page_of,
    write_page,
)

#: The files of a discovery; those that do not apply are not written.
DISCOVERY_FILES = (
    "report.html",
    "report.md",
    "report.json",
    "law.json",
    "predictions.csv",
    "ranking.csv",
    METADATA,
    *CAPTIONS["discover"],
)

#: The fields of the second opinion that are told to programs: all but its function.
_OF_OPINION = ("columns", "explained", "error", "p")

#: Functions that the template of the page asks.
_OF_PAGE = (
    *(acts_on, class_sentence, error, evidence, humanised, kind_of_run, opinion_sentence, title),
    *(base_table, errors_table, level_columns, parameters_table, ranking, ranking_table),
    *(residual_columns, shape_columns),
)


def write_discovery(folder: Path, findings: Findings, logs: Sequence[Chosen] = ()) -> None:
    """Every file of DISCOVERY_FILES that applies; `logs` are those whose slip events are runs."""
    draw_discovery(folder, findings)
    draw_events(folder, logs)
    content = page(findings, (folder / EVENTS_FIGURE).is_file())
    write_page(folder, content)
    (folder / "report.md").write_text(page_markdown(content), encoding="utf-8")
    write_metadata(folder / "report.json", report_json(findings))
    save_law(folder / "law.json", findings.law, findings.named)
    write_table(folder / "ranking.csv", ranking_frame(findings))
    if findings.predictions is not None:
        write_table(folder / "predictions.csv", findings.predictions)


def report_json(findings: Findings) -> dict[str, object]:
    """The findings for programs: names as in catalogue and file; what is missing is null."""
    errors = {
        "train": findings.train,
        "cross_validation": findings.validation,
        "test": findings.test,
        "test_with_trees": findings.with_trees,
        "test_beside_trees": findings.beside_trees,
        "smoothing": findings.smoothing,
    }
    opinion = findings.opinion
    told = {
        "format": FORMAT,
        "base": findings.base,
        "noise_floor": findings.noise_floor,
        "rmse": {
            name: {"before": of.before.value, "after": of.after.value}
            for name, of in errors.items()
            if of is not None
        },
        "effects": [_effect_json(effect) for effect in findings.effects],
        "unexplained": [{"axis": one.name, **_effect_json(one)} for one in findings.unexplained],
        "doubts": [doubt._asdict() for doubt in findings.doubts],
        "second_opinion": opinion and dict(zip(_OF_OPINION, opinion, strict=False)),
        "warnings": findings.warnings,
    }
    return {name: _plain(value) for name, value in told.items()}


def printed(findings: Findings) -> str:
    """The verdict, the errors and the effects, for a terminal."""
    parts = [
        textwrap.fill(verdict(findings), WIDTH, break_on_hyphens=False),
        in_columns(errors_table(findings)),
    ]
    if findings.effects or findings.unexplained:
        parts.append(in_columns(effects_table(findings)))
    if findings.warnings:
        parts.append("\n".join(filled(f"Warning: {text}") for text in findings.warnings))
    return "\n\n".join(parts)


def _effect_json(effect: FoundEffect) -> dict[str, object]:
    return {
        "name": effect.name,
        "candidates": candidates(effect),
        "covariates": effect.covariates,
        "acts_on": effect.acts_on,
        "parameters": {
            name: {**interval._asdict(), "unit": effect.units.get(name, "")}
            for name, interval in effect.parameters.items()
        },
        "p_adjusted": effect.p_adjusted,
        "rmse_after": effect.rmse_after,
    }


def _plain(value: object) -> object:
    """The same for JSON, which has no tuples and no numbers that are not finite: these are None."""
    if isinstance(value, Mapping):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(one) for one in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    return value


def page(findings: Findings, of_events: bool = False) -> Page:
    """The report; `of_events` says that the runs are slip events, of which there is a figure."""
    return page_of(
        "discover_page.txt",
        f"Missing effects: {findings.base} on {one_line(findings.source)}",
        verdict(findings),
        CAPTIONS["discover"],
        findings=findings,
        of_events=of_events,
        **{word.__name__: word for word in _OF_PAGE},
    )
