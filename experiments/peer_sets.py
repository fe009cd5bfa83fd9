"""The sets that the discovery and its peers are held against each other on."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from adhesion_jax.discovery.simulated_runs import FAMILIES
from adhesion_jax.discovery.simulator import FORMS, Noise, simulate
from adhesion_jax.errors import InputError

#: What is planted in the simulated sets, in turn; a third of them have nothing hidden.
PLANTED: Sequence[tuple[str, ...]] = (
    *(("humidity",), (), ("patch",), ("lag",), ()),
    *(("temperature", "sanding"), ("cleaning",), (), ("load_peak",), ("product",), ()),
    *(("hysteresis",), ("unknown_column",), (), ("rail_joint",), ("falling_friction",), ()),
    *(("curve", "temperature"), ("relaxation",), (), ("drift",), ("mode_asymmetry",), ()),
)

_SLIP = ("vehicle_speed_mps", "slip_velocity_mps")
_CLOCK = ("time_s", "time_in_run")
_CHANGES = ("base_adhesion_change", "slip_size_change")

#: Columns whose name is right for an effect; of features made by hand the beginning of the name.
RIGHT_COLUMNS = {
    "humidity": ("relative_humidity_pct",),
    "temperature": ("temperature_C",),
    "load": ("normal_load_N",),
    "load_peak": ("normal_load_N",),
    "load_slope": ("normal_load_N",),
    "patch": ("position_m",),
    "rail_joint": ("position_m",),
    "sanding": ("sanding", "sand_before"),
    "cleaning": ("work", *_CLOCK, *_SLIP),
    "lag": _CHANGES,
    "delay": _CHANGES,
    "relaxation": (*_CHANGES, "vehicle_speed_mps"),
    "hysteresis": _CHANGES,
    "slip_noise": _CHANGES,
    "curve": ("curvature_per_m", "position_m"),
    "drift": ("time_s", "rail_age_days"),
    "unknown_column": ("rail_age_days",),
    "product": ("gradient_permille", "temperature_C", "position_m"),
    "mode_asymmetry": ("mode",),
    "speed": _SLIP,
    "slip_speed": _SLIP,
    "falling_friction": _SLIP,
    "contact_heating": _SLIP,
    "torsion": ("time_s", "time_in_run"),
    "load_transfer": ("acceleration",),
}


class PeerSet(NamedTuple):
    """One set and what is true of it."""

    name: str
    effects: tuple[str, ...]
    train: pd.DataFrame
    test: pd.DataFrame
    rms_noise: float  # of the test adhesion


def simulated_sets(count: int, seed: int) -> Iterator[PeerSet]:
    """Simulated campaigns: the forms of effects and the designs take turns, noise is drawn."""
    generator = np.random.default_rng((seed, 2))
    for number in range(count):
        noise = Noise(
            float(generator.choice([0.005, 0.01, 0.02])),
            float(generator.choice([0.0, 0.3, 0.6])),
            float(generator.choice([0.0, 0.005, 0.01])),
        )
        campaign = simulate(
            PLANTED[number % len(PLANTED)],
            seed=1000 * seed + 500 + number,
            base=FAMILIES[number % len(FAMILIES)],
            operational=number % 3 == 2,
            form=FORMS[number // 2 % 2],
            noise=noise,
        )
        yield PeerSet(
            f"simulated_{number:02d}",
            campaign.truth,
            campaign.train,
            campaign.test,
            campaign.test_rms_noise,
        )


def stored_sets(folder: Path) -> list[PeerSet]:
    """NAME_train.csv.gz and NAME_test.csv.gz of a folder, the truth in its answers.json."""
    try:
        answers = json.loads((folder / "answers.json").read_text())
        return [
            PeerSet(
                name,
                tuple(answer["effects"]),
                pd.read_csv(folder / f"{name}_train.csv.gz"),
                pd.read_csv(folder / f"{name}_test.csv.gz"),
                float(answer["test_rms_noise"]),
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
            f"--sets {folder} has an answers.json that tells no effects and test_rms_noise by name."
        ) from None


def is_right_column(effects: Sequence[str], column: str) -> bool:
    """Whether a column that a peer names belongs to one of the planted effects."""
    return any(column.startswith(RIGHT_COLUMNS.get(effect, effect)) for effect in effects)
