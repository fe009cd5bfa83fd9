"""Parts of the user's own, given to the functions of the library."""

import dataclasses
import re
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

import adhesion_jax as aj
from adhesion_jax import plugins
from adhesion_jax.curves import CURVES
from adhesion_jax.effects import EFFECTS

PAGE = (Path(__file__).parents[2] / "docs" / "extending.md").read_text(encoding="utf-8")


def defined(file):
    """What stands in an example of the page."""
    names = {"__name__": "__main__"}
    exec(re.search(rf"```python\n# {file}\n(.*?)```", PAGE, re.DOTALL)[1], names)
    return names


@pytest.fixture(autouse=True)
def registries(monkeypatch):
    """As they were, afterwards."""
    for registry in (CURVES, EFFECTS):
        monkeypatch.setitem(registry, "Mine", None)
        monkeypatch.delitem(registry, "Mine")
    monkeypatch.setattr(plugins, "_own", set())


@pytest.mark.long
def test_a_curve_of_ones_own_is_fitted_saved_and_loaded_and_may_be_defined_anew(tmp_path):
    for level in (0.3, 0.2):
        curve = defined("hyperbolic.py")["Hyperbolic"](a=level)
        found = aj.identify("eurosprinter", {"Mine": curve})
        assert found.best == "Mine"
        assert CURVES["Mine"] is curve
        found.write(tmp_path)
        law, slip = aj.load_law(tmp_path / "law.json"), jnp.linspace(0.001, 0.05, 9)
        np.testing.assert_allclose(law(slip, {}), found.curve(slip, {}), rtol=1e-12)
    with pytest.raises(aj.InputError, match="kiencke has the name of another part"):
        aj.identify("eurosprinter", {"kiencke": defined("hyperbolic.py")["Hyperbolic"]()})


def test_what_is_no_effect_is_refused_in_a_sentence():
    mine = defined("leaves.py")["Leaves"]
    with pytest.raises(aj.InputError, match="int is not an effect: derive it from"):
        plugins.add("effect", {"int": int})
    with pytest.raises(aj.InputError, match="humidity has the name of another part"):
        aj.discover("roller-rig", effects={"humidity": mine})
    assert "Leaves" not in EFFECTS


@pytest.mark.slow
def test_an_effect_that_is_named_after_a_first_search_is_found(tmp_path):
    draw = np.random.default_rng(4)
    runs, points = 24, 80
    slip = np.tile(np.linspace(0.002, 0.06, points), runs)
    cover = np.repeat(draw.uniform(0, 1, runs), points)
    clean = 0.3 * (1 - np.exp(-100 * slip)) - 0.3 * slip
    adhesion = clean * (1 - 0.25 * cover) + 0.004 * draw.standard_normal(slip.size)
    table = pd.DataFrame({"slip_ratio": slip, "adhesion": adhesion, "leaf_cover": cover})
    table["run"] = np.repeat(np.arange(runs), points)
    before = aj.discover(table, curves="burckhardt")
    assert "covariate:leaf_cover" in {*before.effects["effect"]}
    kind = defined("leaves.py")["Leaves"]
    found = aj.discover(table, curves="burckhardt", effects={"Mine": kind})
    row = found.effects.set_index(["effect", "parameter"]).loc["Mine", "k"]
    assert row["lo"] < 0.25 < row["hi"]
    found.write(tmp_path)
    again = aj.load_law(tmp_path / "law.json")
    assert dataclasses.asdict(again.effects[0]) == dataclasses.asdict(found.law.effects[0])
