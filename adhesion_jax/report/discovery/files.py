"""A discovery in files and on the terminal."""

import math
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from adhesion_jax.data.events import Chosen
from adhesion_jax.discovery.types import Findings, FoundEffect
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
from adhesion_jax.report.page import CAPTIONS
from adhesion_jax.report.rendering import page_html
from adhesion_jax.report.text import WIDTH, filled, in_columns

#: The names of the files of the figures; a figure without content is not drawn.
FIGURES = (*CAPTIONS["discover"],)

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
        "effects": [_effect(effect) for effect in findings.effects],
        "unexplained": [{"axis": one.name, **_effect(one)} for one in findings.unexplained],
        "doubts": [{"names": doubt.names, "sentence": doubt.sentence} for doubt in findings.doubts],
        "second_opinion": opinion
        and {
            "columns": opinion.columns,
            "explained": opinion.explained,
            "error": opinion.error,
            "p": opinion.p,
        },
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


def _effect(effect: FoundEffect) -> dict[str, object]:
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
