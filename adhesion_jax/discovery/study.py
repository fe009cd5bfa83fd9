"""How often a discovery is right, over simulated sets.

Parts: nothing hidden, power over strength, confusion of effects, two at once (pair), random effects
that no catalogue has, and logs of a locomotive.
"""

import itertools
import multiprocessing
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing.queues import Queue
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import beta

from adhesion_jax.discovery.effects import EFFECTS
from adhesion_jax.discovery.findings import Findings, FoundEffect
from adhesion_jax.discovery.library import FAMILIES as EFFECT_FAMILIES
from adhesion_jax.discovery.planted import BEYOND, PLANTABLE
from adhesion_jax.discovery.simulated_runs import FAMILIES
from adhesion_jax.discovery.simulator import FORMS, Campaign, Noise, simulate
from adhesion_jax.runtime import compilation_folder, cores_for, share_compilations, take_core
from adhesion_jax.simulation.one_log import one_log
from adhesion_jax.simulation.random_effect import ACTS_ON, RandomEffect, draw_random_effect

#: Effects whose detection is followed over their strength: one or two of each kind.
FOLLOWED = (
    *("humidity", "temperature", "load_peak", "patch", "curve"),
    *("falling_friction", "lag", "hysteresis", "slip_noise"),
)

#: Visible misfit, in standard deviations of the noise, at which detection is measured.
VISIBLE = (0.1, 0.2, 0.35, 0.5, 1.0, 2.0)

#: Answers that are as right as the name itself: the covariate or axis by another word, or what no
#: data can tell from it.
_RIGHT = {
    "speed": ("covariate:vehicle_speed_mps",),
    "slip_speed": ("covariate:slip_velocity_mps",),
    "falling_friction": ("covariate:slip_velocity_mps",),
    "contact_heating": ("covariate:slip_velocity_mps",),
    "load_peak": ("covariate:normal_load_N",),
    "load_slope": ("covariate:normal_load_N",),
    "humidity": ("covariate:relative_humidity_pct",),
    "temperature": ("covariate:temperature_C",),
    "patch": ("covariate:position_m",),
    "sanding": ("covariate:sanding",),
    "axle_position": ("covariate:axle",),
    "curve": ("covariate:curvature_per_m",),
    "lateral_creep": ("covariate:angle_of_attack_deg",),
    "load_transfer": ("covariate:acceleration_mps2",),
    "mode_asymmetry": ("covariate:mode",),
    "slip_bias": ("torque_offset",),
    "torque_offset": ("slip_bias",),
    "wheel_order": ("periodic:wheel_angle_rad",),
    "rail_joint": ("periodic:position_m",),
    "drift": ("covariate:time_s", "covariate:campaign_time"),
    "torsion": ("periodic:time_s",),
    "unknown_column": ("covariate:rail_age_days",),
    "product": ("product:",),
    "periodic": ("periodic:groove_depth_um", "covariate:groove_depth_um"),
}

#: What is as right besides in a log, where the weather only drifts and speed hardly varies.
_RIGHT_IN_LOGS = {
    "humidity": ("drift", "covariate:time_s", "covariate:campaign_time"),
    "falling_friction": ("slip_speed", "contact_heating", "speed"),
}

#: Offsets of the signals: on these a doubt about the shape of the curve is an answer.
_OFFSETS = ("slip_bias", "torque_offset")

#: A class of more names than this counts by its first.
_LARGEST_CLASS = 4

#: The columns that a name of the catalogue blames, where a random effect rests on one of them.
_COLUMNS_OF = {
    "humidity": ("relative_humidity_pct",),
    "temperature": ("temperature_C",),
    **dict.fromkeys(("load_peak", "load_slope"), ("normal_load_N",)),
    **dict.fromkeys(
        ("speed", "slip_speed", "falling_friction", "contact_heating"), ("vehicle_speed_mps",)
    ),
    **dict.fromkeys(("patch", "rail_joint"), ("position_m",)),
    **dict.fromkeys(("curve", "lateral_creep"), ("curvature_per_m",)),
    "drift": ("rail_age_days", "time_s"),
}

#: Autocorrelations that the noise of a set is drawn from; those of slow nulls lie between these.
_AUTOCORRELATIONS = (0.0, 0.3, 0.6)
_SLOW = (0.3, 0.95)

#: Visible misfits that random effects are given, in sigma, and the least that counts.
_RANDOM_VISIBLE = (0.55, 3.0)
_LEAST_VISIBLE = 0.5

