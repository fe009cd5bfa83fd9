"""The loop against closed forms, brute force and the figures of three published systems."""

import dataclasses
import itertools
from functools import cache, partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from lanes import lanes
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from adhesion_jax.errors import InputError
from adhesion_jax.metrics.closed_loop import by_segment, figures, whole
from adhesion_jax.traction.controllers import CONTROLLERS
from adhesion_jax.traction.driver import Driver
from adhesion_jax.traction.loop import check, largest_step, run, timing, trace
from adhesion_jax.traction.observers import OBSERVERS
from adhesion_jax.traction.observers.full_dimension import FullDimension
from adhesion_jax.traction.plants.base import Held, held_by
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.plants.rigid_axles import RigidAxles
from adhesion_jax.traction.rails import by_time
from adhesion_jax.traction.seekers import SEEKERS
from adhesion_jax.traction.sensors import Sensors, SpeedNoise
from adhesion_jax.traction.signals import Measurement
from adhesion_jax.traction.surface import exponential
from adhesion_jax.traction.systems import SYSTEMS, fang2018, hxd1f, uyulan2018
from adhesion_jax.traction.systems.base import built


@cache
def plant_of(name):
    return read_plant(shipped()[name]).plant


def loop_of(name, method, scenario=None, noisy=False):
    system = SYSTEMS[name]
    case = next(
        case
        for case in system.cases(system.step)
        if case.method == method and scenario in (None, case.scenario)
    )
    return built(system, case, plant_of(system.plant), noisy)


def grid_of(name, loop, duration=None):
    system = SYSTEMS[name]
    period = system.control_period or system.step
    return timing(loop, system.step, period, duration or system.duration)


_run = jax.jit(run, static_argnums=1)
_trace = jax.jit(lambda loop, grid, key: trace(loop, grid, key)[1], static_argnums=1)
_many = jax.jit(jax.vmap(run, (None, None, 0)), static_argnums=1)


@partial(jax.jit, static_argnums=1)
def _figures(loop, grid, key):
    """Of each segment."""
    return figures(by_segment(run(loop, grid, key)), grid.sample_period)


_peak = jax.jit(lambda surface: surface.peak(jnp.asarray(10.0)))
KEY = jax.random.key(0)


@pytest.mark.parametrize(
    ("surfaces", "expected"),
    [
        (hxd1f.SURFACES, {"dry": (0.2, 0.36), "wet": (0.08, 0.2), "snow": (0.05, 0.1)}),
        (
            uyulan2018.SURFACES,
            {
                "dry": (1.20986, 0.28617),
                "wet": (1.20986, 0.10016),
                "low": (1.20986, 0.02862),
                "very low": (1.33954, 0.01116),
            },
        ),
        ({"2": fang2018.road(0.07, 5.5)}, {"2": (5.5 / 3.6, 0.07)}),
    ],
)
def test_surfaces_have_the_peaks_of_their_papers(surfaces, expected):
    for name, (slip, adhesion) in expected.items():
        peak = _peak(surfaces[name])
        assert bool(peak.found)
        assert float(peak.slip) == pytest.approx(slip, rel=1e-4)
        assert float(peak.adhesion) == pytest.approx(adhesion, rel=3e-4)


def test_the_critical_gain_of_fang_is_that_of_its_parameters():
    plant = plant_of("fang2018")
    weight = float(plant.axle_load[0]) * 9.81
    radius, ratio = float(plant.wheel_radius[0]), float(plant.gear_ratio)
    ours = radius * weight / (ratio * float(plant.gear_efficiency))
    ours += ratio * float(plant.inertia[0]) / radius * weight / float(plant.train_mass)
    assert ours == pytest.approx(fang2018.CRITICAL, rel=1e-4)


