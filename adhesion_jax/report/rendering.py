"""Pages and texts from the templates, in which a reader finds every sentence as it is written."""

import base64
import math
from collections.abc import Mapping, Sequence

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from adhesion_jax.report.page import Page
from adhesion_jax.report.text import filled
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


def sections_of(template: str, **known: object) -> Sections:
    """The sections of a template that have sentences, which blank lines end; titles follow a §."""
    found: list[tuple[str, list[str]]] = []
    for part in text_of(template, **known).split("\n\n"):
        words = " ".join(part.split())
        if words.startswith("§ "):
            found.append((words[2:], []))
        elif words:
            found[-1][1].append(words)
    return [section for section in found if section[1]]
