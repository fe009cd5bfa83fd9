"""Steps of a bare plant: the package, numba and C, on the same equations."""

import ctypes
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np

from adhesion_jax.curves import Exponential
from adhesion_jax.programs import WIDELY
from adhesion_jax.traction.integration import rk4
from adhesion_jax.traction.plants.base import Held
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.plants.rigid_axles import RigidAxles, RigidState
from adhesion_jax.traction.systems.fang2018 import road
from experiments.speed import c_code
from experiments.speed.turns import Timed, absent, timed

UNIT = "steps"
PEER = "steps in C"
RUNS, STEPS, STEP = 1024, 200, 2e-4

#: Torque of the motor in N m.
_COMMAND = 1590.0


class Start(NamedTuple):
    """What all of them are given: parameters in the order of the loop in C, and states [runs]."""

    parameters: np.ndarray
    motor_speed: np.ndarray
    train_speed: np.ndarray
    torque: np.ndarray


def plant() -> RigidAxles:
    return cast(RigidAxles, read_plant(shipped()["fang2018"]).plant)


def start() -> Start:
    """Axles of the train of Fang et al. at speeds from rest to 130 km/h, some of them spinning."""
    axle, curve = plant(), cast(Exponential, road(0.2, 6.5).law)
    lag = float(axle.torque_lag)
    numbers = [
        *(axle.wheel_radius[0], axle.axle_load[0], axle.gear_ratio, axle.gear_efficiency),
        *(axle.motor_inertia, axle.wheelset_inertia, axle.train_mass, axle.axles_alike),
        *(axle.load_transfer[0], axle.resistance_a, axle.resistance_b, axle.resistance_c),
        *(1 / lag if lag > 0 else 0.0, _COMMAND, curve.a, curve.b, curve.c),
    ]
    train = np.linspace(0.0, 36.0, RUNS)
    slip = np.linspace(0.0, 3.0, RUNS)[::-1]
    motor = (train + slip) * float(axle.gear_ratio) / float(axle.wheel_radius[0])
    return Start(np.array(numbers, float), motor, train, np.full(RUNS, _COMMAND))


def in_jax(begun: Start) -> Callable[[], RigidState]:
    """The states after the steps, by the plant of the package."""
    axle, surface = plant(), road(0.2, 6.5)
    states = RigidState(
        jnp.asarray(begun.motor_speed)[:, None],
        jnp.asarray(begun.train_speed),
        jnp.asarray(begun.torque)[:, None],
    )

    def one_run(state: RigidState) -> RigidState:
        held = Held(jnp.full(1, _COMMAND), surface, jnp.asarray(0.0))
        return jax.lax.fori_loop(
            0, STEPS, lambda _, now: rk4(lambda s: axle.derivative(s, held), now, STEP), state
        )

    # Compiled as the traction loop with noise is.
    steps = jax.jit(jax.vmap(one_run)).lower(states).compile(dict(WIDELY))
    return lambda: jax.block_until_ready(steps(states))


def in_c(begun: Start, library: ctypes.CDLL) -> Callable[[], tuple[np.ndarray, ...]]:
    def steps() -> tuple[np.ndarray, ...]:
        states = tuple(one.copy() for one in begun[1:])
        c_code.steps(library, RUNS, STEPS, STEP, begun.parameters, *states)
        return states

    return steps


def in_numba(begun: Start) -> Callable[[], tuple[np.ndarray, ...]]:
    njit = import_module("numba").njit

    @njit(fastmath=True)
    def rates(p: Any, w: Any, v: Any, t: Any) -> Any:
        slip = p[0] / p[2] * w - v
        size = abs(slip)
        adhesion = p[16] * np.sign(slip) * (np.exp(-p[14] * size) - np.exp(-p[15] * size))
        force = adhesion * p[1] * 9.81 / (1.0 + adhesion * p[8])
        load, inertia = p[0] * force, p[5] / p[2]
        driving = (inertia / p[4] * t + load) * w >= 0
        through = 1.0 / (p[2] * p[3]) if driving else p[3] / p[2]
        speed = 3.6 * abs(v)
        share = min(max(v * 100.0, -1.0), 1.0)
        against = (p[9] + speed * (p[10] + speed * p[11])) * share
        turning = (t - load * through) / (p[4] + inertia * through)
        return turning, p[7] * force / p[6] - against, p[12] * (p[13] - t)

    @njit(fastmath=True)
    def all_runs(p: Any, w: Any, v: Any, t: Any, count: int, h: float) -> Any:
        for i in range(w.size):
            for _ in range(count):
                w1, v1, t1 = rates(p, w[i], v[i], t[i])
                w2, v2, t2 = rates(p, w[i] + h / 2 * w1, v[i] + h / 2 * v1, t[i] + h / 2 * t1)
                w3, v3, t3 = rates(p, w[i] + h / 2 * w2, v[i] + h / 2 * v2, t[i] + h / 2 * t2)
                w4, v4, t4 = rates(p, w[i] + h * w3, v[i] + h * v3, t[i] + h * t3)
                w[i] += h / 6 * (w1 + 2 * (w2 + w3) + w4)
                v[i] += h / 6 * (v1 + 2 * (v2 + v3) + v4)
                t[i] += h / 6 * (t1 + 2 * (t2 + t3) + t4)

    def steps() -> tuple[np.ndarray, ...]:
        states = tuple(one.copy() for one in begun[1:])
        all_runs(begun.parameters, *states, STEPS, STEP)
        return states

    return steps


def entries(library: ctypes.CDLL | str) -> Mapping[str, Timed]:
    """What is timed: classical Runge-Kutta steps of one rigid axle."""
    begun, amount, missing = start(), RUNS * STEPS, absent("numba")
    return {
        PEER: Timed(None, library)
        if isinstance(library, str)
        else Timed(timed(in_c(begun, library), amount), "vectors over runs"),
        "numba": Timed(None, missing)
        if missing
        else Timed(timed(in_numba(begun), amount), "one run after the other"),
        "rigid-axles": Timed(timed(in_jax(begun), amount), "the plant of the package"),
    }
