"""A fall with the slip velocity is the curve's own where that describes it as well, and plainer."""

import pytest
from discovery_campaigns import SIZE, runs_of

from adhesion_jax.discovery.engine import discover
from experiments.campaigns.simulator import simulate

pytestmark = pytest.mark.thorough


@pytest.mark.parametrize("seed", [1, 2, 4])
def test_a_curve_that_falls_by_itself_lacks_nothing(seed):
    """Polach's curve with falling friction, in the noise of .007 of the simulator."""
    found = discover(runs_of(simulate(seed=seed, base="polach-falling", **SIZE).train))
    assert found.base.startswith("polach")
    assert found.effects == found.unexplained == ()
    assert found.train.after.value == pytest.approx(0.007, rel=0.06)


@pytest.mark.parametrize(("cause", "base"), [("falling_friction", "exponential")])
def test_a_fall_beside_another_curve_is_named(cause, base):
    found = discover(runs_of(simulate([cause], seed=1, base=base, **SIZE).train))
    assert found.base == base
    assert [effect.name for effect in found.effects] == [cause]


def test_an_effect_is_not_let_in_by_the_p_of_another():
    """A joint shows in the spectrum over the track: the p of that, and not of a form by chance."""
    found = discover(runs_of(simulate(["rail_joint"], seed=1, base="polach-falling", **SIZE).train))
    assert [effect.name for effect in found.effects] == ["rail_joint"]
    assert all(effect.p_adjusted <= 0.01 for effect in found.effects)
