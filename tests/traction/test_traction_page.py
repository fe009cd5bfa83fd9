"""The Python of the page on traction runs as it stands there."""

import re
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[2] / "docs" / "traction.md"


@pytest.mark.long
def test_the_python_of_the_page_runs(capsys):
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 2
    exec("\n".join(blocks), {})
    shares = [float(text) for text in re.findall(r"[\d.]+(?:e-\d+)?", capsys.readouterr().out)]
    assert 0.2 < shares[0] < 1