#: Of the removable squared error: removed as well as none, and missed.
REMOVED, MISSED = 0.9, 0.1


#: What is studied: training table, test table or none, and seed to findings.
Discover = Callable[[pd.DataFrame, pd.DataFrame | None, int], Findings]


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

#: Effects that are planted in logs.
LOG_EFFECTS = ("humidity", "sanding", "falling_friction")


class Task(NamedTuple):
    """One set of a study."""

    part: str  # nothing, power, confusion, pair, random or log
    effects: tuple[str, ...]
    seed: int
    base: str
    operational: bool
    form: str
    noise: Noise
    visible: float | None  # wanted, in sigma; None for the strength of the simulator's choice
    random: RandomEffect | None = None
    log: Log | None = None


class Rate(NamedTuple):
    """A share of sets and its 95 % Clopper-Pearson interval."""

    value: float
    low: float
    high: float


def clopper_pearson(hits: int, count: int) -> Rate:
    """The exact binomial interval, from the quantiles of the beta distribution."""
    if count == 0:
        return Rate(np.nan, np.nan, np.nan)
    low = float(beta.ppf(0.025, hits, count - hits + 1)) if hits else 0.0
    high = float(beta.ppf(0.975, hits + 1, count - hits)) if hits < count else 1.0
    return Rate(hits / count, low, high)


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
    hidden, and of each effect of LOG_EFFECTS `log_effects`.

    Base curves take turns, and so do designed and operational nulls; noise settings are drawn, and
    the second half of the nulls has its autocorrelation drawn anew from .3 to .95. Effects are
    planted in designed sets, in the catalogue's form and in another one by turns. Every part from
    the pairs on has a generator and seeds of its own.
    """
    generator = np.random.default_rng((seed, 1))
    sets = itertools.count(1000 * seed)

    def task(part: str, effects: tuple[str, ...], turn: int, visible: float | None = None) -> Task:
        noise = _drawn_noise(generator)
        block = turn // len(FAMILIES) % 2
        operational = part == "nothing" and block == 1
        form = FORMS[(turn + block) % 2]
        base = FAMILIES[turn % len(FAMILIES)]
        return Task(part, effects, next(sets), base, operational, form, noise, visible)

    nulls = [task("nothing", (), turn) for turn in range(null)]
    power = [
        task("power", (name,), turn, visible)
        for name in FOLLOWED
        for visible in VISIBLE
        for turn in range(powers)
    ]
    confusion = [
        task("confusion", (name,), turn) for name in (*EFFECTS, *BEYOND) for turn in range(powers)
    ]
    return [
        *_half_slow(nulls, np.random.default_rng((seed, 3))),
        *power,
        *confusion,
        *_pair_tasks(pairs, seed),
        *random_tasks(random, np.random.default_rng((seed, 5)), 2_000_000 + 1000 * seed),
        *_log_tasks(logs, log_effects, seed),
    ]


def _drawn_noise(generator: np.random.Generator) -> Noise:
    return Noise(
        float(generator.choice([0.005, 0.01, 0.02])),
        float(generator.choice(_AUTOCORRELATIONS)),
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
            pair = tuple(str(name) for name in generator.choice(PLANTABLE, 2, replace=False))
            if len({EFFECT_FAMILIES.get(name, name) for name in pair}) == 2:
                break
        base, form = FAMILIES[turn % len(FAMILIES)], FORMS[turn // len(FAMILIES) % 2]
        number = 1_000_000 + 1000 * seed + turn
        tasks.append(
            Task("pair", pair, number, base, False, form, _drawn_noise(generator), visible=None)
        )
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
        tasks.append(
            Task(
                part="random",
                effects=(),
                seed=first + turn,
                base=FAMILIES[(turn + turn // len(kinds)) % len(FAMILIES)],
                operational=False,
                form="exact",
                noise=_drawn_noise(generator),
                visible=float(np.exp(generator.uniform(low, high))),
                random=effect,
            )
        )
    return tasks


def _log_tasks(null: int, planted: int, seed: int) -> list[Task]:
    """Of each kind of log so many with nothing hidden; of each effect so many, the kinds by turns.

    Logs differ by their seed alone, so that there is nothing to draw.
    """
    numbers = itertools.count(3_000_000 + 1000 * seed)

    def task(effects: tuple[str, ...], kind: tuple[Log, float]) -> Task:
        log, slow = kind
        noise = Noise(0.008, slow, 0.0)
        return Task(
            "log", effects, next(numbers), "burckhardt", True, "perturbed", noise, None, log=log
        )

    return [
        *(task((), kind) for kind in LOGS for _ in range(null)),
        *(task((name,), LOGS[turn % len(LOGS)]) for name in LOG_EFFECTS for turn in range(planted)),
    ]


def run_study(
    tasks: Sequence[Task],
    discover: Discover,
    progress: Callable[[str], None],
    workers: int = 1,
) -> pd.DataFrame:
    """One row a set: what was planted, what was reported, the errors and the time it took.

    With more than one worker in so many processes, which must be able to import `discover`; but
    for the times the rows are the same, in the order of the tasks.
    """
    rows = []
    with _mapped(tasks, discover, workers) as results:
        for task, row in zip(tasks, results, strict=True):
            rows.append(row)
            progress(task.part)
    return pd.DataFrame(rows)


@contextmanager
def _mapped(
    tasks: Sequence[Task], discover: Discover, workers: int
) -> Iterator[Iterator[dict[str, object]]]:
    """The rows in the order of the tasks, from processes that share what they compile.

    Spawned, because a fork of a process in which jax runs is not safe.
    """
    of_task = partial(_row, discover)
    if workers == 1:
        yield map(of_task, tasks)
        return
    spawning = multiprocessing.get_context("spawn")
    cores = cores_for(workers, spawning)
    with (
        compilation_folder() as folder,
        ProcessPoolExecutor(
            workers, mp_context=spawning, initializer=_start, initargs=(folder, cores)
        ) as pool,
    ):
        try:
            yield pool.map(of_task, tasks)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _start(folder: str, cores: Queue) -> None:
    take_core(cores)
    share_compilations(folder)


def right_names(effect: str) -> tuple[str, ...]:
    """Names that stand for a planted effect; one with a colon at its end for all it begins."""
    return (effect, *_RIGHT.get(effect, ()))


def is_one_of(name: str, right: Sequence[str]) -> bool:
    """Whether a reported name is among the right ones."""
    return any(name == one or (one.endswith(":") and name.startswith(one)) for one in right)


def is_right(effect: str, name: str) -> bool:
    """Whether a reported name stands for a planted effect."""
    return is_one_of(name, right_names(effect))


def counted(claim: FoundEffect) -> tuple[str, ...]:
    """The names of a reported class that count: all, or of a large class the first alone."""
    names = tuple(dict.fromkeys((claim.name, *claim.candidates)))
    return names if len(names) <= _LARGEST_CLASS else names[:1]


def columns_of(name: str) -> tuple[str, ...]:
    """The columns that a reported name blames."""
    kind, colon, columns = name.partition(":")
    if colon:
        return tuple(columns.replace(",", "*").split("*"))
    return _COLUMNS_OF.get(kind, ())


def blamed(claim: FoundEffect, names: Sequence[str]) -> frozenset[str]:
    """The columns that a claim blames, by what it rests on and by these names of its class."""
    return frozenset(claim.covariates).union(*(columns_of(name) for name in names))


class _Hits(NamedTuple):
    """Which sets of a group have a quantity."""

    part: str
    group: str
    visible: float  # wanted, in sigma; NaN where none was
    quantity: str
    hits: pd.Series


def rates(sets: pd.DataFrame) -> pd.DataFrame:
    """Shares with their intervals: part, group, visible, quantity, count, hits, rate, low, high."""
    rows = []
    for of_part in (_null_hits, _strength_hits, _pair_hits, _random_hits, _log_hits):
        for *names, hits in of_part(sets):
            count = len(hits), int(hits.sum())
            rows.append((*names, *count, *clopper_pearson(count[1], count[0])))
    columns = [*_Hits._fields[:-1], "count", "hits", "rate", "low", "high"]
    return pd.DataFrame(rows, columns=columns)


def _null_hits(sets: pd.DataFrame) -> Iterator[_Hits]:
    nulls = sets[sets["part"] == "nothing"]
    if not len(nulls):
        return
    claimed = nulls["claims"] > 0
    yield _Hits("nothing", "all", np.nan, "claimed", claimed)
    slow = ~nulls["autocorrelation"].isin(_AUTOCORRELATIONS)
    groups = nulls.assign(autocorrelation=nulls["autocorrelation"].astype(str).mask(slow, "slow"))
    for by in ("base", "design", "autocorrelation", "run_scatter"):
        for value in sorted(set(groups[by])):
            own = claimed[groups[by] == value]
            yield _Hits("nothing", f"{by} {value}", np.nan, "claimed", own)


def _strength_hits(sets: pd.DataFrame) -> Iterator[_Hits]:
    for part in ("power", "confusion"):
        # An effect that cannot become as visible as was wanted says nothing of that strength.
        reached = ~(sets["visible"] < 0.8 * sets["wanted"])
        chosen = sets[(sets["part"] == part) & reached]
        keys = chosen["wanted"].fillna(-1.0)
        for name in dict.fromkeys(chosen["planted"]):
            for level in sorted(set(keys[chosen["planted"] == name])):
                same = chosen[(chosen["planted"] == name) & (keys == level)]
                shown = float(level) if level >= 0 else np.nan
                for quantity in ("detected", "first_right", "in_class", "extra"):
                    yield _Hits(part, str(name), shown, quantity, same[quantity])


def _pair_hits(sets: pd.DataFrame) -> Iterator[_Hits]:
    pairs = sets[sets["part"] == "pair"]
    if not len(pairs):
        return
    for quantity, column in (("both_named", "all_named"), ("one_named", "in_class")):
        yield _Hits("pair", "all", np.nan, quantity, pairs[column])
    yield _Hits("pair", "all", np.nan, "extra", pairs["extra"])


def _random_hits(sets: pd.DataFrame) -> Iterator[_Hits]:
    for group, same in random_groups(sets).items():
        removed = same["removed"].dropna()
        for quantity, hits in {
            **{name: same[name] for name in ("detected", "all_named", "in_class", "extra")},
            "removed_90": removed >= REMOVED,
            "missed": removed < MISSED,
        }.items():
            yield _Hits("random", group, np.nan, quantity, hits)


def _log_hits(sets: pd.DataFrame) -> Iterator[_Hits]:
    """Nothing hidden by the kind of log; each effect over all kinds."""
    logs = sets[sets["part"] == "log"]
    null = logs["planted"] == "nothing"
    for kind, same in logs[null].groupby("form", sort=False):
        yield _Hits("log", f"nothing: {kind}", np.nan, "claimed", same["detected"])
    for planted, same in logs[~null].groupby("planted", sort=False):
        for quantity, column in (("named", "all_named"), ("extra", "extra")):
            yield _Hits("log", str(planted), np.nan, quantity, same[column])


def random_groups(sets: pd.DataFrame) -> Mapping[str, pd.DataFrame]:
    """The sets with a random effect: all, by what it acts on, by the number of its columns."""
    chosen = sets[sets["part"] == "random"]
    if not len(chosen):
        return {}
    several = chosen["rests_on"].str.contains("*", regex=False)
    return {
        "all": chosen,
        **{name: chosen[chosen["acts_on"] == name] for name in ACTS_ON},
        "one column": chosen[~several],
        "two columns": chosen[several],
    }


def shares(sets: pd.DataFrame) -> pd.DataFrame:
    """Of each group of random effects the share of the removable squared error: its quantiles."""
    return pd.DataFrame(
        [
            {
                "group": group,
                "sets": int(same["removed"].notna().sum()),
                "median": same["removed"].median(),
                "lower_quartile": same["removed"].quantile(0.25),
                "lowest_decile": same["removed"].quantile(0.1),
            }
            for group, same in random_groups(sets).items()
        ]
    )


def confusion(sets: pd.DataFrame) -> pd.DataFrame:
    """Counts of sets: planted effect (rows) by the first name that was reported (columns)."""
    chosen = sets[sets["part"] == "confusion"]
    counts = pd.crosstab(chosen["planted"], chosen["first"])
    rows = [name for name in (*EFFECTS, *BEYOND) if name in counts.index]
    others = sorted(name for name in counts.columns if name not in rows and name != "nothing")
    columns = [name for name in (*rows, *others, "nothing") if name in {*counts, *rows, "nothing"}]
    return counts.reindex(index=rows, columns=columns, fill_value=0)


def make_set(task: Task) -> Campaign:
    """The campaign of a task; where a visible misfit is wanted, the strength is sought for it.

    A random effect that cannot be seen enough in the noise has so much less of it.
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

    def with_strength(strength: float | None, noise: Noise = task.noise) -> Campaign:
        return simulate(
            task.effects,
            seed=task.seed,
            base=task.base,
            operational=task.operational,
            strength=strength,
            form=task.form,
            noise=noise,
            random=task.random,
        )

    if task.visible is None:
        return with_strength(None)
    strength = 0.1
    campaign = with_strength(strength)
    # The misfit grows about as the strength does: two corrections come within a few per cent.
    for _ in range(2):
        strength = float(np.clip(strength * task.visible / campaign.visible, 1e-4, 1.0))
        campaign = with_strength(strength)
    if task.random is not None and campaign.visible < _LEAST_VISIBLE:
        quieter = task.noise.sigma * campaign.visible / _RANDOM_VISIBLE[0]
        return with_strength(strength, task.noise._replace(sigma=quieter))
    return campaign


