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
from adhesion_jax.report.page import Block, Formula, Items, Page, Paragraph, Picture, Section, Table
from adhesion_jax.wording import number, plus_minus


def page(findings: Findings, of_events: bool = False) -> Page:
    """The report; `of_events` says that the runs are slip events, of which there is a figure."""
    return Page(
        f"Missing effects: {findings.base} on {one_line(findings.source)}",
        verdict(findings),
        [
            _errors(findings),
            _data(findings, of_events),
            *_effects(findings),
            *_dependence(findings),
            *_levels(findings),
            *_residual(findings),
            *_doubts(findings),
            _base(findings),
            _confounded(findings),
            _next(findings),
            _untested(findings),
            _ranking(findings),
            Section("Warnings", _items(findings.warnings, "None.")),
        ],
    )


def _items(texts: Sequence[str], none: str) -> list[Block]:
    return [Items([one_line(text) for text in texts])] if texts else [Paragraph(none)]


def _errors(findings: Findings) -> Section:
    noise = ", ".join(
        f"{name.replace('_', ' ')} {number(value)}" for name, value in findings.noise.items()
    )
    return Section(
        "Error before and after",
        [
            errors_table(findings),
            Paragraph(
                "Root mean square errors of adhesion (1), with 95 % intervals by a bootstrap over "
                f"whole {kind_of_run(findings)}s. The noise floor is {error(findings.noise_floor)}"
                + (f" ({noise})." if noise else ".")
            ),
            Picture(
                "errors.png",
                "Error before (open) and after (filled) with 95 % intervals. No law can do better "
                "than the noise floor (dashed) on data it has not seen.",
            ),
        ],
    )


def _data(findings: Findings, of_events: bool) -> Section:
    events = Picture(
        "events.png",
        "The log with the slip events that were cut out of it, and adhesion over slip in each.",
    )
    return Section(
        "Data and law",
        [
            Picture(
                "adhesion.png",
                "The measured points under all their conditions, and the law before and after "
                "at the median of every column. These lines do not show the scatter that other "
                "conditions cause.",
            ),
            *([Paragraph(one_line(findings.citation))] if findings.citation else []),
            *([events] if of_events else []),
        ],
    )


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
    told = class_sentence(effect)
    columns = ", ".join(one_line(name) for name in effect.covariates)
    facts = [
        _begun(evidence(findings, effect)),
        *([_begun(told)] if told else []),
        *([f"It rests on {columns}"] if columns else []),
        *([f"It {acts_on(effect)}"] if acts_on(effect) else []),
        "With this effect and those accepted before it the error of cross-validation is "
        f"{error(effect.rmse_after)}",
    ]
    return Section(
        heading,
        [
            Paragraph(one_line(effect.sentence)),
            *([Formula(one_line(effect.formula))] if effect.formula else []),
            *([parameters_table(effect)] if effect.parameters else []),
            Paragraph(". ".join(facts) + "."),
        ],
    )


def _begun(sentence: str) -> str:
    return sentence[0].upper() + sentence[1:]


def _dependence(findings: Findings) -> list[Section]:
    pictures: list[Block] = []
    if findings.dependences:
        caption = (
            "The factor on adhesion as one column varies and the others are held, with its 95 % "
            "band; it is 1 at the median of the column. Marks below: deciles of the points."
        )
        pictures.append(Picture("dependence.png", caption))
    if shape_columns(findings):
        caption = (
            "The law over slip where an effect acts on the shape of the curve: at a low (5 %), "
            "the median and a high (95 %) value of its column, the other columns at their medians."
        )
        pictures.append(Picture("shapes.png", caption))
    return [Section("What the corrections do", pictures)] if pictures else []


def _levels(findings: Findings) -> list[Section]:
    caption = (
        "The level of each run, measured less law as a share of the law, before (open) and after "
        "(filled), against the mean of every column over the run; bars are two standard errors "
        "from the noise within the run. A trend of the filled points shows a cause that the law "
        "still lacks."
    )
    title = "The level of every run, against every column"
    return _against_columns(title, "levels.png", caption, level_columns(findings))


def _against_columns(
    title: str, file: str, caption: str, columns: tuple[list[str], list[str]]
) -> list[Section]:
    """A section with a picture of some columns, of those and of all that could be shown."""
    shown, every = columns
    some = "" if len(shown) == len(every) else f" {len(shown)} of {len(every)} columns."
    return [Section(title, [Picture(file, f"{caption}{some}")])] if shown else []


def _doubts(findings: Findings) -> list[Section]:
    blocks: list[Block] = []
    if findings.doubts:
        blocks += _items([doubt.sentence for doubt in findings.doubts], "")
    if findings.opinion:
        blocks.append(Paragraph(f"{opinion_sentence(findings, findings.opinion)}."))
    return [Section("Doubts", blocks)] if blocks else []


def _residual(findings: Findings) -> list[Section]:
    caption = (
        "Measured less law, turned by the sign of the slip: grey points before; means in bins "
        "before (open) and after (filled), with two standard errors from the scatter between runs. "
        "The means of a law that lacks nothing are zero within their errors in every panel."
    )
    title = "The residual, against every column"
    return _against_columns(title, "residuals.png", caption, residual_columns(findings))


def _base(findings: Findings) -> Section:
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
    return Section(
        f"Parameters of the base curve ({findings.base})",
        [
            Table(
                ("parameter", "before ± standard error", "after ± standard error", "unit"),
                list(zip(names, *pairs, units, strict=True)),
            ),
            Paragraph(
                ("After: fitted together with all added effects and terms. " if added else "")
                + "The whole law is in law.json."
            ),
        ],
    )


def _confounded(findings: Findings) -> Section:
    none = "No other cause acts like an effect that was found."
    return Section("What the data cannot tell apart", _items(findings.confounded, none), boxed=True)


def _untested(findings: Findings) -> Section:
    none = "Nothing: no column is missing, constant or too narrow."
    return Section("What could not be tested", _items(findings.untested, none))


def _next(findings: Findings) -> Section:
    return Section(
        "What to measure next",
        _items(
            [
                f"To tell {humanised(one)} from {humanised(other)}: {measurement} Expected "
                f"separation: {number(power)} standard errors."
                for (one, other), measurement, power in findings.proposals
            ],
            "Nothing is proposed.",
        ),
    )


def _ranking(findings: Findings) -> Section:
    ranked = ranking(findings)
    if not ranked:
        return Section("Ranking of all candidates", [Paragraph("No candidate was tested.")])
    return Section(
        "Ranking of all candidates",
        [
            Picture(
                "ranking.png",
                "The strongest candidates of each round, the z of their score test and what was "
                "decided."
                + (
                    " Dashed: the z from which a candidate is significant."
                    if findings.thresholds
                    else ""
                ),
            ),
            ranking_table(ranked, findings.least_p),
            Paragraph(
                "Gain of log likelihood: of runs left out, summed over all runs, where the "
                "candidate was refitted together with the law of that round."
            ),
        ],
    )
