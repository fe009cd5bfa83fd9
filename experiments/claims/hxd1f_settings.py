"""The loops of HXD1F 2019 at settings drawn from ranges, for its tables are lost."""

import jax.numpy as jnp

from adhesion_jax.traction.controllers.linearised import Barrier, SlidingMode
from adhesion_jax.traction.controllers.readhesion import DifferentialAcceleration
from adhesion_jax.traction.loop import Loop
from adhesion_jax.traction.observers.sliding_modes import TerminalSliding
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.rails import by_time
from adhesion_jax.traction.seekers.climbing import SlidingExtremum
from adhesion_jax.traction.surface import with_peak
from adhesion_jax.traction.systems.base import built
from adhesion_jax.traction.systems.hxd1f import STARTS, SYSTEM
from experiments.claims.settings import (
    Range,
    Setting,
)
from experiments.claims.traction import changed, plant_of

#: All that the paper does not print, or prints in a table that is lost. The largest torque is drawn
#: as a multiple of the one that the dry rail asks for.
RANGES = {
    "motor_inertia": Range(25.0, 10.0, 40.0, by_ratio=True),
    "wheelset_inertia": Range(400.0, 200.0, 600.0),
    "train_mass": Range(1e7, 2e6, 2e7, by_ratio=True),
    "gear_efficiency": Range(0.975, 0.95, 0.99),
    "torque_over_dry": Range(1.19, 1.1, 1.6),
    "torque_lag": Range(0.01, 0.002, 0.02, by_ratio=True),
    "train_speed": Range(5.0, 1.0, 15.0),
    "dry": Range(0.36, 0.25, 0.45),
    "wet": Range(0.20, 0.12, 0.25),
    "snow": Range(0.10, 0.06, 0.12),
    "snow_slip": Range(0.05, 0.03, 0.08),
    "curve": Range(2.2222, 1.5, 4.0, by_ratio=True),  # b/a
    "sampling": Range(0.0, 0.0, 1.0),  # of the speed: at every step below a half, at 1 ms above
    "observer_surface": Range(100.0, 30.0, 300.0, by_ratio=True),
    "observer_rate": Range(50.0, 15.0, 150.0, by_ratio=True),
    "observer_switching": Range(4e4, 1e4, 1e5, by_ratio=True),
    "observer_pole": Range(-233.0, -100.0, -400.0, by_ratio=True),
    "seeker_speed": Range(0.4, 0.1, 1.0, by_ratio=True),
    "seeker_rise": Range(0.5, 0.1, 1.0, by_ratio=True),
    "seeker_width": Range(0.08, 0.02, 0.2, by_ratio=True),
    "seeker_start": Range(0.01, 0.005, 0.05, by_ratio=True),
    "seeker_tracker": Range(60.0, 20.0, 200.0, by_ratio=True),
    "barrier_gain": Range(20.0, 5.0, 80.0, by_ratio=True),
    "barrier_below": Range(0.1, 0.03, 0.2, by_ratio=True),
    "barrier_above": Range(0.3, 0.1, 0.5, by_ratio=True),
    "sliding_gain": Range(1500.0, 500.0, 4000.0, by_ratio=True),
    "ramp": Range(12e3, 4e3, 30e3, by_ratio=True),
    "trip": Range(1.0, 0.3, 3.0, by_ratio=True),
    "released": Range(0.3, 0.1, 1.0, by_ratio=True),
    "calm": Range(0.2, 0.1, 0.5, by_ratio=True),
    "unloading": Range(6.0, 2.0, 20.0, by_ratio=True),
    "hold": Range(0.1, 0.03, 0.3, by_ratio=True),
    "haste": Range(3.0, 1.0, 6.0, by_ratio=True),
    "back": Range(0.85, 0.6, 0.95),
    "filter_time": Range(0.01, 0.003, 0.03, by_ratio=True),
}


#: The load that the observers are to find, N m.
LOAD = 3000.0


def loop_of(setting: Setting) -> Loop:
    """The paper's own method at a setting, on a speed that is not sampled."""
    number = {name: jnp.asarray(value) for name, value in setting.items()}
    plant = plant_of(SYSTEM)
    names = ("motor_inertia", "wheelset_inertia", "train_mass", "gear_efficiency", "torque_lag")
    plant = changed(plant, **{name: number[name] for name in names})
    load = plant.load_of(number["dry"] * jnp.ones(1))[0]
    plant = changed(plant, torque_limit=setting["torque_over_dry"] * load)
    slips = {"dry": 0.2, "wet": 0.08, "snow": setting["snow_slip"]}
    surfaces = [with_peak(setting[name], slip, setting["curve"]) for name, slip in slips.items()]
    own = SYSTEM.cases(SYSTEM.step)[0]
    case = own._replace(
        rails=by_time(surfaces, STARTS, SYSTEM.step),
        observer=TerminalSliding(
            number["observer_surface"], number["observer_rate"], number["observer_switching"]
        ),
        seeker=SlidingExtremum(
            number["seeker_speed"],
            number["seeker_rise"],
            number["seeker_width"],
            number["seeker_start"],
            jnp.asarray(0.005),
            jnp.asarray(0.6),
            number["seeker_tracker"],
        ),
        controller=Barrier(
            number["barrier_gain"],
            number["barrier_below"],
            number["barrier_above"],
            jnp.asarray(-0.3),
        ),
    )
    loop = built(SYSTEM, case, plant)
    driver = changed(loop.driver, traction=plant.torque_limit)
    return changed(loop, driver=driver, train_speed=number["train_speed"])


def sampled_loop(loop: Loop, sampled: float) -> Loop:
    return changed(loop, sensors=changed(loop.sensors, period=sampled))


def narrow_loop(loop: Loop, lag: float, above: float) -> Loop:
    plant = changed(loop.plant, torque_lag=jnp.asarray(lag))
    controller = changed(loop.controller, above=jnp.asarray(above))
    return changed(loop, plant=plant, nominal=plant, controller=controller)


def differential_loop(loop: Loop, setting: Setting) -> Loop:
    names = ("ramp", "trip", "released", "calm", "unloading", "hold", "haste", "back")
    controller = DifferentialAcceleration(
        **{name: jnp.asarray(setting[name]) for name in (*names, "filter_time")},
        least=jnp.asarray(-0.15),
    )
    return changed(loop, seeker=None, controller=controller)


def sliding_loop(loop: Loop, setting: Setting, layer: float = 0.0) -> Loop:
    controller = SlidingMode(*map(jnp.asarray, (setting["sliding_gain"], layer, -0.3)))
    return changed(loop, controller=controller)


def own_axles_loop(loop: Loop) -> Loop:
    """Two units of four axles, each axle with its own load and its own control."""
    plant = read_plant(shipped()["hxd1f_axles"]).plant
    names = ("motor_inertia", "wheelset_inertia", "train_mass", "gear_efficiency", "torque_lag")
    plant = changed(plant, **{name: getattr(loop.plant, name) for name in (*names, "torque_limit")})
    return changed(loop, plant=plant, nominal=plant, slip=jnp.zeros_like(plant.radius))
