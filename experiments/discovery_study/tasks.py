"""The sets of a study: planted effect, strength and noise of each, all drawn from the seed."""

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from adhesion_jax.effects import family_of
from experiments.campaigns.plantable import PLANTABLE
from experiments.campaigns.runs import BASE_CURVES
from experiments.campaigns.simulator import SetNoise, SimulatedSet, simulate
from experiments.discovery_study.one_log import LOG_FORMS, one_log
from experiments.discovery_study.otherwise import FORMS, forms_of
from experiments.discovery_study.random_effect import (
    ACTS_ON,
    RANDOM_COLUMNS,
    RandomEffect,
    simulate_random,
)

#: Effects whose detection is followed over their strength: one or two of each kind.
FOLLOWED = (
    *("humidity", "temperature", "load_peak", "patch", "curve"),
    *("falling_friction", "lag", "hysteresis", "slip_noise"),
)


#: Visible misfit, in standard deviations of the noise, at which detection is measured.
VISIBLE = (0.1, 0.2, 0.35, 0.5, 1.0, 2.0)

#: Autocorrelations that the noise of a set is drawn from.
AUTOCORRELATIONS = (0.0, 0.3, 0.6)

#: Smallest and largest autocorrelation of the noise of slow sets with nothing hidden.
_SLOW = (0.3, 0.95)

#: Smallest and largest visible misfit that random effects are given, in standard deviations of the
#: noise.
_RANDOM_VISIBLE = (0.55, 3.0)

#: Least visible misfit at which a random effect counts as one to be found, in the same unit.
_LEAST_VISIBLE = 0.5


class Log(NamedTuple):
    """What kind of log a locomotive gives."""

    wheel_speed_noise: float  # m/s
    runs: int
    points: int  # of a run


#: Logs and the autocorrelation of their noise.
LOGS = (
    *((Log(noise, 1, 3000), slow) for noise in (0.0, 0.01, 0.03) for slow in (0.0, 0.6)),
    (Log(0.01, 5, 600), 0.4),
    (Log(0.01, 28, 200), 0.4),
)


def draw_random_effect(acts_on: str, count: int, generator: np.random.Generator) -> RandomEffect:
    """A random effect of `count` columns, all equally likely."""
    columns = generator.choice(RANDOM_COLUMNS, count, replace=False)
    return RandomEffect(tuple(str(name) for name in columns), acts_on)


class Task(NamedTuple):
    """One set of a study."""

    part: str  # nothing, power, confusion, pair, random or log
    effects: tuple[str, ...]
    seed: int
    base: str
    operational: bool
    form: str
    noise: SetNoise
    visible: float | None  # wanted, in sigma; None for the strength of the simulator's choice
    random: RandomEffect | None = None
    log: Log | None = None

    @property
    def planted(self) -> str:
        """In a word."""
        if self.random is not None:
            return f"{self.random.acts_on} by {'*'.join(self.random.columns)}"
        return "+".join(self.effects) or "nothing"


def study_tasks(
    null: int,
    powers: int,
    seed: int,
    *,
    pairs: int = 0,
    random: int = 0,
    logs: int = 0,
    log_effects: int = 0,
) -> list[Task]:
    """The sets of every part in turn.

    Null sets; `powers` sets of each effect and strength, then as many of every effect; `pairs` sets
    of two effects; `random` sets of a random effect; of each kind of log `logs` with nothing
    hidden, and of each effect that logs are given `log_effects`.

    Base curves take turns, and so do designed and operational nulls; noise settings are drawn, and
    the second half of the nulls has its autocorrelation drawn anew from .3 to .95. Effects are
    planted in designed sets, in the catalogue's form and in another one by turns. Every part from
    the pairs on has a generator and seeds of its own.
    """
    generator = np.random.default_rng((seed, 1))
    sets = itertools.count(1000 * seed)

    def task(part: str, effects: tuple[str, ...], turn: int, visible: float | None = None) -> Task:
        noise = drawn_noise(generator)
        block = turn // len(BASE_CURVES) % 2
        operational = part == "nothing" and block == 1
        form = FORMS[(turn + block) % 2]
        base = BASE_CURVES[turn % len(BASE_CURVES)]
        return Task(part, effects, next(sets), base, operational, form, noise, visible)

    nulls = [task("nothing", (), turn) for turn in range(null)]
    power = [
        task("power", (name,), turn, visible)
        for name in FOLLOWED
        for visible in VISIBLE
        for turn in range(powers)
    ]
    confusion = [task("confusion", (name,), turn) for name in PLANTABLE for turn in range(powers)]
    return [
        *_half_slow(nulls, np.random.default_rng((seed, 3))),
        *power,
        *confusion,
        *_pair_tasks(pairs, seed),
        *random_tasks(random, np.random.default_rng((seed, 5)), 2_000_000 + 1000 * seed),
        *_log_tasks(logs, log_effects, seed),
    ]


