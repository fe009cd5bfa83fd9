"""The site has docs/ at its top: what pages link to outside that folder is put beside it.

README.md is the first page of the site. Links stay those of the repository in the sources.
"""

import os
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

HOME = Path(__file__).parent

#: The pages that do not lie in docs/.
BESIDE = (*HOME.glob("*.md"), HOME / "results" / "README.md")

LINK = re.compile(r"(?<=\]\()[^():\s#]+")


def address(path: Path) -> str:
    """Where a file of the repository stands on the site."""
    inside = path.relative_to(HOME).as_posix()
    return "index.md" if inside == "README.md" else inside.removeprefix("docs/")


def target(page: Path, link: str) -> Path:
    return Path(os.path.normpath(page.parent / link))


def on_files(files: Files, config: Any) -> Files:
    pages = [*BESIDE, *(HOME / "docs").rglob("*.md")]
    linked = {
        target(page, link) for page in pages for link in LINK.findall(page.read_text("utf-8"))
    }
    for path in {*BESIDE, *linked}:
        if path.is_file() and HOME / "docs" not in path.parents:
            files.append(File.generated(config, address(path), abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    source = Path(page.file.abs_src_path)
    folder = os.path.dirname(page.file.src_uri)

    def of_site(link: re.Match[str]) -> str:
        path = target(source, link[0])
        return os.path.relpath(address(path), folder or ".") if path.is_file() else link[0]

    return LINK.sub(of_site, markdown)
