"""Axles that twist: the mode in closed form, its energy, the stiff limit, and where it chatters."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from energy import energy, powers
from scipy.optimize import brentq

from adhesion_jax.errors import InputError
from adhesion_jax.metrics.closed_loop import figures, whole
from adhesion_jax.traction.entrants import sought
from adhesion_jax.traction.integration import RK4_STABLE, jacobian, rk4
from adhesion_jax.traction.loop import Loop, run, timing
from adhesion_jax.traction.plants.base import Held, held_by
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.plants.rigid_axles import RigidAxles
from adhesion_jax.traction.rails import by_time
from adhesion_jax.traction.seekers.given import ConstantSlip
from adhesion_jax.traction.sensors import Sensors
from adhesion_jax.traction.surface import BothSides, RailSurface, Scaled, exponential
from adhesion_jax.traction.systems import SYSTEMS

#: v* = .2 m/s, mu_max = .36.
DRY = exponential(3.2666, 7.2592, 1.2580)
FREE = exponential(1.0, 2.0, 0.0)

SHIPPED = read_plant(shipped()["hxd1f_twist"]).plant
RIGID = read_plant(shipped()["hxd1f"]).plant

#: Inertias in kg m^2 at the wheel: the far wheel, and the rest with the motor.
FAR, REST = 110.0, 290.0 + (106 / 17) ** 2 * 25.0


def twisting(**numbers):
    given = {name: jnp.asarray(number) for name, number in numbers.items()}
    return dataclasses.replace(SHIPPED, **given)


def at_slip(plant, slip, speed=5.0, torque=100.0):
    motor = plant.gear_ratio * (speed + slip) / plant.radius
    state = plant.init(motor, jnp.asarray(speed))
    return state._replace(torque=jnp.full(1, torque))


@jax.jit
def rates_at(plant, surface, slip):
    inputs = Held(jnp.full(1, 100.0), surface, jnp.asarray(0.0))
    return jacobian(lambda state: plant.derivative(state, inputs), at_slip(plant, slip))


def mode(plant, surface, slip):
    """The eigenvalue in 1/s of the swinging wheelset at this slip of both wheels."""
    found = np.linalg.eigvals(rates_at(plant, surface, slip))
    return found[np.argmax(found.imag)]


@pytest.mark.parametrize("frequency", [30.0, 45.0, 70.0])
@pytest.mark.parametrize("damping", [0.005, 0.01, 0.02])
def test_the_free_wheelset_swings_as_it_is_told(frequency, damping):
    plant = twisting(twist_frequency=frequency, twist_damping=damping, gear_efficiency=1.0)
    found = mode(plant, FREE, 1e-6)
    assert abs(found) == pytest.approx(2 * np.pi * frequency, rel=1e-6)
    assert -found.real / abs(found) == pytest.approx(damping, rel=1e-6)
    # The loss of the gear lightens the motor: both move by less than .1 %.
    lossy = mode(dataclasses.replace(plant, gear_efficiency=jnp.asarray(0.975)), FREE, 1e-6)
    assert abs(lossy) == pytest.approx(2 * np.pi * frequency, rel=1e-3)
    assert -lossy.real / abs(lossy) == pytest.approx(damping, rel=1e-3)
    assert lossy != found


@pytest.mark.parametrize("damping", [0.005, 0.01, 0.02])
def test_chatter_begins_where_the_contact_gives_more_than_the_steel_takes(damping):
    plant = twisting(twist_damping=damping, gear_efficiency=1.0)
    slope = jax.jit(jax.grad(lambda slip: DRY(slip, jnp.asarray(5.0))))
    steel = 4 * np.pi * 45.0 * damping * FAR * REST / (FAR + REST)

    def contact(slip):
        """mu' N r^2/2 of each wheel, N m s."""
        return float(slope(slip)) * 30000 * 9.81 * 0.625**2 / 2

    onset = brentq(lambda slip: mode(plant, DRY, slip).real, 0.19, 0.3)
    # In the mode the wheels turn as 1 to -FAR/REST: the damping that each sees is
    # D (1 + FAR/REST)^2 + mu' N r^2/2 (1 + (FAR/REST)^2) = 0, which is nearly D + mu' N r^2/2 = 0.
    share = FAR / REST
    exact = brentq(
        lambda slip: steel * (1 + share) ** 2 + contact(slip) * (1 + share**2), 0.19, 0.3
    )
    nearly = brentq(lambda slip: steel + contact(slip), 0.19, 0.3)
    assert onset - 0.2 == pytest.approx(exact - 0.2, rel=0.03)
    assert onset - 0.2 == pytest.approx(nearly - 0.2, rel=0.2)
    assert mode(plant, DRY, 1.1 * 0.2).real > 0 > mode(plant, DRY, 0.2).real
    assert contact(0.22) == pytest.approx(-9e3, rel=0.05)