def test_eq_9_settles_where_its_torque_holds_the_slip():
    # dv_s = 0: T - T_L = (i J/r) dV, with T = K1 mu' + K2 mu.
    plant, surface, speed = plant_of("fang2018"), fang2018.road(0.07, 5.5), jnp.asarray(70 / 3.6)
    slope = jax.grad(lambda slip: surface(slip, speed))

    @jax.jit
    def left(slip):
        adhesion = surface(jnp.full(1, slip), speed)
        turning = plant.gear_ratio * plant.inertia / plant.radius
        needed = plant.load_of(adhesion) + turning * plant.acceleration(adhesion, speed)
        return (19000 * slope(slip) + 18000 * adhesion - needed)[0]

    expected = 3.6 * brentq(left, 0.5, 5.5 / 3.6)
    found = trace_of_eq_9()
    near = np.abs(np.asarray(found.sample.train_speed - speed)) < 0.5
    near &= np.asarray(found.sample.segment) == 1
    assert near.sum() > 100
    slip = 3.6 * np.asarray(found.sample.slip)[near, 0]
    assert slip.mean() == pytest.approx(expected, rel=0.01)


@cache
def trace_of_eq_9():
    loop = loop_of("fang2018", "Eq. 9, K2 18000")
    loop = dataclasses.replace(loop, train_speed=jnp.asarray(50 / 3.6))
    return _trace(loop, grid_of("fang2018", loop, 20.0), KEY)


def watched(observer, load, seconds, step=1e-4, name="hxd1f"):
    """The load that an observer tells, of a motor that turns by Euler steps under that load."""
    nominal = plant_of(name)
    times = jnp.arange(round(seconds / step)) * step
    torque = jnp.full(1, 5000.0)

    def one(both, time):
        speed, state = both
        loaded = load(time)
        measured = Measurement(speed, jnp.asarray(5.0), jnp.sin(time)[None], jnp.full(1, loaded))
        state = observer.update(state, nominal, measured, torque, step)
        speed = speed + step * (torque - loaded) / nominal.inertia
        return (speed, state), (state.load[0], state.slip[0])

    speed = jnp.full(1, 50.0)
    first = Measurement(speed, jnp.asarray(5.0), jnp.zeros(1), jnp.zeros(1))
    begin = (speed, observer.init(nominal, first))
    _, (found, slip) = jax.jit(partial(jax.lax.scan, one))(begin, times)
    return np.asarray(times), np.asarray(found), np.asarray(slip)


@pytest.mark.parametrize("name", OBSERVERS)
def test_observers_come_to_a_constant_load_and_follow_a_ramp(name):
    observer = OBSERVERS[name]
    _, found, _ = watched(observer, lambda _: 3000.0, 1.0)
    assert abs(found[-2000:].mean() - 3000) < 30
    # A switch of the terminal sliding mode in one step is J K h = 142 N m.
    assert np.abs(found[-2000:] - 3000).max() < 200
    time, found, _ = watched(observer, lambda time: 1000 * time, 1.0)
    assert np.abs(found - 1000 * time)[-2000:].max() < 200


def test_a_double_pole_settles_as_its_step_response():
    # (1 + x) exp(-x) = .02 at x = |p| t = 5.83.
    pole = -100.0
    time, found, slip = watched(FullDimension(pole), lambda _: 3000.0, 0.2)
    left = np.abs(1 - found / 3000)
    assert time[np.nonzero(left > 0.02)[0][-1]] == pytest.approx(5.83 / 100, rel=0.02)
    exact = 1 - (1 + 100 * time) * np.exp(-100 * time)
    np.testing.assert_allclose(found / 3000, exact, atol=5e-3)
    # The slip passes the same filter: sin t behind it.
    lagging = np.sin(time - 0.02)
    assert np.abs(slip - lagging)[time > 0.1].max() < 1e-3


@pytest.mark.parametrize("name", ["full-dimension", "kalman"])
def test_slip_has_the_lag_of_the_load(name):
    # What is a slip to the filter is a load to the observer, in units of each.
    observer = OBSERVERS[name]
    time, load, slip = watched(observer, lambda time: 1000 * jnp.sin(time), 1.0)
    assert np.abs(load / 1000 - slip)[time > 0.5].max() < 1e-2


