"""The Python of the pages runs as it stands, each page from its top in an empty folder."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import adhesion_jax as aj

HOME = Path(__file__).resolve().parents[1]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def run(page, folder):
    """What the blocks of a page print, one after the other in one process."""
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    assert blocks
    done = subprocess.run(
        [sys.executable, "-c", "\n".join(blocks)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=500,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.long
def test_the_readme(tmp_path):
    shutil.copy(aj.SHIPPED["eurosprinter"].path, tmp_path / "my_measurement.csv")
    told = run(HOME / "README.md", tmp_path)
    assert re.search(r"^polach-falling 0\.3033\d* \(0\.2988\d*, 0\.3080\d*\)$", told, re.MULTILINE)


@pytest.mark.thorough
def test_the_page_on_python(tmp_path):
    told = run(HOME / "docs" / "python.md", tmp_path)
    assert "lateral creep" in told
    assert aj.load_law(tmp_path / "law.json").effects


def test_examples_are_short():
    for block in BLOCK.findall((HOME / "docs" / "python.md").read_text(encoding="utf-8")):
        assert len([line for line in block.splitlines() if line]) <= 6, block
