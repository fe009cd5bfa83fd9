"""A discovery in files and on the terminal."""

import math
import textwrap
from collections.abc import Sequence
from pathlib import Path

from adhesion_jax.data.events import Chosen
from adhesion_jax.discovery.types import Errors, Findings, FoundEffect, Opinion
from adhesion_jax.effects.saved import FORMAT, save_law
from adhesion_jax.files import METADATA, write_metadata, write_table
from adhesion_jax.report.discovery.content import page
from adhesion_jax.report.discovery.figures import draw_discovery
from adhesion_jax.report.discovery.frames import ranking_frame
from adhesion_jax.report.discovery.markdown import discovery_markdown
from adhesion_jax.report.discovery.tables import effects_table, errors_table
from adhesion_jax.report.discovery.verdict import verdict
from adhesion_jax.report.discovery.words import candidates
from adhesion_jax.report.events import EVENTS_FIGURE, draw_events
from adhesion_jax.report.page_html import page_html
from adhesion_jax.report.text import WIDTH, filled, in_columns

#: The names of the files of the figures; a figure without content is not drawn.
FIGURES = (
    EVENTS_FIGURE,
    "adhesion.png",
    "residuals.png",
    "levels.png",
    "dependence.png",
    "shapes.png",
    "errors.png",
    "ranking.png",
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
    *FIGURES,
)


def write_discovery(folder: Path, findings: Findings, logs: Sequence[Chosen] = ()) -> None:
    """Every file of DISCOVERY_FILES that applies; `logs` are those whose slip events are runs."""
    draw_discovery(folder, findings)
    draw_events(folder, logs)
    pictures = {name: (folder / name).read_bytes() for name in FIGURES if (folder / name).is_file()}
    content = page(findings, EVENTS_FIGURE in pictures)
    (folder / "report.html").write_text(page_html(content, pictures), encoding="utf-8")
    (folder / "report.md").write_text(discovery_markdown(content), encoding="utf-8")
    write_metadata(folder / "report.json", report_json(findings))
    save_law(folder / "law.json", findings.law)
    write_table(folder / "ranking.csv", ranking_frame(findings))
    if findings.predictions is not None:
        write_table(folder / "predictions.csv", findings.predictions)


def report_json(findings: Findings) -> dict[str, object]:
    """The findings for programs: names as in catalogue and file; what is missing is null."""
    errors = {
        "train": findings.train,
        "test": findings.test,
        "test_with_trees": findings.with_trees,
    }
    return {
        "format": FORMAT,
        "base": findings.base,
        "noise_floor": _plain(findings.noise_floor),
        "rmse": {name: _before_after(of) for name, of in errors.items() if of is not None},
        "effects": [_effect(effect) for effect in findings.effects],
        "unexplained": [{"axis": one.name, **_effect(one)} for one in findings.unexplained],
        "doubts": [
            {"names": list(doubt.names), "sentence": doubt.sentence} for doubt in findings.doubts
        ],
        "second_opinion": None if findings.opinion is None else _opinion(findings.opinion),
        "warnings": list(findings.warnings),
    }


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


def _before_after(errors: Errors) -> dict[str, float | None]:
    return {"before": _plain(errors.before.value), "after": _plain(errors.after.value)}


def _effect(effect: FoundEffect) -> dict[str, object]:
    return {
        "name": effect.name,
        "candidates": list(candidates(effect)),
        "covariates": list(effect.covariates),
        "acts_on": effect.acts_on,
        "parameters": {
            name: {
                "value": _plain(interval.value),
                "low": _plain(interval.low),
                "high": _plain(interval.high),
                "unit": effect.units.get(name, ""),
            }
            for name, interval in effect.parameters.items()
        },
        "p_adjusted": _plain(effect.p_adjusted),
        "rmse_after": _plain(effect.rmse_after),
    }


def _opinion(opinion: Opinion) -> dict[str, object]:
    return {
        "columns": list(opinion.columns),
        "explained": _plain(opinion.explained),
        "error": _plain(opinion.error),
        "p": _plain(opinion.p),
    }


def _plain(value: float) -> float | None:
    """A Python float for JSON; None for a number that is not finite, which JSON does not have."""
    return float(value) if math.isfinite(value) else None
