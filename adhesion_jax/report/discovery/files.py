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
from adhesion_jax.report.discovery.verdict import opinion_sentence, verdict
from adhesion_jax.report.discovery.words import (
    acts_on,
    candidates,
    class_sentence,
    error,
    evidence,
    humanised,
    kind_of_run,
    one_line,
)
from adhesion_jax.report.events import EVENTS_FIGURE, draw_events
from adhesion_jax.report.page import (
    CAPTIONS,
    Block,
    Formula,
    Items,
    Page,
    Paragraph,
    Section,
    Table,
    pictures,
)
from adhesion_jax.report.rendering import page_html, page_markdown
from adhesion_jax.report.text import WIDTH, filled, in_columns
from adhesion_jax.wording import number, plus_minus

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
    (folder / "report.md").write_text(page_markdown(content), encoding="utf-8")
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
        "effects": [_effect_json(effect) for effect in findings.effects],
        "unexplained": [{"axis": one.name, **_effect_json(one)} for one in findings.unexplained],
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
    opinion = [] if findings.opinion is None else [opinion_sentence(findings, findings.opinion)]
    files = {"dependence.png": findings.dependences, "shapes.png": shape_columns(findings)}
    sections = [
        Section("Error before and after", _errors(findings)),
        Section(
            "Data and law",
            [
                *_figures("adhesion.png"),
                *map(Paragraph, filter(None, [one_line(findings.citation)])),
                *(_figures("events.png") if of_events else []),
            ],
        ),
        *_effects(findings),
        Section("What the corrections do", _figures(*(file for file in files if files[file]))),
        Section(
            "The level of every run, against every column",
            _against_columns("levels.png", *level_columns(findings)),
        ),
        Section(
            "The residual, against every column",
            _against_columns("residuals.png", *residual_columns(findings)),
        ),
        Section(
            "Doubts",
            [
                *_items([doubt.sentence for doubt in findings.doubts]),
                *(Paragraph(f"{sentence}.") for sentence in opinion),
            ],
        ),
        Section(f"Parameters of the base curve ({findings.base})", _base(findings)),
        Section(
            "What the data cannot tell apart",
            _items(findings.confounded, "No other cause acts like an effect that was found."),
            boxed=True,
        ),
        Section("What to measure next", _items(_next(findings), "Nothing is proposed.")),
        Section(
            "What could not be tested",
            _items(findings.untested, "Nothing: no column is missing, constant or too narrow."),
        ),
        Section("Ranking of all candidates", _ranking(findings)),
        Section("Warnings", _items(findings.warnings, "None.")),
    ]
    return Page(
        f"Missing effects: {findings.base} on {one_line(findings.source)}",
        verdict(findings),
        [section for section in sections if section.blocks],
    )


def _figures(*files: str, more: str = "") -> list[Block]:
    return pictures("discover", files, more)


def _items(texts: Sequence[str], none: str = "") -> list[Block]:
    if texts:
        return [Items([one_line(text) for text in texts])]
    return [Paragraph(none)] if none else []


def _errors(findings: Findings) -> list[Block]:
    noise = ", ".join(
        f"{name.replace('_', ' ')} {number(value)}" for name, value in findings.noise.items()
    )
    words = (
        "Root mean square errors of adhesion (1), with 95 % intervals by a bootstrap over whole "
        f"{kind_of_run(findings)}s. The noise floor is {error(findings.noise_floor)}"
    )
    paragraph = Paragraph(f"{words} ({noise})." if noise else f"{words}.")
    return [errors_table(findings), paragraph, *_figures("errors.png")]


def _effects(findings: Findings) -> list[Section]:
    sections = [
        _effect(findings, effect, f"Missing {place}: {title(effect, True)}")
        for place, effect in enumerate(findings.effects, start=1)
    ] or [Section("Missing effects", [Paragraph("No effect was accepted.")])]
    return sections + [
        _effect(findings, effect, f"Unexplained: structure against {title(effect, False)}")
        for effect in findings.unexplained
    ]


def _effect(findings: Findings, effect: FoundEffect, heading: str) -> Section:
    columns = ", ".join(one_line(name) for name in effect.covariates)
    facts = [
        evidence(findings, effect),
        class_sentence(effect),
        columns and f"it rests on {columns}",
        acts_on(effect) and f"it {acts_on(effect)}",
        "with this effect and those accepted before it the error of cross-validation is "
        f"{error(effect.rmse_after)}",
    ]
    return Section(
        heading,
        [
            Paragraph(one_line(effect.sentence)),
            *([Formula(one_line(effect.formula))] if effect.formula else []),
            *([parameters_table(effect)] if effect.parameters else []),
            Paragraph(". ".join(fact[0].upper() + fact[1:] for fact in facts if fact) + "."),
        ],
    )


def _against_columns(file: str, shown: Sequence[str], every: Sequence[str]) -> list[Block]:
    """A picture of some of the columns that could be shown."""
    some = "" if len(shown) == len(every) else f" {len(shown)} of {len(every)} columns."
    return _figures(file, more=some) if shown else []


def _base(findings: Findings) -> list[Block]:
    table = findings.base_parameters
    pairs = [
        [
            plus_minus(value, spread)
            + (" (held)" if np.isfinite(value) and not np.isfinite(spread) else "")
            for value, spread in zip(table[when], table[f"{when}_se"], strict=True)
        ]
        for when in ("before", "after")
    ]
    added = findings.effects or findings.unexplained
    names, units = table["parameter"].astype(str), table["unit"].astype(str)
    return [
        Table(
            ("parameter", "before ± standard error", "after ± standard error", "unit"),
            list(zip(names, *pairs, units, strict=True)),
        ),
        Paragraph(
            ("After: fitted together with all added effects and terms. " if added else "")
            + "The whole law is in law.json."
        ),
    ]


def _next(findings: Findings) -> list[str]:
    return [
        f"To tell {humanised(one)} from {humanised(other)}: {measurement} Expected separation: "
        f"{number(power)} standard errors."
        for (one, other), measurement, power in findings.proposals
    ]


def _ranking(findings: Findings) -> list[Block]:
    ranked = ranking(findings)
    if not ranked:
        return [Paragraph("No candidate was tested.")]
    dashed = " Dashed: the z from which a candidate is significant." if findings.thresholds else ""
    return [
        *_figures("ranking.png", more=dashed),
        ranking_table(ranked, findings.least_p),
        Paragraph(
            "Gain of log likelihood: of runs left out, summed over all runs, where the candidate "
            "was refitted together with the law of that round."
        ),
    ]
