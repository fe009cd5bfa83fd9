"""Whether reported names and columns are right: which of them stand for the planted effects."""

import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from adhesion_jax.discovery.types import Findings, FoundEffect
from adhesion_jax.effects import EFFECTS
from experiments.campaigns.simulator import SimulatedSet
from experiments.discovery_study.one_log import LOG_FORMS
from experiments.discovery_study.tasks import Task

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


def judged(task: Task, made: SimulatedSet, findings: Findings) -> dict[str, object]:
    reported = (*findings.effects, *findings.unexplained)
    claims = list(reported)
    if task.log is not None:
        # The slip of a wheel speed is noisy: this claim is right, but names no planted effect.
        claims = [claim for claim in claims if "slip_noise" not in counted(claim)]
    hidden = task.effects if task.random is None else task.random.columns
    # [hidden, claims]
    names = [[_stands_for(task, one, claim, counted(claim)) for claim in claims] for one in hidden]
    named = [
        any(hits) or (_is_offset(one) and _is_doubted(task, one, findings))
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
        "first_right": bool(claims)
        and any(_stands_for(task, one, claims[0], [claims[0].name]) for one in hidden),
        "in_class": any(named),
        "doubted": any(_is_doubted(task, one, findings) for one in hidden),
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


def _stands_for(task: Task, hidden: str, claim: FoundEffect, names: Sequence[str]) -> bool:
    """Whether a claim by these names stands for a planted effect, or column of a random one."""
    if task.random is not None:
        return hidden in blamed(claim, names)
    right = (*names_for(hidden), *(LOG_FORMS[hidden].also_right if task.log else ()))
    return any(is_one_of(name, right) for name in names)


def _is_offset(effect: str) -> bool:
    """Whether a doubt about the shape of the curve counts as naming the planted effect."""
    return effect in EFFECTS and EFFECTS[effect].FACTS.of_slip_alone


def _is_doubted(task: Task, hidden: str, findings: Findings) -> bool:
    """Whether a doubt names what was planted, or the column of a random effect."""
    right = (hidden,) if task.random is not None else names_for(hidden)
    return any(is_one_of(name, right) for doubt in findings.doubts for name in doubt.names)


def removed_share(before: float, after: float, noise: float) -> float:
    """(before^2 - after^2)/(before^2 - noise^2) of root mean square errors; NaN without excess."""
    excess = before**2 - noise**2
    # If the excess over the noise is below two per cent, its share is due to chance.
    return (before**2 - after**2) / excess if excess > 0.02 * noise**2 else np.nan
