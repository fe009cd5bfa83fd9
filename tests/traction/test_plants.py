"""Plants against closed forms, the balance of energy and a solver of high order."""

import re
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from energy import energy, powers
from jax.flatten_util import ravel_pytree
from scipy.integrate import solve_ivp

from adhesion_jax.curves import Exponential, Polach
from adhesion_jax.errors import InputError
from adhesion_jax.traction.integration import RK4_STABLE, jacobian, rk4
from adhesion_jax.traction.plants.base import Held, held_by, limited
from adhesion_jax.traction.plants.reading import TAGS, read_plant, shipped
from adhesion_jax.traction.surface import RailSurface

DRY = RailSurface(Exponential(3.2666, 7.2592, 1.2580))
WET = RailSurface(Exponential(8.1666, 18.1479, 0.6989))
SNOW = RailSurface(Exponential(13.0665, 29.0366, 0.3494))

#: Per plant: speed of the train in m/s, slip velocity in m/s at first, torques in N m by turns.
STARTS = {
    "uyulan2018": (10.5, 0.3, (1500.0, -1200.0, 400.0)),
    "fang2018": (15.0, 0.02, (900.0, -700.0, 300.0)),
    "hxd1f": (5.0, 0.02, (9000.0, -6000.0, 2000.0)),
    "hxd1f_twist": (5.0, 0.02, (9000.0, -6000.0, 2000.0)),
}


def plant_of(name):
    return read_plant(shipped()[name]).plant


def started(name):
    plant = plant_of(name)
    speed, slip, torques = STARTS[name]
    radius = getattr(plant, "wheel_radius", None)
    radius = plant.radius_right if radius is None else radius
    motor = plant.gear_ratio * (speed + slip) / radius
    return plant, plant.init(motor, jnp.asarray(speed)), torques


def held(command, surface=DRY, slope=0.01):
    return Held(jnp.full(1, command), surface, jnp.asarray(slope))


def run(plant, state, command, step, seconds):
    """The state after a command was held, and the energy that went each way meanwhile."""
    return steps_of(plant, state, held(command), step, round(seconds / step))


@jax.jit
def steps_of(plant, state, inputs, step, count):
    state = state._replace(torque=held_by(plant, state.torque, inputs.command))

    def derivative(both):
        state, _ = both
        return plant.derivative(state, inputs), powers(plant, state, inputs)

    spent = jax.tree.map(jnp.zeros_like, powers(plant, state, inputs))

    def body(_, both):
        return rk4(derivative, both, step)

    return jax.lax.fori_loop(0, count, body, (state, spent))


@pytest.mark.thorough
@pytest.mark.parametrize("name", STARTS)
def test_energy_is_kept(name):
    plant, state, torques = started(name)
    for torque in torques:
        before = float(energy(plant, state))
        state, spent = run(plant, state, torque, 1e-4, 1.0)
        gained = float(energy(plant, state)) - before
        balance = float(spent.motor - sum(spent[1:]))
        size = max(abs(float(one)) for one in spent)
        assert gained == pytest.approx(balance, abs=1e-6 * size)


@pytest.mark.parametrize("efficiency", [0.9, 1.0])
@pytest.mark.parametrize("name", STARTS)
def test_a_gear_only_takes(name, efficiency):
    plant, state, _ = started(name)
    plant = type(plant)(**{**vars(plant), "gear_efficiency": jnp.asarray(efficiency)})

    @jax.jit
    @jax.vmap
    def spent(torque, slip):
        moving = state._replace(train_speed=state.train_speed - slip, torque=torque[None])
        return powers(plant, moving, held(torque))

    torques = jnp.array([-3000.0, -300.0, 0.0, 300.0, 3000.0])
    found = spent(jnp.repeat(torques, 3), jnp.tile(jnp.array([-0.2, 0.0, 0.2]), 5))
    rounding = 1e-12 * max(np.abs(found.motor))
    assert min(found.gear) >= -rounding
    assert (max(found.gear) > rounding) == (efficiency < 1)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.long if "twist" in name else ()) for name in STARTS],
)
def test_a_trajectory_is_that_of_a_solver_of_order_eight(name):
    plant, state, torques = started(name)
    _, whole = ravel_pytree(state)

    @jax.jit
    def rhs(flat, inputs):
        return ravel_pytree(plant.derivative(whole(flat), inputs))[0]

    for torque in torques:
        inputs = held(torque)
        state = state._replace(torque=held_by(plant, state.torque, inputs.command))
        exact = solve_ivp(
            lambda _, y, u=inputs: np.asarray(rhs(jnp.asarray(y), u)),
            (0.0, 0.3),
            np.asarray(ravel_pytree(state)[0]),
            method="DOP853",
            rtol=1e-12,
            atol=1e-12,
        ).y[:, -1]
        state, _ = run(plant, state, torque, 1e-4, 0.3)
        np.testing.assert_allclose(ravel_pytree(state)[0], exact, rtol=1e-9, atol=1e-9)


