"""The sets on which the discovery and its peers are compared."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from adhesion_jax.errors import InputError
from experiments.campaigns.plantable import PLANTABLE
from experiments.campaigns.runs import BASE_CURVES
from experiments.discovery_study.judging import Hidden, columns_of, hidden_in, seen_in
from experiments.discovery_study.otherwise import FORMS
from experiments.discovery_study.tasks import Task, drawn_noise, make_set, random_tasks

#: What is planted in the simulated sets, in turn; a third of them have nothing hidden.
PLANTED: Sequence[tuple[str, ...]] = (
    *(("humidity",), (), ("patch",), ("lag",), ()),
    *(("temperature", "sanding"), ("cleaning",), (), ("load_peak",), ("product",), ()),
    *(("hysteresis",), ("unknown_column",), (), ("rail_joint",), ("falling_friction",), ()),
    *(("curve", "temperature"), ("relaxation",), (), ("drift",), ("mode_asymmetry",), ()),
)


class PeerSet(NamedTuple):
    """One set and the truth behind it."""

    name: str
    planted: str  # in a word
    hidden: tuple[Hidden, ...]
    train: pd.DataFrame
    test: pd.DataFrame
    rms_noise: float  # of the test adhesion
    scored: bool = True  # whether the error says anything


def simulated_sets(count: int, seed: int) -> Iterator[PeerSet]:
    """Simulated campaigns: the forms of effects and the designs take turns, noise is drawn."""
    generator = np.random.default_rng((seed, 2))
    for number in range(count):
        base, form = BASE_CURVES[number % len(BASE_CURVES)], FORMS[number // 2 % 2]
        told = (base, number % 3 == 2, form, drawn_noise(generator), None)
        task = Task("peers", PLANTED[number % len(PLANTED)], 1000 * seed + 500 + number, *told)
        yield _made(f"simulated_{number:02d}", task)


def random_sets(count: int, seed: int) -> Iterator[PeerSet]:
    """Simulated campaigns with a random effect each, others than those of the study."""
    tasks = random_tasks(count, np.random.default_rng((seed, 6)), 4_000_000 + 1000 * seed)
    for number, task in enumerate(tasks):
        yield _made(f"random_{number:02d}", task)


def _made(name: str, task: Task) -> PeerSet:
    made = make_set(task)
    hidden = hidden_in(task)
    return PeerSet(name, task.planted, hidden, made.train, made.test, made.test_rms_noise)


def stored_sets(folder: Path) -> list[PeerSet]:
    """NAME_train.csv.gz and NAME_test.csv.gz of a folder, the truth in its answers.json.

    There `accepted` has, for each hidden effect, the names that are right for it.
    """
    try:
        answers = json.loads((folder / "answers.json").read_text())
        return [
            PeerSet(
                name,
                "+".join(answer["effects"]) or "nothing",
                tuple(Hidden(tuple(names), right_columns(names)) for names in answer["accepted"]),
                pd.read_csv(folder / f"{name}_train.csv.gz"),
                pd.read_csv(folder / f"{name}_test.csv.gz"),
                float(answer["test_rms_noise"]),
                bool(answer.get("score_error", True)),
            )
            for name, answer in answers.items()
        ]
    except OSError as error:
        raise InputError(
            f"--sets {folder} cannot be read ({error}); name a folder with answers.json and its "
            "train and test tables."
        ) from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InputError(
            f"--sets {folder} has an answers.json that does not tell effects, accepted and "
            "test_rms_noise by name."
        ) from None


def right_columns(names: Sequence[str]) -> tuple[str, ...]:
    """The columns that these names of effects rest on."""
    columns = [
        column
        for name in names
        for column in (seen_in(name) if name in PLANTABLE else columns_of(name))
    ]
    return tuple(dict.fromkeys(columns))