@jax.jit
def spent(plant, state, surface, command, step, count):
    """The state after a command was held for some steps, and where the energy went meanwhile."""
    inputs = Held(command, surface, jnp.asarray(0.01))
    state = state._replace(torque=held_by(plant, state.torque, command))

    def derivative(both):
        return plant.derivative(both[0], inputs), powers(plant, both[0], inputs)

    none = jax.tree.map(jnp.zeros_like, powers(plant, state, inputs))
    return jax.lax.fori_loop(0, count, lambda _, both: rk4(derivative, both, step), (state, none))


@pytest.mark.long
@pytest.mark.parametrize("backlash", [0.0, 1e-3])
def test_energy_is_kept_with_twist_and_play(backlash):
    plant = twisting(backlash=backlash)
    state, within = at_slip(plant, 0.22, torque=0.0), []
    for torque in (11000.0, -9000.0, 500.0, -500.0, 500.0):
        before = float(energy(plant, state))
        state, lost = spent(plant, state, DRY, jnp.full(1, torque), 5e-5, 4000)
        gained = float(energy(plant, state)) - before
        size = max(abs(float(one)) for one in lost)
        assert gained == pytest.approx(float(lost.motor - sum(lost[1:])), abs=1e-6 * size)
        assert float(lost.shaft) > 0
        within.append(float(plant.shaft_torque(state)[0]))
    assert min(within) < 0 < max(within)  # the play was crossed


def test_the_torque_of_the_shaft_has_no_jump_at_the_end_of_its_play():
    plant = twisting(backlash=1e-3)
    state = at_slip(plant, 0.1)
    twists = np.array([-6e-4, -5e-4 - 1e-12, -5e-4, 0.0, 5e-4, 5e-4 + 1e-12, 6e-4])
    torques = [
        float(plant.shaft_torque(state._replace(twist=jnp.full(1, twist)))[0]) for twist in twists
    ]
    stiffness = (2 * np.pi * 45.0) ** 2 * FAR * REST / (FAR + REST)
    np.testing.assert_allclose(
        torques, stiffness * np.array([-1e-4, 0, 0, 0, 0, 0, 1e-4]), rtol=1e-9, atol=1e-4
    )


def by_hand(speeds, twist, torque, backlash):
    """Accelerations of near wheel, far wheel and train, from the free bodies."""
    near, far, train = speeds
    ratio, eta, radius, weight = 106 / 17, 0.975, 0.625, 30000 * 9.81

    def pull(slip):
        size = abs(slip)
        mu = 1.2580 * (np.exp(-3.2666 * size) - np.exp(-7.2592 * size))
        return np.sign(slip) * mu * weight / 2

    swinging = FAR * REST / (FAR + REST)
    sprung = np.sign(twist) * max(abs(twist) - backlash / 2, 0.0)
    shaft = (2 * np.pi * 45) ** 2 * swinging * sprung
    shaft += 2 * 0.01 * 2 * np.pi * 45 * swinging * (near - far)
    forces = [pull(radius * wheel - train) for wheel in (near, far)]
    found = []
    for loss in (eta, 1 / eta):
        inertia = 290.0 + ratio**2 * loss * 25.0
        angular = (ratio * loss * torque - shaft - radius * forces[0]) / inertia
        handed = 290.0 * angular + shaft + radius * forces[0]
        if (handed * near >= 0) == (loss < 1):
            found.append(angular)
    kmh = 3.6 * train
    resistance = 1e7 * 9.81e-3 * (0.92 + 0.0048 * kmh + 0.000125 * kmh**2)
    (angular,) = found
    far_angular = (shaft - radius * forces[1]) / FAR
    return angular, far_angular, (8 * sum(forces) - resistance) / 1e7


@pytest.mark.parametrize("backlash", [0.0, 1e-3])
def test_the_equations_are_those_of_the_free_bodies(backlash):
    plant, random, ratio = twisting(backlash=backlash), np.random.default_rng(0), 106 / 17

    @jax.jit
    def derivative(near, far, train, twist, torque):
        moving = plant.init(ratio * near, train[0])
        state = moving._replace(twist=twist, twist_rate=near - far, torque=torque)
        return plant.derivative(state, Held(torque, DRY, jnp.asarray(0.0)))

    for _ in range(50):
        near = random.uniform(7, 12)
        far, train = near - random.normal(0, 0.2), 0.625 * near - random.normal(0, 0.2)
        twist, torque = random.normal(0, 2e-3), random.uniform(-9e3, 13e3)
        rates = derivative(*(np.full(1, one) for one in (near, far, train, twist, torque)))
        angular = rates.motor_speed[0] / ratio
        np.testing.assert_allclose(
            [angular, angular - rates.twist_rate[0], rates.train_speed],
            by_hand((near, far, train), twist, torque, backlash),
            rtol=1e-9,
        )
        assert float(rates.twist[0]) == pytest.approx(near - far, rel=1e-12)


