"""Texts and tables for a terminal, sentences from templates, and pages as HTML and Markdown."""

import base64
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from adhesion_jax.report.page import Block, Formula, Items, Page, Paragraph, Picture, Section, Table
from adhesion_jax.wording import capital, listed, number, p_is, percent, plus_minus

#: Width of a line.
WIDTH = 96


def filled(text: str) -> str:
    """The text in lines, those after the first indented; names keep their hyphens."""
    return textwrap.fill(text, WIDTH, subsequent_indent="  ", break_on_hyphens=False)


def one_line(text: str) -> str:
    """A file may name its columns with anything: line breaks would break tables and labels."""
    return " ".join(text.split())


def flush_left(table: pd.DataFrame) -> str:
    """A table of texts, headings and cells flush left."""
    # pandas can set the headings flush left, the cells only by padding them.
    padded = table.apply(lambda column: column.str.ljust(column.str.len().max()))
    return padded.to_string(index=False, justify="left")


def aligned(table: Table, written: Callable[[str], str] = str) -> list[list[str]]:
    """The cells as they are written, headings first, each padded to the width of its column."""
    lines = [[*map(written, line)] for line in (table.headings, *table.rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    pads = [str.rjust if name in table.right else str.ljust for name in table.headings]
    return [
        [pad(cell, width) for pad, cell, width in zip(pads, line, widths, strict=True)]
        for line in lines
    ]


def in_columns(table: Table) -> str:
    """The table for a terminal."""
    return "\n".join("  ".join(line).rstrip() for line in aligned(table))


def with_errors(values: Iterable[float], errors: Iterable[float]) -> list[str]:
    return [plus_minus(value, error) for value, error in zip(values, errors, strict=True)]


#: Titles and the sentences under them.
Sections = Sequence[tuple[str, Sequence[str]]]


def _paragraph(text: str) -> str:
    """Lines for a terminal, from lines that are broken where the template is."""
    return filled(" ".join(text.split())) + "\n"


#: In HTML everything is escaped: names of columns come from the users' files.
_TEMPLATES = Environment(
    loader=PackageLoader("adhesion_jax.report"),
    autoescape=select_autoescape(),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_TEMPLATES.filters |= {
    **{
        one.__name__: one
        for one in (capital, format, listed, number, one_line, p_is, percent, plus_minus)
    },
    "paragraph": _paragraph,
}
_TEMPLATES.tests["finite"] = math.isfinite


def write_page(folder: Path, page: Page) -> None:
    """report.html: the whole report in one file, with the pictures of the folder that it shows."""
    blocks = [block for section in page.sections for block in section.blocks]
    files = [block.file for block in blocks if isinstance(block, Picture)]
    inline = {file: base64.b64encode((folder / file).read_bytes()).decode() for file in files}
    html = _TEMPLATES.get_template("page.html").render(
        page=page, pictures=inline, kind=lambda block: type(block).__name__
    )
    (folder / "report.html").write_text(html, encoding="utf-8")


def text_of(template: str, **known: object) -> str:
    """The text of a template for a terminal."""
    return _TEMPLATES.get_template(template).render(**known).strip()


def sentences_of(template: str, **known: object) -> list[str]:
    """What stands between the blank lines of a template, each in one line."""
    parts = text_of(template, **known).split("\n\n")
    return [words for part in parts if (words := " ".join(part.split()))]


def sections_of(template: str, **known: object) -> Sections:
    """The sections of a template that have sentences, which blank lines end; titles follow a §."""
    found: list[tuple[str, list[str]]] = []
    for words in sentences_of(template, **known):
        if words.startswith("§ "):
            found.append((words[2:], []))
        else:
            found[-1][1].append(words)
    return [section for section in found if section[1]]


def page_of(
    template: str, title: str, verdict: str, captions: Mapping[str, str], /, **known: object
) -> Page:
    """The page whose sections a template has, as blocks between blank lines.

    What a block is stands before it: `##` the title of a section (`##!` one in a box), `-` an item,
    `=` a formula, `![FILE]` a picture, whose caption these words follow, `¶` or nothing a
    paragraph. A table stands where the template calls `table` of it. A section without blocks is
    left out.
    """
    tables: list[Table] = []

    def table(of: Table) -> str:
        tables.append(of)
        return f"| {len(tables) - 1}"

    sections: list[tuple[str, list[Block], bool]] = []
    for words in sentences_of(template, table=table, **known):
        mark, _, rest = words.partition(" ")
        if mark in ("##", "##!"):
            sections.append((rest, [], mark == "##!"))
            continue
        blocks = sections[-1][1]
        match mark, blocks:
            case "-", [*before, Items(texts)]:
                blocks[:] = [*before, Items([*texts, rest])]
            case "-", _:
                blocks.append(Items([rest]))
            case "=", _:
                blocks.append(Formula(rest))
            case "|", _:
                blocks.append(tables[int(rest)])
            case _ if mark.startswith("!["):
                file = mark[2:-1]
                blocks.append(Picture(file, " ".join(filter(None, [captions[file], rest]))))
            case _:
                blocks.append(Paragraph(words.removeprefix("¶ ")))
    return Page(title, verdict, [Section(*section) for section in sections if section[1]])


#: What would be taken for markup: names of columns come from the users' files.
_MARKUP = re.compile(r"([\\`*<>|$#~]|\](?=[(\[]))")


def page_markdown(content: Page) -> str:
    """The whole report, as readable unrendered; figures are named as files beside it."""
    parts = [f"# {_escaped(content.title)}", f"**{_escaped(content.verdict)}**"]
    for section in content.sections:
        body = "\n\n".join(map(_block, section.blocks))
        if section.boxed:
            body = "\n".join(f"> {line}".rstrip() for line in body.splitlines())
        parts.append(f"## {_escaped(section.title)}\n\n{body}")
    return "\n\n".join(parts) + "\n"


def _block(block: Block) -> str:
    match block:
        case Paragraph(text):
            return _escaped(text)
        case Formula(text):
            # Nothing is escaped inside code, so that a tick is the one thing that ends it.
            return f"`{text.replace('`', chr(39))}`"
        case Items(texts):
            return "\n".join(f"- {_escaped(text)}" for text in texts)
        case Picture(file, caption):
            return f"![{_escaped(caption)}]({file})"
        case Table():
            return _table(block)


def _table(table: Table) -> str:
    heading, *rows = aligned(table, _escaped)
    rule = [
        "-" * (len(cell) - 1) + (":" if name in table.right else "-")
        for cell, name in zip(heading, table.headings, strict=True)
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in (heading, rule, *rows))


def _escaped(text: str) -> str:
    return _MARKUP.sub(r"\\\1", text)
