"""A report as one HTML page that needs no other file."""

import base64
from collections.abc import Mapping

from jinja2 import Environment, PackageLoader, StrictUndefined

from adhesion_jax.report.page import Page

#: Everything is escaped: names of columns come from the users' files.
_TEMPLATES = Environment(
    loader=PackageLoader("adhesion_jax.report"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def page_html(page: Page, pictures: Mapping[str, bytes]) -> str:
    """The whole report; `pictures` holds the PNG of each figure by the name of its file."""
    inline = {name: base64.b64encode(drawn).decode() for name, drawn in pictures.items()}
    return _TEMPLATES.get_template("page.html").render(page=page, pictures=inline)
