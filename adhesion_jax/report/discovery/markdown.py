"""A discovery as a page of Markdown that is as readable unrendered."""

import re

from adhesion_jax.report.page import Block, Formula, Items, Page, Paragraph, Picture, Section, Table
from adhesion_jax.report.text import aligned

#: What would be taken for markup: names of columns come from the users' files.
_MARKUP = re.compile(r"([\\`*<>|$#~]|\](?=[(\[]))")


def discovery_markdown(content: Page) -> str:
    """The whole report; figures are named as files beside it."""
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
