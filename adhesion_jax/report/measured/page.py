"""The report of an identification as a page."""

from collections.abc import Sequence

import pandas as pd

from adhesion_jax.report.page import Items, Page, Paragraph, Section, Table, pictures
from adhesion_jax.report.rendering import Sections

#: Columns of the table of curves that the page shows; the others are in curves.csv.
_SHOWN = ("curve", "rms", "slip_opt", "mu_max", "mu_max_lo", "mu_max_hi", "weight", "status")


def page_of(
    title: str, answer: str, sections: Sections, curves: pd.DataFrame, files: Sequence[str]
) -> Page:
    """The answer, what forbids it, the pictures, the verdict under its titles, and the curves."""
    shown = [name for name in _SHOWN if name in curves]
    rows = [
        [f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row]
        for row in curves[shown].itertuples(index=False)
    ]
    table = Table(shown, rows, right=[name for name in shown if name not in ("curve", "status")])
    warnings = [
        Section(name, [Items(texts)], boxed=True) for name, texts in sections if _warns(name)
    ]
    words = [
        Section(name, [Paragraph(" ".join(texts))]) for name, texts in sections if not _warns(name)
    ]
    return Page(
        f"Adhesion of {title}",
        answer,
        [
            *warnings,
            Section("Figures", pictures("identify", files)),
            *words,
            Section("Curves", [table]),
        ],
    )


def _warns(title: str) -> bool:
    return title in ("No answer", "Not to be trusted", "Warning")
