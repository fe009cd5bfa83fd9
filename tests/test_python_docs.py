"""The Python of the pages runs as it stands, each page from its top in an empty folder."""

import re
import textwrap
from pathlib import Path

import pandas as pd
import pytest

import adhesion_jax as aj

HOME = Path(__file__).resolve().parents[1]
PAGES = (HOME / "README.md", HOME / "docs" / "python.md")
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_blocks_run(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    pd.read_csv(aj.SHIPPED["eurosprinter"].path).to_csv("my_measurement.csv", index=False)
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    assert blocks
    names = {"__name__": "page"}
    for block in blocks:
        exec(compile(textwrap.dedent(block), str(page), "exec"), names)
    assert "kiencke" in capsys.readouterr().out
    if page.name == "python.md":
        assert names["same"](0.02, names["conditions"]) == names["missing"].law(
            0.02, names["conditions"]
        )
        assert names["follow"](names["slips"], names["adhesions"]).shape == (1000, 50)
