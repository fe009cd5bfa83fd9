"""The claims on traction control: what they are computed with."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array

from adhesion_jax.traction.loop import Trace
from adhesion_jax.traction.observers import Observer
from adhesion_jax.traction.observers.full_dimension import FullDimension
from adhesion_jax.traction.systems import SYSTEMS, fang2018
from adhesion_jax.traction.systems.base import built
from experiments.claims.fang2018 import critical_gain_of
from experiments.claims.hxd1f import _operations, settling
from experiments.claims.qian2024 import _delay
from experiments.claims.traction import Runs, changed, plant_of
from experiments.claims.uyulan2018 import _bound_of_disturbance, _rises, _roll


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


def test_the_printed_rolling_resistance_of_uyulan_by_hand():
    """81357 (6.4 + 55 10.5) = 47.5 MN, the pull 8 5375.33 9.81 .28617 = 120.7 kN."""
    plant = plant_of(SYSTEMS["uyulan2018"])
    assert _roll(plant).ours == pytest.approx(47.504e6 / 120.72e3, rel=1e-3)


class Sample(NamedTuple):
    train_speed: Array
    adhesion: Array


def test_the_bound_of_uyulan_by_hand():
    """At the peak of the dry surface, 10.5 m/s: T_a = 2 5375.33 9.81 .28617 .31 = 9356 N m.

    F_L = 64504 9.81 sin(6.5 deg) + 1982 (Davis, 37.8 km/h) + 67 (Roeckl) = 73.68 kN, J_dyn = 81357
    .31^2 = 7818 kg m^2: Psi = .31 73680/7818 - (1/240 + 1/7818) 9356 = -37.26 rad/s^2, of kappa phi
    = 304 (1 + .0154 10.5 + .00467 110.25) = 304 1.6766.
    """
    system = SYSTEMS["uyulan2018"]
    loop = built(system, system.cases(system.step)[0], plant_of(system))
    sample = Sample(jnp.full((6, 1), 10.5), jnp.full((6, 1, 1), 0.28617))
    runs = Runs(("all",), {}, Trace(**dict.fromkeys(Trace._fields) | {"sample": sample}))
    found = _bound_of_disturbance(loop, runs)
    assert found.ours == pytest.approx(37.26 / (304 * 1.6766), rel=2e-3)
    assert "goes to 37.3 rad/s²" in found.remark
    assert "kappa = 304" in found.remark


def test_a_function_rises_where_it_does_and_not_beside_a_switch():
    time = 0.5 * np.arange(48)
    falling = np.linspace(2.0, 1.0, 48)
    up = falling.copy()
    up[5:] += 0.3  # one step of the 43 that count, by .3 less what it falls
    up[20:] += 5.0  # the rail changes at 10 s
    found = _rises(np.stack([falling, up]), time)
    assert found.share == pytest.approx([0.0, 100 / 43])
    assert found.sum == pytest.approx([0.0, 0.3 - 1 / 47])


def test_the_operations_of_a_step_are_those_of_its_equations():
    system = SYSTEMS["hxd1f"]
    loop = built(system, system.cases(system.step)[0], plant_of(system))

    class Twice(Observer):
        def init(self, nominal, measured):
            return measured.motor_speed

        def update(self, state, nominal, measured, torque, step):
            return state + step * measured.motor_speed  # one product and one sum

    assert _operations(changed(loop, observer=Twice())) == 2


def test_the_delay_ends_with_the_first_of_ten_near_samples():
    near = np.zeros(500, bool)
    near[20:29] = True  # nine in a row are none
    near[100:110] = True
    assert float(_delay(jnp.asarray(near))) == 100
    assert float(_delay(jnp.zeros(500, bool))) == 500
    assert float(_delay(jnp.ones(500, bool))) == 0
