"""The loops of Fang et al. 2018 in both units of K1, and at settings drawn from ranges."""

import jax.numpy as jnp

from adhesion_jax.traction.controllers import Controller
from adhesion_jax.traction.controllers.readhesion import Threshold
from adhesion_jax.traction.controllers.torque_feedback import RateFeedback, SlopeFeedback
from adhesion_jax.traction.loop import Loop
from adhesion_jax.traction.observers.full_dimension import FullDimension
from adhesion_jax.traction.plants.base import GRAVITY
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.plants.rigid_axles import RigidAxles
from adhesion_jax.traction.rails import BySpeed, stacked
from adhesion_jax.traction.surface import with_peak
from adhesion_jax.traction.systems.base import built
from adhesion_jax.traction.systems.fang2018 import (
    CRITICAL,
    SEGMENTS,
    SYSTEM,
)
from experiments.claims.settings import (
    Range,
    Setting,
)
from experiments.claims.traction import changed, plant_of

#: What the paper does not print, in SI units. `margin` is K2 over K2_TH in what lies beyond it,
#: `excess` the factor of a K1 that is excessive.
RANGES = {
    "wheel_radius": Range(0.43, 0.41, 0.43),
    "axle_load": Range(14000.0, 12000.0, 16000.0),
    "gear_efficiency": Range(0.98, 0.95, 0.99),
    "motor_inertia": Range(2.0, 1.0, 4.0, by_ratio=True),
    "wheelset_inertia": Range(100.0, 60.0, 160.0),
    "train_mass": Range(25530.0, 20000.0, 32000.0),
    "torque_limit": Range(1590.0, 1200.0, 2000.0),
    "torque_lag": Range(0.01, 0.002, 0.03, by_ratio=True),
    "second": Range(0.07, 0.05, 0.10),  # largest adhesion of road 2
    "second_over_third": Range(0.07 / 0.0593, 1.05, 1.5),
    "second_slip": Range(5.5, 4.5, 6.4),  # km/h
    "curve": Range(2.2222, 1.5, 4.0, by_ratio=True),  # b/a
    "pole": Range(-30.0, -10.0, -100.0, by_ratio=True),
    "gamma": Range(10.0, 1.0, 100.0, by_ratio=True),
    "first_p": Range(10.0, 1.0, 100.0, by_ratio=True),
    "first_slope": Range(0.3, 0.1, 0.6),
    "filter_time": Range(0.05, 0.01, 0.2, by_ratio=True),
    "near": Range(0.95, 0.90, 0.99),
    "margin": Range(1.02, 1.005, 1.05),
    "excess": Range(10.0, 3.0, 30.0, by_ratio=True),
    "rate_gain": Range(1000.0, 100.0, 30000.0, by_ratio=True),  # K1 of Eq. 8, N m s
    "rate_share": Range(18000 / CRITICAL, 0.3, 1.0),  # K2 of Eq. 8 over K2_TH
    "engaged": Range(30.0, 5.0, 50.0),  # km/h
    "open_loop": Range(100.0, 50.0, 1200.0, by_ratio=True),  # C(t), N m
    "difference": Range(0.8, 0.3, 3.0, by_ratio=True),  # m/s
    "creepage": Range(0.05, 0.01, 0.2, by_ratio=True),
    "released": Range(0.3, 0.1, 0.9),
    "unloading": Range(4.0, 1.0, 20.0, by_ratio=True),
    "ramp": Range(1600.0, 500.0, 5000.0, by_ratio=True),
}


#: K1 = 19000 with the slip in m/s, and with the slip in km/h as in every figure of the paper.
SLOPE_GAINS = {"m/s": 19000.0, "km/h": 3.6 * 19000.0}


#: The traction part of the run alone: the roads of braking are those of traction.
DURATION = 150.0


POOR = ("2", "3")


def loop_of(setting: Setting) -> Loop:
    """The loop of a setting, under the first controller of the system."""
    plant = plant_of(SYSTEM)
    names = (
        *("wheel_radius", "axle_load", "gear_efficiency", "motor_inertia", "wheelset_inertia"),
        *("train_mass", "torque_limit", "torque_lag"),
    )
    given = {name: setting[name] + 0 * getattr(plant, name) for name in names}
    plant = changed(plant, **given)
    third = setting["second"] / setting["second_over_third"]
    slips = {"1": 6.5, "2": setting["second_slip"], "3": 4.0}
    heights = {"1": 0.2, "2": setting["second"], "3": third}
    roads = {
        name: with_peak(heights[name], slip / 3.6, setting["curve"]) for name, slip in slips.items()
    }
    own = SYSTEM.cases(SYSTEM.step)[0]
    assert isinstance(own.rails, BySpeed)
    surfaces = stacked([roads[name[0]] for name in SEGMENTS])
    case = own._replace(
        rails=changed(own.rails, surfaces=surfaces),
        observer=FullDimension(jnp.asarray(setting["pole"])),
    )
    loop = built(SYSTEM, case, plant)
    limit = jnp.asarray(setting["torque_limit"])
    return changed(loop, driver=changed(loop.driver, traction=limit, braking=limit))


def critical_gain_of(loop: Loop) -> float:
    """K2_TH in N m (Eq. 18)."""
    plant = loop.plant
    assert isinstance(plant, RigidAxles)
    weight = plant.axle_load[0] * GRAVITY
    radius, gear = plant.wheel_radius[0], plant.gear_ratio
    held = radius * weight / (gear * plant.gear_efficiency)
    return float(held + gear * plant.inertia[0] / radius * weight / plant.train_mass)


def under_controller(loop: Loop, controller: Controller) -> Loop:
    return changed(loop, controller=controller)


def slope_loop(
    loop: Loop, setting: Setting, gain: float, slope_gain: float = SLOPE_GAINS["m/s"]
) -> Loop:
    names = ("gamma", "first_p", "first_slope", "filter_time")
    given = {name: jnp.asarray(setting[name]) for name in names}
    return under_controller(
        loop, SlopeFeedback(jnp.asarray(slope_gain), jnp.asarray(gain), **given)
    )


def rate_loop(loop: Loop, setting: Setting, engaged_kmh: float, open_loop: float = 0.0) -> Loop:
    gain = setting["rate_share"] * critical_gain_of(loop)
    numbers = (setting["rate_gain"], gain, setting["filter_time"], engaged_kmh / 3.6, open_loop)
    return under_controller(loop, RateFeedback(*map(jnp.asarray, numbers)))


def threshold_loop(loop: Loop, setting: Setting) -> Loop:
    names = ("difference", "creepage", "released", "unloading", "ramp")
    return under_controller(loop, Threshold(**{name: jnp.asarray(setting[name]) for name in names}))


def bench_delay() -> float:
    """The dead time of the bench that ships, s."""
    return float(read_plant(shipped()["fang2018_bench"]).plant.dead_time)


def bench_loop(loop: Loop, delay: float) -> Loop:
    """Behind a bus with a dead time in s."""
    plant = changed(loop.plant, dead_time=jnp.asarray(delay))
    return changed(loop, plant=plant, nominal=plant)
