"""What each part of `offset-curve` buys, one switched off at a time, and thinner samples."""

import dataclasses
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np
import pandas as pd

from adhesion_jax.files import write_table
from adhesion_jax.leaderboard.judging import keys_of
from adhesion_jax.leaderboard.runs import TILE, standard_error, tile
from adhesion_jax.leaderboard.terms import SAMPLED, Grid, timing_of
from adhesion_jax.runtime import as_in_commands
from adhesion_jax.traction.entrants import ENTRANTS, Entrant, box
from adhesion_jax.traction.families import FAMILIES
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.seekers.offset_curve import OffsetCurve
from adhesion_jax.traction.sensors import Sensors
from adhesion_jax.traction.signals import Reference
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import terms_of

RESULTS = Path(__file__).parents[1] / "results"

#: Rails of a seed beyond those of the board; samples of mu(0) = 0 that tie a curve to the origin.
RAILS, SEED, _TIED = "exponential", 100, 10.0


class WithoutOffset(OffsetCurve):
    def _fitted(self, state: Any, train_speed: Any) -> Any:
        names = ("left", "left_left", "weight")
        tied = state.sums._replace(**{name: getattr(state.sums, name) + _TIED for name in names})
        found = super()._fitted(state._replace(sums=tied), train_speed)
        return found._replace(sums=state.sums)


class WithoutDither(OffsetCurve):
    def update(self, state: Any, nominal: Any, signals: Any, period: float) -> Any:
        state, _ = super().update(state, nominal, signals, period)
        return state, Reference(signals.direction * state.asked, jnp.zeros_like(state.asked))


class WithoutDetection(OffsetCurve):
    BOX: ClassVar = {name: one for name, one in OffsetCurve.BOX.items() if name != "threshold"}


class WithoutDoubt(OffsetCurve):
    """Goes to the slip of the peak at once, however unsure that is."""

    def _fitted(self, state: Any, train_speed: Any) -> Any:
        found = super()._fitted(state, train_speed)
        sure = jnp.isfinite(found.peak.slip)
        return found._replace(asked=jnp.where(sure, found.peak.slip, found.asked))


def compared() -> Mapping[str, tuple[str, Any]]:
    """By what is said of it: whose numbers a seeker has, and the seeker."""
    own: Any = ENTRANTS["offset-curve"].seeker
    fields = {one.name: getattr(own.seeker, one.name) for one in dataclasses.fields(own.seeker)}
    found: dict[str, tuple[str, Any]] = {
        "whole": ("offset-curve", own.seeker),
        "without offset": ("offset-curve", WithoutOffset(**fields)),
        "without dither": ("offset-curve", WithoutDither(**fields)),
        "without detection": ("offset-curve", WithoutDetection(**fields | {"threshold": jnp.inf})),
        "without its errors": ("offset-curve", WithoutDoubt(**fields)),
    }
    for name in ("riv", "ml-pooled"):
        thinned: Any = ENTRANTS[name].seeker
        block = round(1e3 * thinned.seeker.spacing) * thinned.seeker.block
        every = dataclasses.replace(thinned.seeker, spacing=1e-3, block=block)
        found |= {f"{name}, 10 ms": (name, thinned.seeker), f"{name}, 1 ms": (name, every)}
    return found


def point(method: Entrant, tuned: str) -> np.ndarray:
    """The numbers that a board tells in words, as a point of the box of a method."""
    told = {name: float(value) for name, value in re.findall(r"(\w+) ([-+.\de]+)(?:,|$)", tuned)}
    shares = []
    for place, (low, high, log) in box(method).items():
        ends = np.array([low, high, told[place.rpartition(".")[2]]]) / low
        first, last, value = np.log(ends) if log else ends
        shares.append((value - first) / (last - first))
    return np.array(shares)


@as_in_commands
def main() -> None:
    board = pd.read_csv(RESULTS / "leaderboard.csv")
    tuned = board[board["rails"] == RAILS].set_index("method")["tuned"]
    plant, family, system = read_plant(shipped()["hxd1f"]).plant, FAMILIES[RAILS], SYSTEMS["hxd1f"]
    terms, rows = terms_of(system, plant, Sensors(system.noise, period=SAMPLED)), []
    for words, (name, seeker) in compared().items():
        shared: Any = ENTRANTS[name]
        method = shared._replace(seeker=dataclasses.replace(shared.seeker, seeker=seeker))
        timing = timing_of(terms, Grid(), words, method, family)
        points = np.tile(point(method, tuned[name]), (TILE, 1))
        keys = keys_of(SEED, RAILS, np.arange(TILE))
        figures = tile(terms, timing, method, family, points, keys).figures
        used, t95 = figures["utilisation"][:, -1], figures["t95"][:, :-1]
        rows.append(
            {
                "seeker": words,
                "utilisation": used.mean(),
                "utilisation_se": standard_error(used),
                "worst": used.min(),
                "never95": figures["never95"][:, :-1].mean(),
                "t95_median": np.median(np.nan_to_num(t95, nan=np.inf)),
                "torque_variation": figures["torque_variation"][:, -1].mean(),
            }
        )
    write_table(RESULTS / "seeker_parts.csv", pd.DataFrame(rows))


if __name__ == "__main__":
    main()
