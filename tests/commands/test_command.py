"""What all commands have in common."""

import pytest
from click.testing import CliRunner

from adhesion_jax.command_line import discover, identify, montecarlo, track, traction

ASKED = {
    discover: ["roller-rig"],
    identify: ["eurosprinter"],
    montecarlo: [],
    track: ["eurosprinter"],
    traction: ["--system", "hxd1f"],
}


@pytest.mark.parametrize("command", ASKED, ids=lambda command: command.__name__.split(".")[-1])
def test_a_folder_without_a_name_is_refused_and_nothing_is_written(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = CliRunner().invoke(command.main, [*ASKED[command], "--out", ""])
    assert found.exit_code == 2
    assert "the name is empty" in found.output
    assert not list(tmp_path.iterdir())
