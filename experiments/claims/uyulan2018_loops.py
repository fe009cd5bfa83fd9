"""The loops of Uyulan et al. 2018: as printed, in other readings, and at drawn settings."""

from functools import cache
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from adhesion_jax.curves import Exponential
from adhesion_jax.traction.loop import Loop
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.plants.elastic_axles import ElasticAxles
from adhesion_jax.traction.rails import Rails
from adhesion_jax.traction.seekers.base import Seeker
from adhesion_jax.traction.signals import Number, PerAxle, Reference, Signals
from adhesion_jax.traction.surface import BothSides, Scaled
from adhesion_jax.traction.systems.base import built
from adhesion_jax.traction.systems.uyulan2018 import SURFACES, SYSTEM
from experiments.claims.claim import Setting, read_paper
from experiments.claims.traction import (
    changed,
    numbers_of,
    on_plant,
    plant_of,
    with_numbers,
)

PAPER = read_paper("uyulan2018")


SEGMENTS = ("first", "second", "third")


class ExactState(NamedTuple):
    asked: PerAxle  # m/s
    since: Array  # the last switch, s
    slip: PerAxle  # a step ago, m/s


class ExactSlope(Seeker):
    """The seeker as printed, given the true slope of the rail at the slip that is measured."""

    rails: Rails
    step: Number  # s, of the plant
    gamma: Number
    threshold: Number  # eps, m/s^2
    switch: Number  # s
    start: Number  # m/s

    def init(self, nominal: Plant, signals: Signals) -> ExactState:
        asked = jnp.full_like(signals.slip, self.start)
        return ExactState(asked, jnp.zeros(()), signals.slip)

    def update(
        self, state: ExactState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[ExactState, Reference]:
        number = jnp.round(signals.time / self.step).astype(int)
        speed = signals.train_speed
        surface = self.rails.surface(self.rails.segment(number, speed, jnp.asarray(False)))
        slope = jax.vmap(jax.grad(surface), (0, None))(signals.slip, speed)
        moves = jnp.abs(signals.slip - state.slip) >= period * self.threshold
        rate = self.gamma * jnp.where(moves, slope, 0.0)
        since = state.since + period
        switches = since > self.switch + period / 2
        asked = jnp.where(switches, signals.slip, state.asked + period * rate)
        since = jnp.where(switches, period, since)
        return ExactState(asked, since, signals.slip), Reference(asked, rate)


@cache
def best_slip(surface: str = "dry") -> float:
    """The best slip on a surface, m/s."""
    return float(SURFACES[surface].peak(jnp.asarray(10.0)).slip)


def of_columns(setting: Setting, method: str) -> list[Loop]:
    """The six columns of Table 1 at a setting, of one of the two methods."""
    plant, found = _plant_at(setting), []
    for case in SYSTEM.cases(SYSTEM.step):
        if case.method != method:
            continue
        loop = with_numbers(built(SYSTEM, case, plant), setting, "controller", "observer")
        if method == "as printed":
            loop = with_numbers(loop, setting, "seeker")
            gain = jnp.asarray(setting["observer.gain"])
            loop = changed(loop, seeker=changed(loop.seeker, gain=gain))
        found.append(changed(loop, driver=changed(loop.driver, traction=plant.torque_limit)))
    return found


def _plant_at(setting: Setting) -> ElasticAxles:
    plant = plant_of(SYSTEM)
    assert isinstance(plant, ElasticAxles)
    turning = (plant.dynamic_mass - plant.static_mass) / (1 - setting["slip_ratio"]) ** 2
    mass = plant.static_mass + turning
    return changed(plant, dynamic_mass=mass, **numbers_of(setting, "plant"))


def layered(loop: Loop, layer: float) -> Loop:
    return changed(loop, controller=changed(loop.controller, layer=jnp.asarray(layer)))


def steeper(loop: Loop) -> Loop:
    """The grade as printed, m_dyn g sin(slope)."""
    assert isinstance(loop.plant, ElasticAxles)
    share = loop.plant.dynamic_mass / loop.plant.static_mass
    return changed(loop, slope=jnp.arcsin(share * jnp.sin(loop.slope)))


def varied(loop: Loop, setting: Setting) -> Loop:
    """Masses and inertias that control does not know."""
    plant, mass, inertia = loop.plant, setting["mass"], setting["inertia"]
    factors = {
        **dict.fromkeys(("static_mass", "dynamic_mass", "wheel_load"), mass),
        **dict.fromkeys(("motor_inertia", "wheel_inertia"), inertia),
    }
    other = {name: factor * getattr(plant, name) for name, factor in factors.items()}
    return changed(loop, plant=changed(plant, **other))


def sided(loop: Loop, setting: Setting) -> Loop:
    right = loop.rails.surfaces.law
    peak, share = right.peak({}), (1 + setting["left"]) / 2
    largest = peak._replace(adhesion=share * peak.adhesion)
    law = BothSides(largest, right, Scaled(right, jnp.full(3, setting["left"])))
    rails = changed(loop.rails, surfaces=changed(loop.rails.surfaces, law=law))
    return changed(loop, rails=rails)


def braking(loop: Loop) -> Loop:
    """Traction to 12 m/s, then braking to 5 m/s."""
    limit = loop.driver.traction
    most, least = jnp.asarray(12.0), jnp.asarray(5.0)
    return changed(loop, driver=changed(loop.driver, until=most, braking=limit, down_to=least))


def observing(loop: Loop, gain: float, beside: int) -> Loop:
    """With another gain L of the observer, from a start some billionths of a m/s beside ours."""
    other = jnp.asarray(gain)
    observer, seeker = changed(loop.observer, gain=other), changed(loop.seeker, gain=other)
    return changed(loop, observer=observer, seeker=seeker, slip=loop.slip + 1e-9 * beside)


def exact(loop: Loop) -> Loop:
    numbers = (SYSTEM.step, 0.65, 1e-4, 10.0, best_slip())
    return changed(loop, seeker=ExactSlope(loop.rails, *map(jnp.asarray, numbers)))


def own_rails(loop: Loop) -> Loop:
    """Four axles, each on a surface of its own: dry, wet, low and a fifth of the dry one."""
    level = jnp.array([1.0, 0.35, 0.1, 0.2])
    law = loop.rails.surfaces.law
    assert isinstance(law, Exponential)
    a, b, c = (jnp.asarray(number)[:, None] for number in (law.a, law.b, law.c))
    law = Exponential(a=a + 0 * level, b=b + 0 * level, c=c * level)
    rails = changed(loop.rails, surfaces=changed(loop.rails.surfaces, law=law))
    each = jnp.ones(4)
    names = ("radius_right", "radius_left", "wheel_load")
    own = {name: each * getattr(loop.plant, name) for name in names}
    loop = on_plant(loop, axles_alike=jnp.asarray(1.0), **own)
    return changed(loop, rails=rails, slip=each * loop.slip)