def test_a_curve_traced_up_and_down_is_one_curve():
    plant = plant_of("hxd1f")
    surface = exponential(3.2666, 7.2592, 1.2580)
    observer, step = OBSERVERS["full-dimension"], 1e-4

    def one(both, time):
        speed, state = both
        slip = 0.3 - jnp.abs(time - 0.3)  # 1 m/s^2 up and down
        adhesion = surface(jnp.full(1, slip), jnp.asarray(5.0))
        # The torque that gives this slip: its own account of the motor keeps the observer exact.
        rate = jnp.where(time < 0.3, 1.0, -1.0) * plant.gear_ratio / plant.radius
        torque = plant.load_of(adhesion) + plant.inertia * rate
        measured = Measurement(speed, jnp.asarray(5.0), jnp.full(1, slip), None)
        state = observer.update(state, plant, measured, torque, step)
        seen = plant.adhesion_of(state.load)
        return (speed + step * rate, state), (seen[0], state.slip[0])

    speed = jnp.full(1, 50.0)
    first = Measurement(speed, jnp.asarray(5.0), jnp.zeros(1), None)
    times = jnp.arange(6000) * step
    begin = (speed, observer.init(plant, first))
    _, (adhesion, slip) = jax.jit(partial(jax.lax.scan, one))(begin, times)
    adhesion, slip = np.asarray(adhesion), np.asarray(slip)
    top = int(np.argmax(slip))
    levels = np.linspace(0.1, 0.28, 50)
    up = np.interp(levels, slip[:top], adhesion[:top])
    down = np.interp(levels, slip[:top:-1], adhesion[:top:-1])
    assert np.abs(up - down).max() < 1e-3
    # Without the filter on the slip it would be two.
    raw = 0.3 - np.abs(np.asarray(times) - 0.3)
    unmatched = np.interp(levels, raw[:3000], adhesion[:3000])
    unmatched -= np.interp(levels, raw[:3000:-1], adhesion[:3000:-1])
    assert np.abs(unmatched).max() > 5e-3


@pytest.mark.slow
def test_a_run_is_that_of_a_solver_started_anew_at_every_command():
    loop = loop_of("hxd1f", "SMES, NTSMO, ABLF")
    grid = grid_of("hxd1f", loop, 0.05)
    found = _trace(loop, grid, KEY)
    plant, surface = loop.plant, loop.rails.surface(jnp.asarray(0))
    state = plant.init(plant.gear_ratio * loop.train_speed / plant.radius, loop.train_speed)
    _, whole = ravel_pytree(state)
    # The command that acted after sample k is seen with sample k + 1.
    for command in np.asarray(found.command)[1:]:
        held = Held(jnp.asarray(command), surface, loop.slope)
        state = state._replace(torque=held_by(plant, state.torque, held.command))
        rhs = jax.jit(lambda flat, u=held: ravel_pytree(plant.derivative(whole(flat), u))[0])
        first = np.asarray(ravel_pytree(state)[0])
        solved = solve_ivp(
            lambda _, y, f=rhs: np.asarray(f(jnp.asarray(y))),
            (0.0, 1e-3),
            first,
            method="DOP853",
            rtol=1e-11,
            atol=1e-11,
        )
        state = whole(jnp.asarray(solved.y[:, -1]))
    slip = float(plant.slip_velocity(state)[0])
    assert float(found.sample.slip[-1, 0]) == pytest.approx(slip, abs=1e-9)
    assert float(found.sample.torque[-1, 0]) == pytest.approx(float(state.torque[0]), rel=1e-9)


@pytest.mark.thorough
def test_uyulan_tracks_as_printed():
    loop = loop_of("uyulan2018", "true optimum", "dry-low")
    totals = _run(loop, grid_of("uyulan2018", loop), KEY)
    error = float(figures(whole(totals), 1e-3)["tracking_rms"][0])
    assert error == pytest.approx(0.1874, rel=0.01)
    # At 20 s nothing saturates.
    assert float(totals.segments[2].largest["torque"]) < 1.9e3


def test_hxd1f_seeks_as_its_paper_says():
    loop = loop_of("hxd1f", "SMES, NTSMO, ABLF")
    grid = grid_of("hxd1f", loop)
    found = _figures(loop, grid, KEY)
    np.testing.assert_allclose(found["utilisation"], [0.89, 0.954, 0.93], atol=0.01)
    np.testing.assert_allclose(found["t95"][:2], [0.87, 0.52], atol=0.02)
    assert np.isnan(found["t95"][2])


@pytest.mark.thorough
def test_torque_varies_with_the_sign_and_not_with_a_layer():
    varied = {}
    for name in ("sliding-mode", "sliding-mode-layer", "barrier"):
        loop = loop_of("hxd1f", "SMES, NTSMO, ABLF")
        loop = dataclasses.replace(
            loop, controller=CONTROLLERS[name], observer=OBSERVERS["true-load"]
        )
        grid = grid_of("hxd1f", loop, 3.0)
        varied[name] = _figures(loop, grid, KEY)["torque_variation"][0]
    assert varied["sliding-mode"] > 20 * varied["barrier"]
    assert varied["sliding-mode-layer"] == pytest.approx(varied["barrier"], rel=0.5)