def _row(discover: Discover, task: Task) -> dict[str, object]:
    campaign = make_set(task)
    began, cpu_began = time.perf_counter(), time.process_time()
    findings = discover(campaign.train, campaign.test, task.seed)
    seconds, cpu_seconds = time.perf_counter() - began, time.process_time() - cpu_began
    return {
        **_described(task, campaign),
        **_judged(task, campaign, findings),
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
    }


def _described(task: Task, campaign: Campaign) -> dict[str, object]:
    planted, acts_on, rests_on, form = "+".join(task.effects) or "nothing", "", "", task.form
    if task.random is not None:
        acts_on, rests_on = task.random.acts_on, "*".join(task.random.columns)
        planted = f"{acts_on} by {rests_on}"
    if task.log is not None:
        form = f"{task.log.runs} x {task.log.points}, {task.log.wheel_speed_noise:g} m/s"
        form += f", r = {task.noise.autocorrelation:g}"
    return {
        "part": task.part,
        "planted": planted,
        "seed": task.seed,
        "base": campaign.base,
        "design": "operational" if task.operational else "designed",
        "form": form,
        **campaign.noise._asdict(),
        "wanted": np.nan if task.visible is None else task.visible,
        "visible": campaign.visible,
        "acts_on": acts_on,
        "rests_on": rests_on,
    }