@pytest.mark.thorough
@pytest.mark.parametrize("name", STARTS)
def test_halving_the_step_lowers_the_error_sixteenfold(name):
    plant, state, (torque, *_) = started(name)

    def at_end(step):
        return np.asarray(ravel_pytree(run(plant, state, torque, step, 0.016)[0])[0])

    # With the lag of the torque in the state, where a plant has one.
    exact = at_end(2.5e-5)
    coarse, fine = at_end(8e-4) - exact, at_end(4e-4) - exact
    assert np.linalg.norm(fine) > 1e-12 * np.linalg.norm(exact)
    assert np.linalg.norm(coarse) / np.linalg.norm(fine) == pytest.approx(16.0, rel=0.15)


def test_the_axle_of_uyulan_swings_as_two_inertias_on_a_spring():
    plant, state, _ = started("uyulan2018")
    free = RailSurface(Exponential(1.0, 2.0, 0.0))
    rates = jax.jit(partial(jacobian, lambda state: plant.derivative(state, held(0.0, free))))
    found = np.linalg.eigvals(rates(state))
    swing = found[np.argmax(found.imag)]
    # J1 = 1508.26, J2 = 240: sqrt(K/J) = 171.1 rad/s, B/(2 sqrt(K J)) = .7056.
    assert abs(swing) == pytest.approx(171.1, abs=0.1)
    assert -swing.real / abs(swing) == pytest.approx(0.7056, abs=1e-4)


def test_the_dynamic_mass_of_uyulan_follows_from_what_is_printed():
    plant = plant_of("uyulan2018")
    driven = 0.98 * plant.gear_ratio**2 * plant.axles_alike * plant.motor_inertia
    turning = (driven + 4 * plant.wheel_inertia) / plant.radius_right[0] ** 2
    expected = float(plant.static_mass + turning)
    assert float(plant.dynamic_mass) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize(("surface", "rate"), [(DRY, 430.0), (WET, 597.0), (SNOW, 477.0)])
def test_the_fastest_rate_of_hxd1f_is_that_of_its_creep(surface, rate):
    plant = plant_of("hxd1f")
    speed = jnp.asarray(5.0)
    rolling = plant.init(plant.gear_ratio * (speed + 1e-9) / plant.wheel_radius, speed)

    def derivative(state):
        # Friction of the gear has a kink at rest, which is no rate: driven as in traction.
        return plant.derivative(state._replace(torque=jnp.full(1, 100.0)), held(100.0, surface))

    # mu'(0) W g (r^2/(i^2 J eta) + n/M), J = 25 + 400/(i^2 .975).
    law = surface.law
    ratio, inertia = float(plant.gear_ratio) ** 2, 25 + 400 / (106 / 17) ** 2 / 0.975
    creep = 0.625**2 / (ratio * inertia * 0.975) + 8 / 1e7
    exact = law.c * (law.b - law.a) * 30000 * 9.81 * creep
    rates = jax.jit(partial(jacobian, derivative))
    found = np.max(-np.linalg.eigvals(rates(rolling)).real)
    assert found == pytest.approx(exact, rel=1e-6)
    assert found == pytest.approx(rate, abs=1.0)
    step = RK4_STABLE / found

    @jax.jit
    def at_last(share):
        """The slip velocity after many steps of this share of the limit."""
        state = jax.lax.fori_loop(
            0, 400, lambda _, state: rk4(derivative, state, share * step), rolling
        )
        return plant.slip_velocity(state)[0]

    # Beyond the limit the steps leave the equilibrium, for a fixed point that is none of the plant.
    beyond, below, far_below = (float(at_last(share)) for share in (1.1, 0.9, 0.2))
    assert below == pytest.approx(far_below, rel=0.01)
    assert abs(beyond - far_below) > far_below


def test_the_limit_of_rk4_is_where_its_polynomial_has_the_size_one():
    """|1 + z + z^2/2 + z^3/6 + z^4/24| = 1 on the negative real axis (Hairer and Wanner 1996)."""
    roots = np.roots([1 / 24, 1 / 6, 1 / 2, 1, 0])
    (limit,) = -roots.real[(np.abs(roots.imag) < 1e-9) & (roots.real < -1)]
    assert pytest.approx(limit, rel=1e-3) == RK4_STABLE
    moved = [float(rk4(lambda x: -x, jnp.ones(()), share * limit)) for share in (0.999, 1.001)]
    assert moved[0] < 1 < moved[1]


def test_eight_axles_of_thirty_tonnes_pull_by_their_weight():
    found = plant_of("hxd1f").pull(jnp.full(1, 0.3))
    assert float(found) == pytest.approx(0.3 * 8 * 30e3 * 9.81, rel=1e-9)


def test_torque_is_limited_by_torque_and_by_power():
    plant = plant_of("hxd1f")
    slow, fast = jnp.full(1, 10.0), jnp.full(1, 400.0)
    assert float(limited(plant, jnp.full(1, 2e4), slow)[0]) == 13000.0
    assert float(limited(plant, jnp.full(1, -2e4), fast)[0]) == pytest.approx(-3000.0)
    assert float(limited(plant, jnp.full(1, 500.0), fast)[0]) == 500.0