def drawn_noise(generator: np.random.Generator) -> SetNoise:
    return SetNoise(
        float(generator.choice([0.005, 0.01, 0.02])),
        float(generator.choice(AUTOCORRELATIONS)),
        float(generator.choice([0.0, 0.005, 0.01])),
    )


def _half_slow(nulls: Sequence[Task], generator: np.random.Generator) -> list[Task]:
    fast = len(nulls) - len(nulls) // 2
    return [
        *nulls[:fast],
        *(
            task._replace(noise=task.noise._replace(autocorrelation=generator.uniform(*_SLOW)))
            for task in nulls[fast:]
        ),
    ]


def _pair_tasks(count: int, seed: int) -> list[Task]:
    """Two effects of different families at a time."""
    generator = np.random.default_rng((seed, 4))
    tasks = []
    for turn in range(count):
        while True:
            pair = tuple(str(name) for name in generator.choice(list(PLANTABLE), 2, replace=False))
            if len({family_of(name) for name in pair}) == 2:
                break
        base, form = BASE_CURVES[turn % len(BASE_CURVES)], FORMS[turn // len(BASE_CURVES) % 2]
        told = (base, False, form, drawn_noise(generator), None)
        tasks.append(Task("pair", pair, 1_000_000 + 1000 * seed + turn, *told))
    return tasks


def random_tasks(count: int, generator: np.random.Generator, first: int) -> list[Task]:
    """Level, slip scale and fall by turns, then one and two columns, then the base curves.

    Seeds count from `first`.
    """
    low, high = np.log(_RANDOM_VISIBLE)
    kinds = [(acts_on, columns) for columns in (1, 2) for acts_on in ACTS_ON]
    tasks = []
    for turn in range(count):
        effect = draw_random_effect(*kinds[turn % len(kinds)], generator)
        base = BASE_CURVES[(turn + turn // len(kinds)) % len(BASE_CURVES)]
        noise, visible = drawn_noise(generator), float(np.exp(generator.uniform(low, high)))
        told = (base, False, "exact", noise, visible, effect)
        tasks.append(Task("random", (), first + turn, *told))
    return tasks


def _log_tasks(null: int, planted: int, seed: int) -> list[Task]:
    """`null` logs of each kind with nothing hidden; `planted` of each effect, the kinds in turn.

    Logs differ by their seed alone, so that there is nothing to draw.
    """
    numbers = itertools.count(3_000_000 + 1000 * seed)

    def task(effects: tuple[str, ...], kind: tuple[Log, float]) -> Task:
        noise, number = SetNoise(0.008, kind[1], 0.0), next(numbers)
        told = ("burckhardt", True, "perturbed", noise, None, None, kind[0])
        return Task("log", effects, number, *told)

    return [
        *(task((), kind) for kind in LOGS for _ in range(null)),
        *(task((name,), LOGS[turn % len(LOGS)]) for name in LOG_FORMS for turn in range(planted)),
    ]


def make_set(task: Task) -> SimulatedSet:
    """The set of a task; where a visible misfit is wanted, the strength is sought for it.

    Where a random effect stays below the least visible misfit, the noise is reduced.
    """
    if task.log is not None:
        return one_log(
            task.effects,
            seed=task.seed,
            wheel_speed_noise=task.log.wheel_speed_noise,
            autocorrelation=task.noise.autocorrelation,
            sigma=task.noise.sigma,
            runs=task.log.runs,
            points=task.log.points,
        )

    def with_strength(strength: float | None, noise: SetNoise = task.noise) -> SimulatedSet:
        given: dict[str, Any] = {"seed": task.seed, "base": task.base, "noise": noise}
        if task.random is not None:
            return simulate_random(task.random, strength=strength, **given)
        forms = forms_of(task.form, task.effects)
        given |= {"operational": task.operational, "forms": forms}
        return simulate(task.effects, strength=strength, **given)

    if task.visible is None:
        return with_strength(None)
    strength = 0.1
    made = with_strength(strength)
    # The misfit is nearly proportional to the strength: two corrections come within a few per cent.
    for _ in range(2):
        strength = float(np.clip(strength * task.visible / made.visible, 1e-4, 1.0))
        made = with_strength(strength)
    if task.random is not None and made.visible < _LEAST_VISIBLE:
        quieter = task.noise.sigma * made.visible / _RANDOM_VISIBLE[0]
        return with_strength(strength, task.noise._replace(sigma=quieter))
    return made