@pytest.mark.parametrize("name", ["hxd1f_twist", "uyulan2018"])
def test_each_wheel_is_held_by_its_own_rail(name):
    plant, share, slip = read_plant(shipped()[name]).plant, 0.3, 0.12
    speed = jnp.asarray(5.0)
    peak = DRY.peak(speed)
    largest = peak._replace(adhesion=(1 + share) / 2 * peak.adhesion)
    law = BothSides(largest, DRY.law, Scaled(DRY.law, share))
    split = Held(jnp.zeros(1), RailSurface(law), jnp.asarray(0.0))
    alike = split._replace(surface=DRY)
    state = plant.init(plant.gear_ratio * (5.0 + slip) / plant.radius, speed)
    right, left = plant.force(state, split)
    both = plant.force(state, alike)[0]
    np.testing.assert_allclose([right, left], [both, share * both], rtol=1e-12)
    adhesion = float(plant.adhesion(state, split)[0])
    assert adhesion == pytest.approx((1 + share) / 2 * float(DRY(jnp.asarray(slip), speed)))
    assert float(plant.pull(plant.adhesion(state, split))) == pytest.approx(
        float(plant.axles_alike * (right + left)[0]), rel=1e-12
    )
    # Steadily the shaft carries what the left rail takes of the left wheel.
    static = plant.static_shaft_torque(jnp.full(1, slip), speed, split)
    assert float(static[0]) == pytest.approx(float(plant.radius[0] * left[0]), rel=1e-12)


def test_a_stiff_axle_is_a_rigid_one_to_the_order_of_its_compliance():
    def at_end(plant):
        state, _ = spent(plant, at_slip(plant, 0.02), DRY, jnp.full(1, 6000.0), 1e-5, 6000)
        return np.array([float(state.motor_speed[0]), float(state.train_speed)])

    rigid = at_end(RIGID)
    apart = [
        np.abs(at_end(twisting(twist_frequency=f, twist_damping=0.7)) - rigid)
        for f in (200.0, 400.0, 800.0)
    ]
    # Twice the frequency is four times the stiffness.
    np.testing.assert_allclose(apart[0] / apart[1], 4.0, rtol=0.1)
    np.testing.assert_allclose(apart[1] / apart[2], 4.0, rtol=0.05)


def loop_at(plant, share):
    """A constant share of the best slip, without noise; control takes the axle for rigid."""
    system, entrant = SYSTEMS["hxd1f"], sought(ConstantSlip(slip=0.2 * share))
    return Loop(
        plant=plant,
        nominal=RIGID,
        rails=by_time([DRY], [0.0], 1e-4),
        driver=system.driver,
        sensors=Sensors(period=1e-3),
        observer=entrant.observer,
        seeker=entrant.seeker,
        controller=entrant.controller,
        train_speed=jnp.asarray(5.0),
        slip=jnp.zeros(1),
        slope=jnp.asarray(0.0),
    )


@partial(jax.jit, static_argnums=1)
def of_whole(loop, grid):
    return figures(whole(run(loop, grid, jax.random.key(0))), grid.sample_period)


def ran(plant, share):
    loop = loop_at(plant, share)
    found = of_whole(loop, timing(loop, 1e-4, 1e-3, 3.0))
    return {name: float(x[0]) for name, x in found.items()}


@pytest.mark.long
def test_where_nothing_swings_a_twisting_axle_runs_as_a_rigid_one():
    rigid, twists = ran(RIGID, 0.7), ran(SHIPPED, 0.7)
    for name in ("utilisation_settled", "slip_settled", "torque_largest"):
        assert twists[name] == pytest.approx(rigid[name], rel=2e-3), name
    assert np.isnan(rigid["axle_torque_over_static"])
    # mu(.7 v*)/mu_max, and no more.
    share = float(DRY(jnp.asarray(0.14), jnp.asarray(5.0))) / 0.36
    assert twists["axle_torque_over_static"] == pytest.approx(share, rel=0.02)


@pytest.mark.long
def test_beyond_the_peak_it_chatters():
    assert ran(SHIPPED, 1.2)["axle_torque_over_static"] > 1.2
    assert ran(SHIPPED, 0.9)["axle_torque_over_static"] < 1.05


def test_too_long_a_step_is_refused():
    # The creep of the far wheel, mu'(0) N r^2/(2 J) = 2624 1/s, less what the near one yields.
    limit = RK4_STABLE / 2602
    loop = dataclasses.replace(loop_at(SHIPPED, 0.5), sensors=Sensors())
    assert timing(loop, 0.99 * limit, 0.99 * limit, 9.9 * limit)
    with pytest.raises(InputError, match=r"the plant, which is integrated by RK4, allows at most"):
        timing(loop, 1.01 * limit, 1.01 * limit, 10.1 * limit)


def test_a_plant_of_another_model_gives_what_is_lacking(tmp_path):
    path = tmp_path / "twist.toml"
    path.write_text('like = "hxd1f"\nmodel = "twisting-axles"\n')
    with pytest.raises(InputError, match="lacks the parameter far_inertia_share"):
        read_plant(path)
    path.write_text('like = "hxd1f_twist"\nmodel = "rigid-axles"\n')
    with pytest.raises(InputError, match="far_inertia_share is not known"):
        read_plant(path)
    path.write_text(
        'like = "hxd1f_twist"\n[parameters.twist_frequency]\nvalue = 70.0\nunit = "Hz"\n'
    )
    assert float(read_plant(path).plant.twist_frequency) == 70.0
    assert isinstance(read_plant(path).plant, RigidAxles)
