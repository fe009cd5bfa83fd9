"""The pages of the documentation: what they link to exists, and their blocks can be read."""

import ast
import re
import textwrap
from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import adhesion_jax

HOME = Path(__file__).resolve().parents[1]
README = HOME / "README.md"
DOCS = sorted((HOME / "docs").rglob("*.md"))
BESIDE = ("results/README.md", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md")
PAGES = [README, *DOCS, *(HOME / name for name in BESIDE)]

LINES_OF_README = 150

WORDS_OF_A_PAGE = 2500

#: Indent, language and content of a fenced block.
BLOCK = re.compile(r"^( *)```(.*)\n((?:.*\n)*?)\1```$", re.MULTILINE)
LINK = re.compile(r"\]\(([^()\s]+)\)")

every_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(HOME)))


def text_of(page):
    return page.read_text(encoding="utf-8")


def prose_of(page):
    """The text of a page without its fenced blocks."""
    return BLOCK.sub("", text_of(page))


def links_of(page):
    """Where the links and pictures of a page within the repository lead: a path and an anchor."""
    prose = re.sub(r"`[^`\n]*`", "", prose_of(page))
    targets = [target for target in LINK.findall(prose) if ":" not in target]
    parts = [target.partition("#") for target in targets]
    return [(page.parent / path if path else page, anchor) for path, _, anchor in parts]


def anchors_of(page):
    """The headings of a page as GitHub makes anchors of them; a repeated one is numbered."""
    seen = Counter()
    for heading in re.findall(r"^#+ +(.*?) *$", prose_of(page), re.MULTILINE):
        words = re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading).lower()
        slug = re.sub(r"[^\w\- ]", "", words).replace(" ", "-")
        yield f"{slug}-{seen[slug]}" if seen[slug] else slug
        seen[slug] += 1


def test_the_readme_is_short():
    assert len(text_of(README).splitlines()) <= LINES_OF_README


@every_page
def test_a_page_says_something_under_a_heading(page):
    first, *others = text_of(page).splitlines()
    assert first.startswith("# ")
    assert len(others) > 10


@every_page
def test_links_and_pictures_lead_somewhere(page):
    wrong = [
        f"{path}#{anchor}"
        for path, anchor in links_of(page)
        if not path.exists() or (anchor and anchor not in anchors_of(path))
    ]
    assert not wrong


def test_the_site_leads_to_every_page():
    navigation = (HOME / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[1]
    named = Counter(re.findall(r"[\w/]+\.md", navigation))
    pages = [page.relative_to(HOME / "docs").as_posix() for page in DOCS]
    assert named == Counter([*pages, "index.md", *BESIDE])


def test_the_public_names_are_those_of_the_package():
    named = re.findall(
        r"^::: adhesion_jax\.(\w+)$", text_of(HOME / "docs" / "api.md"), re.MULTILINE
    )
    assert sorted(named) == adhesion_jax.__all__


@every_page
def test_nothing_is_left_to_be_filled_in(page):
    assert re.findall(r"@@|\bTODO\b|\bFIXME\b|\bXXX\b", text_of(page)) == []


def test_pages_are_not_long():
    assert [page.name for page in DOCS if len(text_of(page).split()) > WORDS_OF_A_PAGE] == []


@every_page
def test_fenced_blocks_are_closed_and_name_their_language(page):
    blocks = BLOCK.findall(text_of(page))
    assert text_of(page).count("```") == 2 * len(blocks)
    assert all(language.strip() for _, language, _ in blocks)


@every_page
def test_python_blocks_are_python(page):
    for _, language, content in BLOCK.findall(text_of(page)):
        if language == "python":
            ast.parse(textwrap.dedent(content))


def test_the_tables_of_other_rails_and_disturbances_are_those_of_the_files():
    judged = pd.read_csv(HOME / "results" / "robustness.csv")
    board = judged.set_index(["method", "rails"])
    page = text_of(HOME / "docs" / "robust.md")
    names = re.search(r"^\| method \| mean of all \| (.+) \|$", page, re.MULTILINE)[1]
    rails = ["all", *(name.strip(" `") for name in names.split("|"))]
    rows = re.findall(r"^\| `([\w-]+)` \| (\.\d+ ± .+) \|$", page, re.MULTILINE)
    assert len(rows) == 8
    for method, cells in rows:
        for name, cell in zip(rails, cells.split("|"), strict=True):
            value = cell.split("±")[0].strip()
            expected = board.loc[(method, name), "utilisation"]
            assert float(value) == pytest.approx(expected, abs=0.51 * 10 ** -decimals(value))
    fair = judged[judged["remark"].isna()].pivot_table(
        index="method", columns="rails", values="utilisation"
    )
    assert (fair.drop(columns="all").idxmax() == "robust-curve").all()
    families = pd.read_csv(HOME / "results" / "leaderboard_families.csv")
    best = families[families["rank"] == 1].set_index("rails")
    page = text_of(HOME / "docs" / "offset_curve.md")
    rows = re.findall(r"^\| `([\w-]+)` \| (.+?) ± \S+ \| (\S+) \| (\S+) ±", page, re.MULTILINE)
    assert [name for name, *_ in rows] == [*best.index]
    assert (best["method"] == "offset-curve").all()
    columns = ("utilisation", "worst", "utility_1_share")
    for name, *cells in rows:
        for column, value in zip(columns, cells, strict=True):
            expected = best.loc[name, column]
            assert float(value) == pytest.approx(expected, abs=0.51 * 10 ** -decimals(value))


def test_the_measured_leaderboard_is_that_of_the_file():
    board = pd.read_csv(HOME / "results" / "leaderboard.csv").set_index("method")
    section = (
        text_of(HOME / "docs" / "leaderboard.md")
        .partition("## What was measured")[2]
        .partition("\n## ")[0]
    )
    rows = re.findall(r"^\| (`[\w-]+`|true optimum) \| (.+) \|$", section, re.MULTILINE)
    names = ("utilisation", "worst", "never95", "t95_median", "utility_1_share")
    assert len(rows) == 13
    for method, cells in rows:
        of = board.loc[method.strip("`").replace(" ", "-")]
        for name, cell in zip(names, cells.split("|"), strict=True):
            if not cell.strip():
                assert np.isnan(of[name])
                continue
            value, *error = re.findall(r"[\d.]+", cell)
            assert float(value) == pytest.approx(of[name], abs=0.51 * 10 ** -decimals(value))
            for one in error:
                assert float(one) == pytest.approx(
                    of[f"{name}_se"], abs=0.51 * 10 ** -decimals(one)
                )


def decimals(number):
    return len(number.partition(".")[2])
