"""Every identifier on a small run of every scenario that it accepts."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.curves.polach import PolachFalling
from adhesion_jax.identifiers import IDENTIFIERS, identify
from adhesion_jax.identifiers.filters import RandomWalkFilter
from adhesion_jax.identifiers.gradient import GradientLeastSquares
from adhesion_jax.records import Known, record_axes
from adhesion_jax.scenarios import SCENARIOS, Options, Scenario, build
from adhesion_jax.scenarios.course import Apart
from adhesion_jax.scenarios.excitation import Excitation, Sweep
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rail_process import RailProcess

RUNS = 8


class AtOneSpeed(Excitation):
    """A sweep at a speed that is another in each run, and measured."""

    sweep: Sweep = Sweep(points=120)
    slip_noise = 0.0
    points = 120
    axes = record_axes(None, 0, 0)

    def draw(self, key, shape):
        excited, key = self.sweep.draw(key, shape)
        left, own = jax.random.split(key)
        speed = jnp.broadcast_to(jax.random.uniform(own, minval=10.0, maxval=30.0), shape)
        return excited._replace(conditions={"vehicle_speed_mps": speed}), left


#: As few shapes as there can be: scenarios of one shape share their compiled programs.
SMALL = {
    "single": Options(points=120),
    "he2018-1": Options(points=100),
    "he2018-blocks": Options(points=100, blocks=20),
    "qian2024": Options(points=120),
    "coloured": Options(points=120),
    "mismatch": Options(points=120),
    "mismatch-kiencke": Options(points=120),
}
CASES = {name: (name, SMALL.get(name, Options(points=200))) for name in SCENARIOS}
#: And a curve whose peak depends on a condition, which `Known` says.
FALLING = "falling friction"
_RAIL = PolachFalling(mu0=0.55, a=0.4, b=0.6, stiffness=150.0, k_s=0.4)
_FALLING = Scenario(
    RailProcess((FALLING,), _RAIL),
    AtOneSpeed(),
    Noise(),
    Apart(120),
    Known(
        _RAIL,
        lower=[0.11, 0.08, 0.12, 30.0, 0.1],
        upper=[2.0, 1.0, 3.0, 750.0, 1.0],
        conditions={"vehicle_speed_mps": 20.0},
    ),
)
KIENCKE = Known(
    Kiencke(a0=40.0, p1=60.0, p2=60.0), jnp.array([1.0, 1.0]), jnp.array([400.0, 400.0])
)
NAMES = ("c1", "c2", "c3", "mu_max", "slip_opt")

#: These know no curve; their contract is another one, and so are their tests.
WITHOUT_CURVE = ("rls-slope", "bayes-departure")
CURVE_METHODS = {name: i for name, i in IDENTIFIERS.items() if name not in WITHOUT_CURVE}
GRADIENT = [name for name, i in IDENTIFIERS.items() if isinstance(i, GradientLeastSquares)]
EVOLUTION = [name for name in IDENTIFIERS if name.startswith("ml-de")]
FILTERS = [name for name, i in IDENTIFIERS.items() if isinstance(i, RandomWalkFilter)]

#: Methods that draw random numbers of their own.
RANDOM = (*EVOLUTION, "particle")

# Without optimisation: many programs, each run a few times on few runs.
quick_jit = functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})

#: Methods that know no box: what they find is what the sums say.
UNBOUNDED = ("ls-kiencke", "rls-kiencke", "rls-kiencke-variable")


def draw(scenario, key):
    return scenario.draw(key)


class Programs:
    """To draw and to identify runs whose records differ along these axes.

    One program serves every scenario of a size, and the variants of a method that differ in
    numbers alone.
    """

    def __init__(self, axes):
        self.draw = quick_jit(jax.vmap(draw, (None, 0), axes))
        self.identify = quick_jit(jax.vmap(identify, in_axes=(None, None, axes, 0)))


_MADE = {}


def programs(axes):
    """Made once: axes cannot be hashed, their text can."""
    return _MADE.setdefault(str(axes), Programs(axes))


def identified(identifier, scenario, runs=RUNS, seed=0, solver_seed=7):
    """The records and estimates of some runs, as a campaign asks for them."""
    keys = jax.random.split(jax.random.key(seed), runs)
    solver_keys = jax.random.split(jax.random.key(solver_seed), runs)
    batch = programs(scenario.run_axes)
    records = batch.draw(scenario, keys)
    return records, batch.identify(identifier, scenario.known, records, solver_keys)


@functools.cache
def scenario_of(case):
    return _FALLING if case == FALLING else build(*CASES[case])


def accepts(name, case):
    return IDENTIFIERS[name].accepts(scenario_of(case).known) is None


PAIRS = [(name, case) for case in (*CASES, FALLING) for name in IDENTIFIERS if accepts(name, case)]
CURVE_PAIRS = [pair for pair in PAIRS if pair[0] in CURVE_METHODS]


def has_truth(scenario):
    """Whether some curve of the kind that is told is the truth of a block, at the slips measured.

    Where a rail drifts or has another curve, none is; of friction that falls with speed no data of
    this size tell all parameters.
    """
    rail, known = scenario.rail, scenario.known
    alike = type(rail.curve) is type(known.curve) and not rail.curve.NEEDS
    return alike and not rail.drifts and not scenario.excitation.slip_noise


HAVE_TRUTH = [pair for pair in CURVE_PAIRS if has_truth(scenario_of(pair[1]))]

_HOMES = ("single", "qian2024", "qian2024-switch", "stream-slope")

#: A short scenario that each method takes.
HOME = {
    name: next(case for case in _HOMES if accepts(name, case))
    for name in (*CURVE_METHODS, "bayes-departure")
}


#: Methods that take whole blocks; the others take one sample after the other.
BATCH = [
    name
    for name, method in CURVE_METHODS.items()
    if method.accepts(dataclasses.replace(scenario_of(HOME[name]).known, by_sample=True))
]


#: One method of each form; those that differ from it in numbers alone share its program.
FORMS = [*{jax.tree.structure(IDENTIFIERS[name]): name for name in reversed(IDENTIFIERS)}.values()]

#: Every other one is tested before a change lands, and not in every run.
LONG_FORMS = FORMS[1::2]


def in_lanes(pairs):
    """Always every other form of a method on its home, before a change lands each one.

    At night all of them, elsewhere as well.
    """
    home = [pair for pair in pairs if HOME.get(pair[0], pair[1]) == pair[1]]
    always = [pair for pair in home if pair[0] in FORMS or pair[0] not in HOME]
    away = [pair for pair in pairs if pair not in home and pair[0] in FORMS]
    marks = dict.fromkeys(pairs, pytest.mark.slow)
    marks |= dict.fromkeys(away[::12], pytest.mark.thorough) | dict.fromkeys(always, ())
    marks |= {pair: pytest.mark.long for pair in always if pair[0] in LONG_FORMS}
    return [pytest.param(*pair, marks=mark) for pair, mark in marks.items()]


@functools.cache
def small(identifier, scenario_name):
    scenario = scenario_of(scenario_name)
    assert IDENTIFIERS[identifier].accepts(scenario.known) is None
    return scenario, *identified(IDENTIFIERS[identifier], scenario)


def parameters_of(estimate):
    names = [name for name in estimate.values if name not in ("mu_max", "slip_opt")]
    return np.stack([estimate.values[name] for name in names], axis=-1)


def law(parameters, slip, a0=None, speed=None):
    """Adhesion without the package: Burckhardt's three parameters, Polach's five, Kiencke's.

    These, where an a0 is given, are p1 and p2, or it and they.
    """
    if a0 is not None and parameters.shape[-1] in (2, 3):
        *free, p1, p2 = np.moveaxis(parameters[..., None], -2, 0)
        a0 = free[0] if free else a0
        return a0 * slip / (1 + p1 * slip + p2 * slip**2)
    if parameters.shape[-1] == 5:
        mu0, a, b, stiffness, k_s = np.moveaxis(parameters[..., None], -2, 0)
        friction = mu0 * ((1 - a) * np.exp(-b * slip * speed) + a)
        e = np.pi * stiffness * slip / (4 * friction)
        return 2 * friction / np.pi * (e / (1 + e**2) + np.arctan(k_s * e))
    c1, c2, c3 = np.moveaxis(parameters[..., None], -2, 0)
    return c1 * (1 - np.exp(-c2 * slip)) - c3 * slip


def peak_slip(parameters, a0=None, speed=None):
    """The slip of the peak, or the largest one where the curve still rises there."""
    with np.errstate(divide="ignore", invalid="ignore"):
        if a0 is not None and parameters.shape[-1] in (2, 3):
            slip = parameters[..., -1] ** -0.5
        elif parameters.shape[-1] == 5:
            slip = np.array([searched_peak(p, speed) for p in parameters.reshape(-1, 5)])
            slip = slip.reshape(parameters.shape[:-1])
        else:
            c1, c2, c3 = np.moveaxis(parameters, -1, 0)
            slip = np.log(c1 * c2 / c3) / c2
    return np.where(np.isfinite(slip), np.clip(slip, 0, 1), 1.0)


def searched_peak(parameters, speed):
    """By scipy, about the best of a fine grid."""
    grid = np.concatenate([[0.0], np.logspace(-5, 0, 2001)])
    best = np.argmax(law(parameters, grid, speed=speed))
    ends = grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)]
    found = minimize_scalar(
        lambda slip: -law(parameters, np.array([slip]), speed=speed)[0],
        bounds=ends,
        method="bounded",
        options={"xatol": 1e-10},
    )
    return 1.0 if best == grid.size - 1 else found.x


def raw_sum_of_squares(parameters, records, a0=None):
    """sum (z - f)^2 over the points that are there, [runs, blocks], without the package."""
    slip, mask = np.asarray(records.slip), np.asarray(records.mask)
    speed = records.conditions.get("vehicle_speed_mps")
    model = np.sign(slip) * law(parameters, np.abs(slip), a0, speed)  # noise makes some negative
    misfit = np.asarray(records.adhesion) - model
    return np.sum(np.where(mask, misfit, 0.0) ** 2, axis=-1)


def signature(estimate):
    return jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype), estimate)