@pytest.mark.parametrize(
    ("lag", "above", "holds"), [(2e-3, 0.10, True), (1e-2, 0.2, False), (1e-2, 0.22, True)]
)
def test_the_interval_of_the_barrier_holds_where_the_lag_lets_it(lag, above, holds):
    plant = dataclasses.replace(plant_of("hxd1f"), torque_lag=jnp.asarray(lag))
    loop = loop_of("hxd1f", "SMES, NTSMO, ABLF")
    barrier = dataclasses.replace(loop.controller, above=above)
    loop = dataclasses.replace(loop, plant=plant, nominal=plant, controller=barrier)
    found = _trace(loop, grid_of("hxd1f", loop, 15.0), KEY).sample
    error = np.asarray(found.slip - found.asked)[1:, 0]
    # The switches themselves are no error of the controller's: v* is where it was.
    assert (error.max() < above) == holds


@pytest.mark.thorough
def test_runs_are_the_same_alone_and_together():
    loop = loop_of("hxd1f", "the same, speed held 1 ms", noisy=True)
    grid = grid_of("hxd1f", loop, 0.5)
    keys = jax.random.split(KEY, 5)
    together = _many(loop, grid, keys)
    alone = _run(loop, grid, keys[3])
    for one, other in zip(together, alone, strict=True):
        for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
            np.testing.assert_allclose(np.asarray(a)[3], b, rtol=1e-6, atol=1e-9)
    assert len(set(np.asarray(together.segments[0].sums["utilised"]))) == 5


@pytest.mark.long
def test_settings_may_differ_without_a_new_compilation():
    loop = loop_of("hxd1f", "SMES, NTSMO, ABLF")
    grid = grid_of("hxd1f", loop, 0.3)
    other = dataclasses.replace(
        loop, controller=dataclasses.replace(loop.controller, gain=40.0, above=0.2)
    )
    _run(loop, grid, KEY)
    before = _run._cache_size()
    _run(other, grid, KEY)
    assert _run._cache_size() == before


def quick(**parts):
    loop = loop_of("hxd1f", "SMES, NTSMO, ABLF")
    return dataclasses.replace(loop, **parts)


@pytest.mark.long
def test_a_driver_can_only_be_lowered_and_dead_time_delays():
    loop = quick(driver=Driver(traction=300.0))
    found = _trace(loop, grid_of("hxd1f", loop, 0.2), KEY)
    assert np.asarray(found.command).max() == 300.0
    late = dataclasses.replace(loop.plant, dead_time=jnp.asarray(0.005))
    loop = dataclasses.replace(loop, plant=late)
    delayed = _trace(loop, grid_of("hxd1f", loop, 0.2), KEY)
    assert np.nonzero(np.asarray(found.command)[:, 0])[0][0] == 1
    assert np.nonzero(np.asarray(delayed.command)[:, 0])[0][0] == 6


def test_sensors_hold_bias_count_and_mistake_the_radius():
    plant = plant_of("hxd1f")
    speeds = (jnp.full(1, 60.0), jnp.asarray(5.5))
    drawn = jnp.asarray([1.0, -1.0])
    sensors = Sensors(SpeedNoise(0.02, 0.005), train_bias=0.1, radius_error=0.01)
    begin = sensors.init(plant, jnp.full(1, 50.0), jnp.asarray(5.0))
    taken = sensors.sample(begin, plant, speeds, jnp.asarray(True), drawn)
    assert float(taken.motor_speed[0]) == pytest.approx(60.02)
    assert float(taken.train_speed) == pytest.approx(5.595)
    rim = 1.01 * float(plant.radius[0] / plant.gear_ratio) * 60.02
    assert float(taken.slip[0]) == pytest.approx(rim - 5.595)
    kept = sensors.sample(begin, plant, speeds, jnp.asarray(False), drawn)
    assert kept.motor_speed.tolist() == begin.motor_speed.tolist()

    # 100 pulses a turn: at 60 rad/s one every 1.05 ms, which the second of two samples has passed.
    counting = Sensors(period=1e-2, pulses=100)

    def step(state, number):
        state = counting.sample(state, plant, speeds, number % 10 == 0, drawn)
        return counting.turn(state, speeds[0], 1e-3), state.motor_speed[0]

    first = counting.init(plant, jnp.full(1, 50.0), speeds[1])
    told = jax.lax.scan(step, first, jnp.arange(40))[1]
    np.testing.assert_allclose(told, np.repeat([50.0, 60.0], [10, 30]), rtol=1e-12)


