"""Pages as HTML and Markdown, and texts from templates, which have every sentence as it is."""

import base64
import math
import re
from collections.abc import Mapping, Sequence

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from adhesion_jax.report.page import Block, Formula, Items, Page, Paragraph, Picture, Section, Table
from adhesion_jax.report.text import aligned, filled
from adhesion_jax.wording import listed, number, p_is, percent, plus_minus

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
    **{one.__name__: one for one in (format, listed, number, p_is, percent, plus_minus)},
    "paragraph": _paragraph,
}
_TEMPLATES.tests["finite"] = math.isfinite


def page_html(page: Page, pictures: Mapping[str, bytes]) -> str:
    """The whole report as one page that needs no other file.

    `pictures` holds the PNG of each figure by the name of its file.
    """
    inline = {name: base64.b64encode(drawn).decode() for name, drawn in pictures.items()}
    return _TEMPLATES.get_template("page.html").render(page=page, pictures=inline)


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


#: What would be taken for markup: names of columns come from the users' files.
_MARKUP = re.compile(r"([\\`*<>|$#~]|\](?=[(\[]))")


def page_markdown(content: Page) -> str:
    """The whole report, as readable unrendered; figures are named as files beside it."""
    parts = [f"# {_escaped(content.title)}", f"**{_escaped(content.verdict)}**"]
    parts += [_section(section) for section in content.sections]
    return "\n\n".join(parts) + "\n"


def _section(section: Section) -> str:
    body = "\n\n".join(_block(block) for block in section.blocks)
    if section.boxed:
        body = "\n".join(f"> {line}".rstrip() for line in body.splitlines())
    return f"## {_escaped(section.title)}\n\n{body}"


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
