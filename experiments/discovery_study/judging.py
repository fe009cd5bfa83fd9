"""What a discovery makes of a set, and which of its names and columns stand for what is hidden."""

import time
import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from adhesion_jax.discovery.types import Findings, FoundEffect
from adhesion_jax.effects import EFFECTS
from adhesion_jax.library.discover import discover
from experiments.campaigns.simulator import SimulatedSet
from experiments.discovery_study.one_log import LOG_FORMS
from experiments.discovery_study.tasks import Task, make_set
from experiments.study import removed_share

#: What is studied: training table, test table or none, and seed to findings.
Discover = Callable[[pd.DataFrame, pd.DataFrame | None, int], Findings]

#: What counts as a planted effect: columns `seen_in`, and names that say the `same_as` it.
_RIGHT: Mapping[str, Mapping[str, Sequence[str]]] = tomllib.loads(
    (Path(__file__).parent / "right_names.toml").read_text(encoding="utf-8")
)


def seen_in(name: str) -> tuple[str, ...]:
    """The columns of an effect; of one that was added later those that its claim rests on."""
    seen = _RIGHT["seen_in"]
    return (*seen[name],) if name in seen else EFFECTS[name].FACTS.rests_on


def names_for(name: str) -> tuple[str, ...]:
    """All names that count as a planted effect, its own first.

    A name that ends in a colon counts for every name that begins with it.
    """
    return (name, *(EFFECTS[name].FACTS.same_as if name in EFFECTS else _RIGHT["same_as"][name]))


#: Of a class of more names than this only the first one counts.
_LARGEST_CLASS = 4


def is_one_of(name: str, right: Sequence[str]) -> bool:
    """Whether a reported name is among the right ones."""
    return any(name == one or (one.endswith(":") and name.startswith(one)) for one in right)


def counted(claim: FoundEffect) -> tuple[str, ...]:
    """The names of a reported class that count: all, or of a large class the first alone."""
    names = tuple(dict.fromkeys((claim.name, *claim.candidates)))
    return names if len(names) <= _LARGEST_CLASS else names[:1]


def columns_of(name: str) -> tuple[str, ...]:
    """The columns that a reported name blames."""
    kind, colon, columns = name.partition(":")
    if colon:
        return tuple(columns.replace(",", "*").split("*"))
    return seen_in(kind)[:1] if kind in EFFECTS else ()


def blamed(claim: FoundEffect, names: Sequence[str]) -> frozenset[str]:
    """The columns that a claim blames, by what it rests on and by these names of its class."""
    return frozenset(claim.covariates).union(*(columns_of(name) for name in names))


class Hidden(NamedTuple):
    """One hidden effect, or one column of a random effect, by what names it."""

    names: tuple[str, ...]  # that the discovery may give; none where its columns are what counts
    columns: tuple[str, ...]  # that a method may give; of features made by hand the beginning
    also_right: tuple[str, ...] = ()  # in a claim, not in a doubt

    def is_named_by(self, claim: FoundEffect, names: Sequence[str]) -> bool:
        """Whether a claim by these names of its class stands for it."""
        if self.names:
            return any(is_one_of(name, (*self.names, *self.also_right)) for name in names)
        return not blamed(claim, names).isdisjoint(self.columns)

    def is_doubted(self, findings: Findings) -> bool:
        right = self.names or self.columns
        return any(is_one_of(name, right) for doubt in findings.doubts for name in doubt.names)

    @property
    def is_offset(self) -> bool:
        """Whether a doubt about the shape of the curve counts as naming it."""
        own = EFFECTS.get(next(iter(self.names), ""))
        return own is not None and own.FACTS.of_slip_alone


def hidden_in(task: Task) -> tuple[Hidden, ...]:
    if task.random is not None:
        return tuple(Hidden((), (column,)) for column in task.random.columns)
    of_log = {name: form.also_right for name, form in LOG_FORMS.items() if task.log}
    return tuple(
        Hidden(names_for(name), seen_in(name), of_log.get(name, ())) for name in task.effects
    )


def discovered(train: pd.DataFrame, test: pd.DataFrame | None, seed: int) -> Findings:
    """The findings that a user gets from these tables; reading them is included."""
    return discover(train, test, seed=seed).findings


def row(discover: Discover, task: Task) -> dict[str, object]:
    """What was planted in a set, what was reported, the errors and the time it took."""
    made = make_set(task)
    began, cpu_began = time.perf_counter(), time.process_time()
    findings = discover(made.train, made.test, task.seed)
    seconds, cpu_seconds = time.perf_counter() - began, time.process_time() - cpu_began
    form = task.form
    if task.log is not None:
        form = f"{task.log.runs} x {task.log.points}, {task.log.wheel_speed_noise:g} m/s"
        form += f", r = {task.noise.autocorrelation:g}"
    return {
        "part": task.part,
        "planted": task.planted,
        "seed": task.seed,
        "base": made.base,
        "design": "operational" if task.operational else "designed",
        "form": form,
        **made.noise._asdict(),
        "wanted": np.nan if task.visible is None else task.visible,
        "visible": made.visible,
        "acts_on": "" if task.random is None else task.random.acts_on,
        "rests_on": "" if task.random is None else "*".join(task.random.columns),
        **judged(task, made, findings),
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
    }


def judged(task: Task, made: SimulatedSet, findings: Findings) -> dict[str, object]:
    reported = (*findings.effects, *findings.unexplained)
    claims = list(reported)
    if task.log is not None:
        # The slip of a wheel speed is noisy: this claim is right, but names no planted effect.
        claims = [claim for claim in claims if "slip_noise" not in counted(claim)]
    hidden = hidden_in(task)
    # [hidden, claims]
    names = [[one.is_named_by(claim, counted(claim)) for claim in claims] for one in hidden]
    named = [
        any(hits) or (one.is_offset and one.is_doubted(findings))
        for one, hits in zip(hidden, names, strict=True)
    ]
    before, after = (
        (findings.test.before.value, findings.test.after.value)
        if findings.test is not None
        else (np.nan, np.nan)
    )
    # Noise of the slip is part of every prediction error of a log, and no law removes it.
    noisy_slip = task.log is not None and task.log.wheel_speed_noise > 0
    return {
        "chosen_base": findings.base,
        "claims": len(claims),
        "first": claims[0].name if claims else "nothing",
        "reported": "|".join(claim.name for claim in reported),
        "doubts": "|".join(name for doubt in findings.doubts for name in doubt.names),
        "reported_acts_on": "|".join(claim.acts_on for claim in reported),
        "detected": bool(claims),
        "first_right": any(
            one.is_named_by(claim, [claim.name]) for one in hidden for claim in claims[:1]
        ),
        "in_class": any(named),
        "doubted": any(one.is_doubted(findings) for one in hidden),
        "all_named": bool(named) and all(named),
        "extra": any(not any(hits[place] for hits in names) for place in range(len(claims))),
        "class_size": float(np.mean([len(counted(claim)) for claim in claims]))
        if claims
        else np.nan,
        "before": before,
        "after": after,
        "removed": np.nan if noisy_slip else removed_share(before, after, made.test_rms_noise),
        "worse": bool(after > before),
    }
