"""Effects of the user's own that are named after a first fit: registries are read when used."""

import jax.numpy as jnp
import numpy as np
import pytest
from discovery_campaigns import TRUE, campaign, curve, noise, setting_of

from adhesion_jax.discovery.model.fitting import fit_model
from adhesion_jax.discovery.model.packing import base_places
from adhesion_jax.discovery.model.program import fit
from adhesion_jax.effects import EFFECTS, Covariate
from adhesion_jax.effects.api import Facts, Multiplier, Scalar

FACTS = Facts(
    source="made up",
    described={"k": ("1", -1.0, 1.0, "strength")},
    strengths=("k",),
    needs=("warm",),
    starts=({"k": 0.01},),
    sentence="Warmth acts.",
    formula="mu exp(k w)",
    phrase="warmth",
    family="warmth",
)


class Warmth(Multiplier):
    k: Scalar
    FACTS = FACTS

    def factor(self, slip, conditions):
        return jnp.exp(self.k * conditions["warm"])


class Doubled(Warmth):
    def factor(self, slip, conditions):
        return jnp.exp(2 * self.k * conditions["warm"])


@pytest.mark.thorough
def test_an_effect_that_is_named_after_a_fit_is_fitted_and_its_next_version_too(monkeypatch):
    # Beside few others its programs are small.
    for name in [*EFFECTS][3:]:
        monkeypatch.delitem(EFFECTS, name)
    draw = np.random.default_rng(3)
    table = campaign(draw)
    table["adhesion"] = curve(table["slip_ratio"]) * np.exp(0.1 * table["warm"]) + noise(draw)
    # Of the programs each fits once.
    monkeypatch.setitem(fit.options, "xla_backend_optimization_level", "0")
    setting = setting_of(table, 0.006)
    first = fit_model(setting, "burckhardt", TRUE, (Covariate(0.0, 0.0, 0.6, column="warm"),))
    before = base_places("burckhardt")
    for kind, strength in ((Warmth, 0.1), (Doubled, 0.05)):
        monkeypatch.setitem(EFFECTS, "Warmth", kind)
        found = fit_model(setting_of(table, 0.006), "burckhardt", TRUE, (kind(0.01),))
        (effect,) = found.effects
        assert effect.k == pytest.approx(strength, abs=0.01)
        np.testing.assert_allclose(found.adhesion, first.adhesion, atol=2e-3)
    assert base_places("burckhardt") == before