def test_resistance_opposes_motion_and_vanishes_at_rest():
    for name in STARTS:
        plant, state, _ = started(name)
        forces = []
        for speed in (-5.0, -0.005, 0.0, 0.005, 5.0):
            moving = state._replace(train_speed=jnp.asarray(speed))
            forces.append(float(powers(plant, moving, held(0.0)).resistance))
        assert forces[2] == 0.0
        assert all(force > 0 for place, force in enumerate(forces) if place != 2)
        assert forces == pytest.approx(forces[::-1])


def test_a_law_in_slip_ratio_is_asked_at_the_ratio():
    law = Polach(0.3, 90.0)
    surface = RailSurface(law, in_ratio=True)
    slip = jnp.asarray([0.1, -0.2])
    for speed, per in ((5.0, 5.0), (0.1, 0.5), (-5.0, 5.0)):
        np.testing.assert_allclose(surface(slip, jnp.asarray(speed)), law(slip / per, {}))


TEXT = shipped()["hxd1f"].read_text()


def test_a_plant_of_ones_own_is_read_from_its_file(tmp_path):
    path = tmp_path / "heavier.toml"
    path.write_text(TEXT.replace("30000.0", "[25000.0, 25000.0]"))
    plant = read_plant(path).plant
    assert plant.axle_load.tolist() == [25000.0, 25000.0]
    assert plant.wheel_radius.tolist() == [0.625, 0.625]
    assert {given.tag for given in read_plant(path).given.values()} <= {*TAGS}


def test_a_plant_may_be_like_one_that_ships(tmp_path):
    path = tmp_path / "light.toml"
    path.write_text('like = "hxd1f"\n[parameters.axle_load]\nvalue = 25000.0\nunit = "kg"\n')
    found, base = read_plant(path), read_plant(shipped()["hxd1f"])
    assert found.plant.axle_load.tolist() == [25000.0]
    assert found.given["axle_load"].source == ""
    assert {**found.given, "axle_load": None} == {**base.given, "axle_load": None}
    path.write_text('like = "hxd1f"\n[parameters.axle_load]\nvalue = 25\nunit = "t"\n')
    assert read_plant(path).given["axle_load"] == found.given["axle_load"]
    for other in ('["hxd1f"]', "{a = 1}", "1"):
        path.write_text(f"like = {other}\n")
        with pytest.raises(InputError, match=r"like .* is not known"):
            read_plant(path)
    path.write_text('like = "hxd2"\n')
    with pytest.raises(InputError, match=r"like 'hxd2' is not known; name fang2018 or"):
        read_plant(path)
    path.write_text('like = "hxd1f"\nmodel = "elastic-axles"\n')
    with pytest.raises(InputError, match="parameter wheel_radius is not known; did you mean"):
        read_plant(path)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("gear_ratio]", "gear_ration]", "gear_ration is not known; did you mean gear_ratio"),
        (
            'unit = "m"',
            'unit = "kg"',
            "wheel_radius is given in 'kg', which is no unit",
        ),
        ('unit = "m"', 'unit = "km"', "wheel_radius is 0.625 km; it must be a number from"),
        ('model = "rigid-axles"\n', "", "tells no train; name one that it is like"),
        ("value = 10000000.0", "value = -1.0", "train_mass is -1.0 kg; it must be a number from 1"),
        ("value = 10000000.0", 'value = "10 t"', "train_mass is '10 t' kg; it must be a number"),
        ("value = 10000000.0", "value = nan", "train_mass is nan kg; it must be a number"),
        ("value = 10000000.0", "value = [1e7, 1e7]", "train_mass has 2 values; give one value"),
        ("value = 30000.0", "value = []", "axle_load has no value"),
        ("value = 30000.0", "mass = 30000.0", "axle_load needs a value and a unit"),
        ('tag = "P"', 'tag = "X"', "axle_load has the tag X"),
        ('model = "rigid-axles"', 'model = "monorail"', "the model 'monorail' is not known"),
        (
            'title = "',
            'name = "',
            "name is not known; a plant has model or like, title and parameters",
        ),
        ("[parameters.train_mass]", "[parameters.train_mass", "is no TOML file"),
    ],
)
def test_a_bad_file_is_refused_in_a_sentence(old, new, said, tmp_path):
    path = tmp_path / "bad.toml"
    assert old in TEXT
    path.write_text(TEXT.replace(old, new, 1))
    with pytest.raises(InputError, match=rf"bad\.toml.*{re.escape(said)}[^\n]*\.$"):
        read_plant(path)


def test_what_is_lacking_is_named(tmp_path):
    path = tmp_path / "short.toml"
    path.write_text('model = "rigid-axles"\n[parameters]\n')
    with pytest.raises(InputError, match=r"lacks the parameter wheel_radius .*the unit m\.$"):
        read_plant(path)
    with pytest.raises(InputError, match="cannot be read"):
        read_plant(tmp_path / "none.toml")
