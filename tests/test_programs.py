"""Programs are kept where their name tells all that they are made from."""

from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import pytest

from adhesion_jax import programs
from adhesion_jax.curves import CURVES
from adhesion_jax.identifiers import IDENTIFIERS


class Own(eqx.Module):
    factor: float


def made():
    return jax.jit(lambda x: 2 * x).lower(jnp.ones(1)).compile()


@pytest.mark.parametrize(
    "part", [*IDENTIFIERS.values(), *CURVES.values()], ids=[*IDENTIFIERS, *CURVES]
)
def test_the_package_tells_its_own_parts(part):
    assert programs._told(("name", jax.tree.structure(part), 1.0)) is not None


def test_a_class_of_the_user_is_compiled_anew(tmp_path, monkeypatch):
    """Its name stays where its source changes, and nothing but the name would be seen of it."""
    monkeypatch.setattr(programs, "_folder", [tmp_path])
    (tmp_path / "locks").mkdir()
    programs.program(("mine", jax.tree.structure(Own(1.0))), made)
    programs.program(("mine", Own), made)
    programs.program(("mine", lambda: None), made)
    assert not list(tmp_path.glob("*.program"))
    programs.program(("theirs", jax.tree.structure(IDENTIFIERS["riv"])), made)
    assert len(list(tmp_path.glob("*.program"))) == 1


def test_a_file_that_was_named_on_the_command_line_is_told(monkeypatch):
    monkeypatch.setattr(programs, "_outside", {Path(__file__): b"source"})
    assert programs._told(Own) is not None
