"""The content of the report of a discovery, in its order; every rendering is made from it."""

from collections.abc import Sequence

import numpy as np

from adhesion_jax.discovery.types import Findings, FoundEffect
from adhesion_jax.report.discovery.tables import (
    errors_table,
    level_columns,
    parameters_table,
    ranking,
    ranking_table,
    residual_columns,
    shape_columns,
    title,
)
from adhesion_jax.report.discovery.verdict import opinion_sentence, verdict
from adhesion_jax.report.discovery.words import (
    acts_on,
    class_sentence,
    error,
    evidence,
    humanised,
    kind_of_run,
    one_line,
)
from adhesion_jax.report.page import (
    Block,
    Formula,
    Items,
    Page,
    Paragraph,
    Section,
    Table,
    pictures,
)
from adhesion_jax.wording import number, plus_minus


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