def _judged(task: Task, campaign: Campaign, findings: Findings) -> dict[str, object]:
    reported = (*findings.effects, *findings.unexplained)
    claims = list(reported)
    if task.log is not None:
        # The slip of a wheel speed is noisy: to say so is right, and no answer to what is hidden.
        claims = [claim for claim in claims if "slip_noise" not in counted(claim)]
    hidden = task.effects if task.random is None else task.random.columns
    # [hidden, claims]
    names = [[_stands_for(task, one, claim, counted(claim)) for claim in claims] for one in hidden]
    named = [
        any(hits) or _is_doubted(one, findings) for one, hits in zip(hidden, names, strict=True)
    ]
    before, after = (
        (findings.test.before.value, findings.test.after.value)
        if findings.test is not None
        else (np.nan, np.nan)
    )
    # Noise of the slip is in every prediction of a log, and no law removes it.
    noisy_slip = task.log is not None and task.log.wheel_speed_noise > 0
    return {
        "chosen_base": findings.base,
        "claims": len(claims),
        "first": claims[0].name if claims else "nothing",
        "reported": "|".join(claim.name for claim in reported),
        "reported_acts_on": "|".join(claim.acts_on for claim in reported),
        "detected": bool(claims),
        "first_right": bool(claims)
        and any(_stands_for(task, one, claims[0], [claims[0].name]) for one in hidden),
        "in_class": any(named),
        "all_named": bool(named) and all(named),
        "extra": any(not any(hits[place] for hits in names) for place in range(len(claims))),
        "class_size": float(np.mean([len(counted(claim)) for claim in claims]))
        if claims
        else np.nan,
        "before": before,
        "after": after,
        "removed": np.nan if noisy_slip else removed_share(before, after, campaign.test_rms_noise),
        "worse": bool(after > before),
    }


def _stands_for(task: Task, hidden: str, claim: FoundEffect, names: Sequence[str]) -> bool:
    """Whether a claim by these names stands for a planted effect, or column of a random one."""
    if task.random is not None:
        return hidden in blamed(claim, names)
    right = (*right_names(hidden), *(_RIGHT_IN_LOGS.get(hidden, ()) if task.log else ()))
    return any(is_one_of(name, right) for name in names)


def _is_doubted(effect: str, findings: Findings) -> bool:
    """Whether a doubt about the shape of the curve names a planted offset."""
    return effect in _OFFSETS and any(
        is_right(effect, name) for doubt in findings.doubts for name in doubt.names
    )


def removed_share(before: float, after: float, noise: float) -> float:
    """(before^2 - after^2)/(before^2 - noise^2) of root mean square errors; NaN without excess."""
    excess = before**2 - noise**2
    # With less than two per cent of excess over the noise its share is all chance.
    return (before**2 - after**2) / excess if excess > 0.02 * noise**2 else np.nan
