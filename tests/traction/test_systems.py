"""The three systems against the numbers known of their papers' methods."""

import dataclasses
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from adhesion_jax.metrics.closed_loop import by_segment, figures, whole
from adhesion_jax.traction.controllers import CONTROLLERS
from adhesion_jax.traction.loop import run, timing
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.seekers import SEEKERS
from adhesion_jax.traction.sensors import Sensors
from adhesion_jax.traction.signals import Reference, Signals
from adhesion_jax.traction.systems import SYSTEMS, fang2018, uyulan2018
from adhesion_jax.traction.systems.base import built, with_parts

KEY = jax.random.key(0)


def loops_of(name, method):
    """Of each scenario under a method."""
    system = SYSTEMS[name]
    plant = read_plant(shipped()[system.plant]).plant
    cases = system.cases(system.step)
    return [built(system, case, plant) for case in cases if case.method == method]


def grid_of(name, loop, duration=None):
    system = SYSTEMS[name]
    period = system.control_period or system.step
    return timing(loop, system.step, period, duration or system.duration)


@partial(jax.jit, static_argnums=1)
def of_segments(loop, grid):
    return figures(by_segment(run(loop, grid, KEY)), grid.sample_period)


@cache
def utilisation(method):
    """Of the HXD1F on the dry, the wet and the snowy rail."""
    (loop,) = loops_of("hxd1f", method)
    grid = grid_of("hxd1f", loop)
    return np.asarray(of_segments(loop, grid)["utilisation"])


@pytest.mark.thorough
def test_eq_9_settles_on_roads_2_and_3_by_its_gain():
    (loop,) = loops_of("fang2018", "Eq. 9, K2 7000")
    # Road 2 begins at 55 km/h, road 3 at 85 km/h: two seconds settle, and eight are counted.
    grid = grid_of("fang2018", loop, 10.0)

    @jax.jit
    @jax.vmap
    def settled(gain, kmh):
        controller = dataclasses.replace(loop.controller, adhesion_gain=gain)
        tuned = dataclasses.replace(loop, controller=controller, train_speed=kmh / 3.6)
        return figures(by_segment(run(tuned, grid, KEY)), grid.sample_period)

    gains = jnp.array([7000.0, 18000.0, 1.02 * fang2018.CRITICAL])
    starts = jnp.array([55.0, 85.0])
    found = settled(jnp.tile(gains, 2), jnp.repeat(starts, 3))

    def by_road(name):
        values = np.asarray(found[name]).reshape(2, 3, -1)
        return np.array([values[0, :, 1], values[1, :, 2]])

    slips = [[2.65, 4.64, 5.71], [2.25, 3.52, 4.15]]
    np.testing.assert_allclose(3.6 * by_road("slip_settled"), slips, rtol=0.02)
    shares = [[0.813, 0.983, 0.995], [0.875, 0.991, 0.998]]
    np.testing.assert_allclose(by_road("utilisation_settled"), shares, atol=0.005)


@pytest.mark.thorough
def test_the_printed_seeker_of_uyulan_estimates_as_it_does():
    loops = loops_of("uyulan2018", "as printed")
    grid = grid_of("uyulan2018", loops[0])
    rails = jax.tree.map(lambda *each: jnp.stack(each), *(loop.rails for loop in loops))

    @jax.jit
    @jax.vmap
    def error(rails):
        totals = run(dataclasses.replace(loops[0], rails=rails), grid, KEY)
        return figures(whole(totals), grid.sample_period)["estimation_rms"][0]

    # In the order of Table 1, whose own row no reading gives.
    assert [*uyulan2018.PRINTED][3] == ("dry", "wet")
    expected = [0.1874, 0.1877, 0.1885, 0.1857, 0.1866, 0.1869]
    np.testing.assert_allclose(error(rails), expected, rtol=0.01)


@pytest.mark.long
def test_differential_acceleration_uses_less_than_the_seeker():
    used = utilisation("DAC")
    np.testing.assert_allclose(used, [0.854, 0.666, 0.605], atol=0.02)


def test_the_lag_of_a_double_pole_loses_the_wet_rail():
    used = utilisation("SMES, full dimension -233, ABLF")
    np.testing.assert_allclose(used[:2], [0.888, 0.49], atol=0.02)


