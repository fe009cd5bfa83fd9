"""Steps of a bare plant: the package and C, on the same equations."""

import ctypes
import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, cast

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
from experiments.speed.turns import Timed, timed

_LOOPS = Path(__file__).parent / "loops.c"

#: The names under which a C compiler is searched for.
_COMPILERS = ("gcc", "clang", "cc")

#: Loops as vectors of the widest kind, with the exponentials of the vector library.
_FLAGS = ("-O3", "-march=native", "-ffast-math", "-shared", "-fPIC")


def compiled(folder: Path) -> ctypes.CDLL | str:
    """The loops, compiled into a folder; where that cannot be, a sentence that says why."""
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    if compiler is None:
        return f"Not timed: there is no C compiler ({', '.join(_COMPILERS)})."
    library = folder / "loops.so"
    command = [compiler, *_FLAGS, str(_LOOPS), "-o", str(library), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return f"Not timed: {compiler} could not compile the loops."
    return ctypes.CDLL(str(library))


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


def in_c(begun: Start, library: ctypes.CDLL) -> Callable[[], Sequence[np.ndarray]]:
    def steps() -> Sequence[np.ndarray]:
        states = [one.copy() for one in begun[1:]]
        arrays = (begun.parameters, *states)
        pointers = [one.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for one in arrays]
        library.steps(ctypes.c_long(RUNS), ctypes.c_long(STEPS), ctypes.c_double(STEP), *pointers)
        return states

    return steps


def entries(library: ctypes.CDLL | str) -> Mapping[str, Timed]:
    """What is timed: classical Runge-Kutta steps of one rigid axle."""
    begun, amount = start(), RUNS * STEPS
    return {
        PEER: Timed(None, library)
        if isinstance(library, str)
        else Timed(timed(in_c(begun, library), amount), "vectors over runs"),
        "rigid-axles": Timed(timed(in_jax(begun), amount), "the plant of the package"),
    }
