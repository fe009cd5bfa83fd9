"""How often a discovery is right: nulls, strengths and a confusion matrix over simulated sets."""

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import beta

from adhesion_jax.discovery.effects import EFFECTS
from adhesion_jax.discovery.findings import Findings
from adhesion_jax.discovery.planted import BEYOND
from adhesion_jax.discovery.simulated_runs import FAMILIES
from adhesion_jax.discovery.simulator import FORMS, Campaign, Noise, simulate

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


#: What is studied: training table, test table or none, and seed to findings.
Discover = Callable[[pd.DataFrame, pd.DataFrame | None, int], Findings]


class Task(NamedTuple):
    """One set of a study."""

    part: str  # nothing, power or confusion
    effects: tuple[str, ...]
    seed: int
    base: str
    operational: bool
    form: str
    noise: Noise
    visible: float | None  # wanted, in sigma; None for the strength of the simulator's choice


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


def study_tasks(null: int, powers: int, seed: int) -> list[Task]:
    """Null sets, then `powers` sets of each effect and strength, then as many of every effect.

    Base curves take turns, and so do designed and operational nulls; noise settings are drawn.
    Effects are planted in designed sets, in the catalogue's form and in another one by turns.
    """
    generator = np.random.default_rng((seed, 1))
    sets = itertools.count(1000 * seed)

    def task(part: str, effects: tuple[str, ...], turn: int, visible: float | None = None) -> Task:
        noise = Noise(
            float(generator.choice([0.005, 0.01, 0.02])),
            float(generator.choice([0.0, 0.3, 0.6])),
            float(generator.choice([0.0, 0.005, 0.01])),
        )
        base = FAMILIES[turn % len(FAMILIES)]
        block = turn // len(FAMILIES) % 2
        operational = part == "nothing" and block == 1
        form = FORMS[(turn + block) % 2]
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
    return [*nulls, *power, *confusion]


def run_study(
    tasks: Sequence[Task], discover: Discover, progress: Callable[[str], None]
) -> pd.DataFrame:
    """One row a set: what was planted, what was reported, the errors and the time it took."""
    return pd.DataFrame(list(_rows(tasks, discover, progress)))


def is_right(effect: str, name: str) -> bool:
    """Whether a reported name stands for a planted effect."""
    words = _RIGHT.get(effect, ())
    return name == effect or name in words or (effect == "product" and name.startswith("product:"))


def rates(sets: pd.DataFrame) -> pd.DataFrame:
    """Shares with their intervals: part, group, visible, quantity, count, hits, rate, low, high."""
    rows: list[dict[str, object]] = []

    def add(part: str, group: str, wanted: float, quantity: str, hits: pd.Series) -> None:
        rate = clopper_pearson(int(hits.sum()), len(hits))
        rows.append(
            {
                "part": part,
                "group": group,
                "visible": wanted,
                "quantity": quantity,
                "count": len(hits),
                "hits": int(hits.sum()),
                "rate": rate.value,
                "low": rate.low,
                "high": rate.high,
            }
        )

    nulls = sets[sets["part"] == "nothing"]
    if len(nulls):
        claimed = nulls["claims"] > 0
        add("nothing", "all", np.nan, "claimed", claimed)
        for by in ("base", "design", "autocorrelation", "run_scatter"):
            for value in sorted(set(nulls[by])):
                add("nothing", f"{by} {value}", np.nan, "claimed", claimed[nulls[by] == value])
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
                    add(part, str(name), shown, quantity, same[quantity])
    return pd.DataFrame(rows)


def confusion(sets: pd.DataFrame) -> pd.DataFrame:
    """Counts of sets: planted effect (rows) by the first name that was reported (columns)."""
    chosen = sets[sets["part"] == "confusion"]
    counts = pd.crosstab(chosen["planted"], chosen["first"])
    rows = [name for name in (*EFFECTS, *BEYOND) if name in counts.index]
    others = sorted(name for name in counts.columns if name not in rows and name != "nothing")
    columns = [name for name in (*rows, *others, "nothing") if name in {*counts, *rows, "nothing"}]
    return counts.reindex(index=rows, columns=columns, fill_value=0)


def make_set(task: Task) -> Campaign:
    """The campaign of a task; where a visible misfit is wanted, the strength is sought for it."""

    def with_strength(strength: float | None) -> Campaign:
        return simulate(
            task.effects,
            seed=task.seed,
            base=task.base,
            operational=task.operational,
            strength=strength,
            form=task.form,
            noise=task.noise,
        )

    if task.visible is None:
        return with_strength(None)
    strength = 0.1
    campaign = with_strength(strength)
    # The misfit grows about as the strength does: two corrections come within a few per cent.
    for _ in range(2):
        strength = float(np.clip(strength * task.visible / campaign.visible, 1e-4, 1.0))
        campaign = with_strength(strength)
    return campaign


def _rows(
    tasks: Sequence[Task], discover: Discover, progress: Callable[[str], None]
) -> Iterator[dict[str, object]]:
    for task in tasks:
        campaign = make_set(task)
        began = time.perf_counter()
        findings = discover(campaign.train, campaign.test, task.seed)
        seconds = time.perf_counter() - began
        yield {
            **_described(task, campaign),
            **_judged(task, campaign, findings),
            "seconds": seconds,
        }
        progress(task.part)


def _described(task: Task, campaign: Campaign) -> dict[str, object]:
    return {
        "part": task.part,
        "planted": "+".join(task.effects) or "nothing",
        "seed": task.seed,
        "base": campaign.base,
        "design": "operational" if task.operational else "designed",
        "form": task.form,
        **campaign.noise._asdict(),
        "wanted": np.nan if task.visible is None else task.visible,
        "visible": campaign.visible,
    }


def _judged(task: Task, campaign: Campaign, findings: Findings) -> dict[str, object]:
    claims = [*findings.effects, *findings.unexplained]
    classes = [(claim.name, *claim.candidates) for claim in claims]

    def stands_for(names: Sequence[str]) -> bool:
        return any(is_right(effect, name) for effect in task.effects for name in names)

    before, after = (
        (findings.test.before.value, findings.test.after.value)
        if findings.test is not None
        else (np.nan, np.nan)
    )
    return {
        "chosen_base": findings.base,
        "claims": len(claims),
        "first": claims[0].name if claims else "nothing",
        "reported": "|".join(claim.name for claim in claims),
        "detected": bool(claims),
        "first_right": bool(claims) and stands_for([claims[0].name]),
        "in_class": any(stands_for(names) for names in classes),
        "extra": any(not stands_for(names) for names in classes),
        "class_size": float(np.mean([len(set(names)) for names in classes])) if claims else np.nan,
        "before": before,
        "after": after,
        "removed": removed_share(before, after, campaign.test_rms_noise),
        "worse": bool(after > before),
    }


def removed_share(before: float, after: float, noise: float) -> float:
    """(before^2 - after^2)/(before^2 - noise^2) of root mean square errors; NaN without excess."""
    excess = before**2 - noise**2
    # With less than two per cent of excess over the noise its share is all chance.
    return (before**2 - after**2) / excess if excess > 0.02 * noise**2 else np.nan