@pytest.mark.thorough
def test_an_encoder_turns_with_the_motor_and_its_pulses_disturb_the_observer():
    (loop,) = loops_of("hxd1f", "SMES, full dimension -233, ABLF")
    found = {}
    for pulses in (0, 2000, 4):
        counting = dataclasses.replace(loop, sensors=Sensors(period=1e-3, pulses=pulses))
        grid = grid_of("hxd1f", counting, 1.0)
        found[pulses] = of_segments(counting, grid)
    none, fine, coarse = (float(found[pulses]["adhesion_rms"][0]) for pulses in found)
    # At 50 rad/s a pulse of the fine one takes .06 ms, one of the coarse one 31 ms.
    assert fine == pytest.approx(none, rel=1e-3)
    assert fine != none
    assert coarse > 1.1 * none
    used = [float(found[pulses]["utilisation"][0]) for pulses in (0, 2000)]
    assert used[1] == pytest.approx(used[0], rel=0.02)


def test_parts_take_the_place_of_the_papers():
    system = SYSTEMS["uyulan2018"]
    cases = system.cases(system.step)
    assert with_parts(cases, None, None, None) is cases
    found = with_parts(cases, "kalman", None, None)
    assert [case.scenario for case in found] == list(dict.fromkeys(c.scenario for c in cases))
    assert {case.method for case in found} == {"observer kalman"}
    # The paper's own, and not the true optimum that stands beside it.
    assert all(case.seeker is SEEKERS["gradient-uyulan2018"] for case in found)
    whole_law = with_parts(cases, None, None, "slope-feedback")
    assert all(case.seeker is None for case in whole_law)


def test_the_roads_of_fang_have_the_form_that_the_other_papers_print():
    """b/a of the dry rail of Uyulan et al. 2018, 1.2/.54, and of the surfaces of the HXD1F."""
    law = fang2018.road(0.2, 6.5).law
    assert law.b / law.a == pytest.approx(1.2 / 0.54, rel=1e-4)
    assert law.b / law.a == pytest.approx(7.2592 / 3.2666, rel=1e-4)
    peak = law.peak({}, 10.0)
    assert float(peak.adhesion) == pytest.approx(0.2, rel=1e-9)
    assert 3.6 * float(peak.slip) == pytest.approx(6.5, rel=1e-9)


@pytest.mark.parametrize(("kmh", "found"), [(35.5, True), (36.5, False)])
def test_a_peak_is_looked_for_as_far_as_in_a_log_up_to_a_slip_of_36_km_per_hour(kmh, found):
    peak = fang2018.road(0.2, kmh).peak(jnp.asarray(20.0))
    assert bool(peak.found) == found


def test_without_adhesion_the_printed_resistance_alone_is_to_be_overcome():
    """R_0 = 1109.8 N of the paper on its dynamic mass: r kappa = R_0/m_dyn, in m/s^2."""
    plant = read_plant(shipped()["uyulan2018"]).plant
    controller = CONTROLLERS["adaptive-robust"]
    none = jnp.zeros((1, 1))
    found = float(uyulan2018.lyapunov(controller, plant, none, none, none)[0, 0])
    effect = 0.31 * 6.92 / 1748.26
    assert np.sqrt(2 * 19 * effect * found) == pytest.approx(1109.8 / 81357.19, rel=1e-4)


def errors_under_the_barrier(first, samples):
    """The error of the slip of the HXD1F from sample to sample, from a first one on."""
    plant = read_plant(shipped()["hxd1f"]).plant
    barrier = dataclasses.replace(CONTROLLERS["barrier"], least=-1e6)
    none, period = jnp.zeros(1), SYSTEMS["hxd1f"].control_period
    train = plant.acceleration(none, jnp.asarray(5.0))
    lever = plant.radius / (plant.gear_ratio * plant.inertia)

    @jax.jit
    def after(error):
        signals = Signals(
            jnp.zeros(()), none + 1.0, none, jnp.asarray(5.0), error, none, none, none, none, None
        )._replace(reference=Reference(none, none))
        _, torque = barrier.update((), plant, signals, period)
        return error + period * (lever * torque - train)

    course = [none + first]
    for _ in range(samples):
        course.append(after(course[-1]))
    return np.ravel(course)


def test_within_its_barrier_an_error_falls_to_a_third_in_fifty_milliseconds():
    """By exp(-k t) near to the reference, k = 20 1/s."""
    course = errors_under_the_barrier(1e-4, 50)
    assert course[-1] / course[0] == pytest.approx(np.exp(-1), rel=0.02)


def test_beyond_its_barrier_the_controller_of_the_hxd1f_is_stable_from_sample_to_sample():
    """Its gain is not to exceed 1/period, from where on an error changes its sign in one sample."""
    course = errors_under_the_barrier(5 * CONTROLLERS["barrier"].above, 300)
    assert np.all(course > 0)
    assert np.all(np.diff(course) < 0)
    assert course[-1] < 0.01 * course[0]
