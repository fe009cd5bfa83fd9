"""Steps of a bare plant: the package and C, on the same equations."""

import ctypes
import shutil
import subprocess
from collections.abc import Callable, Mapping
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

#: The names under which a C compiler is searched for.
_COMPILERS = ("gcc", "clang", "cc")

#: Loops as vectors of the widest kind, with the exponentials of the vector library.
_FLAGS = ("-O3", "-march=native", "-ffast-math", "-shared", "-fPIC")

_SOURCE = """
#include <math.h>

/* One rigid axle on an exponential surface: motor speed w, train speed v, torque t.
   p: radius, load, gear, efficiency, motor and wheelset inertia, mass, axles alike, transfer,
   resistance a, b and c, 1/lag, command, and a, b and c of the surface. */
static inline void rates(const double *restrict p, double w, double v, double t,
                         double *dw, double *dv, double *dt) {
    double slip = p[0] / p[2] * w - v, size = fabs(slip);
    double adhesion = p[16] * copysign(exp(-p[14] * size) - exp(-p[15] * size), slip);
    double force = adhesion * p[1] * 9.81 / (1.0 + adhesion * p[8]);
    double load = p[0] * force, inertia = p[5] / p[2];
    double to_wheel = 1.0 / (p[2] * p[3]), to_motor = p[3] / p[2];
    int driving = (inertia / p[4] * t + load) * w >= 0;
    *dw = (t - load * (driving ? to_wheel : to_motor))
        * (driving ? 1.0 / (p[4] + inertia * to_wheel) : 1.0 / (p[4] + inertia * to_motor));
    double speed = 3.6 * fabs(v), share = v * 100.0;
    share = share > 1.0 ? 1.0 : share < -1.0 ? -1.0 : share;
    *dv = p[7] * force / p[6] - (p[9] + speed * (p[10] + speed * p[11])) * share;
    *dt = p[12] * (p[13] - t);
}

/* No array overlaps another, so that what depends on p alone is computed once. */
#define WIDTH 64
void steps(long runs, long count, double h, const double *restrict p,
           double *restrict w, double *restrict v, double *restrict t) {
    for (long first = 0; first < runs; first += WIDTH) {
        long last = first + WIDTH < runs ? first + WIDTH : runs;
        for (long step = 0; step < count; step++) {
            #pragma GCC ivdep
            for (long i = first; i < last; i++) {
                double w1, v1, t1, w2, v2, t2, w3, v3, t3, w4, v4, t4, k = 0.5 * h;
                rates(p, w[i], v[i], t[i], &w1, &v1, &t1);
                rates(p, w[i] + k * w1, v[i] + k * v1, t[i] + k * t1, &w2, &v2, &t2);
                rates(p, w[i] + k * w2, v[i] + k * v2, t[i] + k * t2, &w3, &v3, &t3);
                rates(p, w[i] + h * w3, v[i] + h * v3, t[i] + h * t3, &w4, &v4, &t4);
                w[i] += h / 6 * (w1 + 2 * (w2 + w3) + w4);
                v[i] += h / 6 * (v1 + 2 * (v2 + v3) + v4);
                t[i] += h / 6 * (t1 + 2 * (t2 + t3) + t4);
            }
        }
    }
}
"""


def compiled(folder: Path) -> ctypes.CDLL | str:
    """The loops, compiled into a folder; where that cannot be, a sentence that says why."""
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    if compiler is None:
        return f"Not timed: there is no C compiler ({', '.join(_COMPILERS)})."
    source, library = folder / "loops.c", folder / "loops.so"
    source.write_text(_SOURCE)
    command = [compiler, *_FLAGS, str(source), "-o", str(library), "-lm"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        return f"Not timed: {compiler} could not compile the loops."
    return ctypes.CDLL(str(library))


def _steps(library: ctypes.CDLL, runs: int, count: int, step: float, *arrays: np.ndarray) -> None:
    """Move the states, after the parameters the last of the contiguous arrays, by these steps."""
    pointers = [one.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for one in arrays]
    library.steps(ctypes.c_long(runs), ctypes.c_long(count), ctypes.c_double(step), *pointers)


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
        _steps(library, RUNS, STEPS, STEP, begun.parameters, *states)
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