def test_what_cannot_be_run_is_refused_in_a_sentence():
    loop = quick()
    limit, by = largest_step(loop)
    assert limit == pytest.approx(2e-4)
    assert "observer" in by
    with pytest.raises(InputError, match=r"--step 0\.001 s is not possible: the observer"):
        timing(loop, 1e-3, 1e-3, 1.0)
    plain = quick(observer=OBSERVERS["full-dimension"])
    with pytest.raises(InputError, match="the plant, which is integrated by RK4, allows at most"):
        timing(plain, 6e-3, 6e-3, 6.0)
    with pytest.raises(InputError, match=r"the control period of 0\.001 s is no whole number"):
        timing(plain, 3e-4, 1e-3, 1.0)
    with pytest.raises(InputError, match="neither divides nor is a multiple"):
        timing(quick(sensors=Sensors(period=3e-4)), 1e-4, 1e-3, 1.0)
    with pytest.raises(InputError, match="which is no multiple of the step"):
        by_time([*hxd1f.SURFACES.values()], [0.0, 5.00005, 10.0], 1e-4)
    with pytest.raises(InputError, match="follows a slip and has no seeker"):
        check(quick(seeker=None))
    with pytest.raises(InputError, match="so it takes no seeker"):
        check(quick(controller=CONTROLLERS["none"]))


_FOLLOWERS = [name for name, one in CONTROLLERS.items() if one.FOLLOWS]
_LAWS = [name for name, one in CONTROLLERS.items() if not one.FOLLOWS]


def combinations():
    """Of all that accept each other as few as let every part meet every other; plants by turns.

    Every observer meets every seeker and every controller that follows one, these each other, and
    each whole law one observer at least.
    """
    covering = set()
    for i, observer in enumerate(OBSERVERS):
        for j, controller in enumerate(_FOLLOWERS):
            covering.add((observer, [*SEEKERS][(i + j) % len(SEEKERS)], controller))
        covering.add((observer, None, _LAWS[i % len(_LAWS)]))
    followed = itertools.product(OBSERVERS, SEEKERS, _FOLLOWERS)
    alone = itertools.product(OBSERVERS, [None], _LAWS)
    numbered = enumerate([*followed, *alone])
    return [(*triple, [*SYSTEMS][n % len(SYSTEMS)]) for n, triple in numbered if triple in covering]


@pytest.mark.parametrize(
    ("observer", "seeker", "controller", "name"),
    lanes(combinations(), always=0, long=1, thorough=1),
)
def test_all_that_accept_each_other_run(observer, seeker, controller, name):
    system = SYSTEMS[name]
    case = system.cases(2e-4)[0]._replace(
        observer=OBSERVERS[observer],
        seeker=None if seeker is None else SEEKERS[seeker],
        controller=CONTROLLERS[controller],
        sampled=1e-3,
    )
    loop = built(system, case, plant_of(system.plant), noisy=True)
    loop = dataclasses.replace(loop, train_speed=jnp.maximum(loop.train_speed, 2.0))
    check(loop)
    grid = timing(loop, 2e-4, 1e-3, 1.0)
    keys = jax.random.split(KEY, 2)
    totals = _many(loop, grid, keys)
    found = by_segment(totals)
    seen = found.sums["samples"] > 0
    assert float(found.sums["samples"].sum()) == 2 * grid.samples
    rigid = type(loop.plant) is RigidAxles
    for number, values in (pair for part in found for pair in part.items()):
        if rigid and number in ("shaft", "static_shaft"):  # no axle twists
            assert bool(jnp.all(jnp.isnan(values) | ~seen)), number
        else:
            finite = jnp.isfinite(values) | (number == "reached")
            assert bool(jnp.all(finite | ~seen)), number
    assert float(found.largest["torque"].max()) <= float(loop.plant.torque_limit) * (1 + 1e-12)
    # The programs differ in the last digits, which sliding modes and chattering amplify.
    alone = _figures(loop, grid, keys[1])
    among = figures(jax.tree.map(lambda x: x[:, 1], found), grid.sample_period)
    for figure in ("utilisation", "slip_energy", "torque_largest", "adhesion_rms"):
        np.testing.assert_allclose(
            alone[figure], among[figure], rtol=0.02, atol=1e-6, err_msg=figure
        )


