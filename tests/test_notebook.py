"""The notebook runs to its end in an empty folder; it is kept with what it showed."""

from pathlib import Path

import nbformat
import pytest

NOTEBOOK = Path(__file__).resolve().parents[1] / "docs" / "example.ipynb"


def outputs(notebook):
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def test_what_is_kept_is_small_and_without_an_error():
    assert NOTEBOOK.stat().st_size < 100_000
    kept = nbformat.read(NOTEBOOK, 4)
    nbformat.validate(kept)
    assert outputs(kept)
    for output in outputs(kept):
        assert output["output_type"] != "error"
        assert output.get("name", "stdout") == "stdout"


@pytest.mark.thorough
@pytest.mark.filterwarnings("default")  # of what runs notebooks
def test_it_runs_to_its_end_and_shows_what_is_kept(tmp_path, monkeypatch):
    # Tests draw into files as commands do; a notebook draws as a user's does.
    monkeypatch.delenv("MPLBACKEND")
    from nbclient import NotebookClient  # slow to import

    notebook = nbformat.read(NOTEBOOK, 4)
    NotebookClient(notebook, timeout=500, resources={"metadata": {"path": str(tmp_path)}}).execute()
    told = [output for output in outputs(notebook) if "data" in output]
    assert any("image/png" in output["data"] for output in told)
    assert any("lateral creep" in output["data"].get("text/html", "") for output in told)
    kept = [output for output in outputs(nbformat.read(NOTEBOOK, 4)) if "data" in output]
    tables = [one["data"]["text/plain"].split("\n")[0] for one in kept]
    assert [one["data"]["text/plain"].split("\n")[0] for one in told] == tables
