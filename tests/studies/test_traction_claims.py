"""The claims on traction control: what they are computed with."""

import jax.numpy as jnp
import numpy as np
import pytest

from adhesion_jax.traction.observers.full_dimension import FullDimension
from adhesion_jax.traction.systems import SYSTEMS, fang2018
from adhesion_jax.traction.systems.base import built
from experiments.claims.fang2018_settings import critical_gain_of
from experiments.claims.hxd1f import settling
from experiments.claims.qian2024_settings import _delay
from experiments.claims.traction import plant_of
from experiments.claims.uyulan2018 import _bound_of_disturbance, _roll


def test_a_double_pole_settles_as_its_step_response():
    plant = plant_of(SYSTEMS["hxd1f"])
    # (1 + x) exp(-x) = .02 at x = 5.83; means over 2 ms.
    poles = jnp.array([-100.0, -200.0, -10.0])
    times, _ = settling([FullDimension(pole) for pole in poles], 3 * [plant])
    assert times[:2] == pytest.approx([0.0583, 0.0292], abs=0.0025)
    assert times[2] == np.inf  # after .2 s it is at 3 exp(-2) = .41


def test_the_critical_gain_is_that_of_eq_18_by_hand():
    """R W g/(i eta) = .43 14000 9.81/(3.036 .98) = 19849; i J/R W g M = 3.036 13.07/.43 5.3795."""
    system = SYSTEMS["fang2018"]
    loop = built(system, system.cases(system.step)[0], plant_of(system))
    assert critical_gain_of(loop) == pytest.approx(19849 + 3.036 * 13.071 / 0.43 * 5.3795, rel=1e-3)
    assert critical_gain_of(loop) == pytest.approx(fang2018.CRITICAL, rel=1e-4)


def test_the_printed_rolling_resistance_and_bound_of_uyulan_by_hand():
    """81357 (6.4 + 55 10.5) = 47.5 MN, the pull 8 5375.33 9.81 .28617 = 120.7 kN."""
    plant = plant_of(SYSTEMS["uyulan2018"])
    assert _roll(plant).ours == pytest.approx(47.504e6 / 120.72e3, rel=1e-3)
    # |Psi| has 2 m_stc/12 where kappa has m_dyn: 10750.7/81357 = .1321, and a little of kappa_0.
    assert _bound_of_disturbance(plant).ours == pytest.approx(0.1321, rel=2e-3)
    assert "kappa = 304" in _bound_of_disturbance(plant).remark


def test_the_delay_ends_with_the_first_of_ten_near_samples():
    near = np.zeros(500, bool)
    near[20:29] = True  # nine in a row are none
    near[100:110] = True
    assert float(_delay(jnp.asarray(near))) == 100
    assert float(_delay(jnp.zeros(500, bool))) == 500
    assert float(_delay(jnp.ones(500, bool))) == 0