@pytest.mark.long
def test_eight_axles_that_are_alike_move_as_one():
    one, eight = plant_of("hxd1f"), plant_of("hxd1f_axles")
    system = SYSTEMS["hxd1f"]
    case = system.cases(system.step)[-1]
    alike = dataclasses.replace(eight, load_transfer=jnp.zeros(8))
    grid = grid_of("hxd1f", built(system, case, one), 1.0)
    single, all_alike = (_figures(built(system, case, plant), grid, KEY) for plant in (one, alike))
    for name in ("utilisation", "slip_energy", "torque_largest", "tracking_rms"):
        np.testing.assert_allclose(all_alike[name][0], single[name][0], rtol=1e-6)


def test_the_leading_axles_lose_what_the_last_gain():
    plant = plant_of("hxd1f_axles")
    state = plant.init(plant.gear_ratio * (5.0 + 0.2) / plant.radius, jnp.asarray(5.0))
    held = Held(jnp.zeros(8), hxd1f.SURFACES["dry"], jnp.asarray(0.0))
    force = np.asarray(plant.force(state, held)) / 0.36
    # Q_j = W g - t_j F with F = .36 sum Q over the unit, solved as linear equations.
    transfer = np.asarray(plant.load_transfer)[:4]
    loads = np.linalg.solve(
        np.eye(4) + 0.36 * np.outer(transfer, np.ones(4)), np.full(4, 30000 * 9.81)
    )
    np.testing.assert_allclose(force, np.tile(loads, 2), rtol=1e-4)
    assert loads[0] < loads[3]
    assert loads.sum() == pytest.approx(4 * 30000 * 9.81, rel=1e-9)


def test_the_lyapunov_function_starts_at_its_value():
    # kappa = r (2 W g mu r (1/J_W + 1/J_dyn) + r R_0/J_dyn) = 2.04, lam = r i/J_W = 1.227e-3.
    plant, controller = plant_of("uyulan2018"), CONTROLLERS["adaptive-robust"]
    error, largest = jnp.full((1, 1), 15.5 - 10.5 - 1.20986), jnp.full((1, 1), 0.28617)
    found = uyulan2018.lyapunov(controller, plant, jnp.zeros((1, 1)), error, largest)
    inertia, of_train, lever = 1748.26, 81357.19 * 0.31**2, 0.31 * 6.92 / 1748.26
    pull = 2 * 5375.333 * 9.81 * 0.28617 * 0.31
    kappa = 0.31 * (pull * (1 / inertia + 1 / of_train) + 0.31 * 1109.8 / of_train)
    assert kappa == pytest.approx(2.04, abs=0.01)
    expected = 3.79014**2 / 2 + kappa**2 / (2 * 19 * lever)
    assert float(found[0, 0]) == pytest.approx(expected, rel=1e-4)
    # The adapted gain that meets kappa leaves the error alone.
    met = uyulan2018.lyapunov(controller, plant, jnp.full((1, 1), kappa / lever), error, largest)
    assert float(met[0, 0]) == pytest.approx(3.79014**2 / 2, rel=1e-3)


@pytest.mark.long
def test_tunings_are_a_vmap_over_their_settings():
    gains = jnp.array([10.0, 20.0, 40.0])
    loop = quick(observer=OBSERVERS["true-load"], seeker=SEEKERS["true-optimum"])
    grid = grid_of("hxd1f", loop, 0.2)

    def error_of(gain):
        tuned = dataclasses.replace(
            loop, controller=dataclasses.replace(loop.controller, gain=gain)
        )
        return figures(by_segment(run(tuned, grid, KEY)), grid.sample_period)["tracking_rms"][0]

    errors = jax.jit(jax.vmap(error_of))(gains)
    assert errors[0] > errors[1] > errors[2]
