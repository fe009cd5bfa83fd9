"""Judging: every method, as it was tuned, on rails that nobody has seen.

Each family of rails has as many runs a seed, with seeds that follow one another. All methods see
the same rails and the same noise, so that they are compared run by run.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pyarrow as pa
from jaxtyping import Array, Float, Key

from adhesion_jax.campaign.keys import noise_keys
from adhesion_jax.campaign.rows import segment_rows
from adhesion_jax.campaign.store import Arrays, Content, Tell
from adhesion_jax.campaign.traction import WHOLE
from adhesion_jax.leaderboard.runs import TILE, Course, tile
from adhesion_jax.leaderboard.terms import Field
from adhesion_jax.metrics.closed_loop import FIGURES
from adhesion_jax.runtime import silent
from adhesion_jax.traction.families import Family

#: Number of seeds, from that of the job on.
SEEDS = 3

#: The courses that are stored of a shard: those of its best, its median and its worst run.
COURSES = ("best", "median", "worst")

#: The columns of a segment's end: true and identified peak, with standard errors.
PEAKS = Course._fields[4:10]


class Judging(NamedTuple):
    """A job: the methods of a field at their points, on the rails of some families."""

    field: Field
    families: Mapping[str, Family]
    points: Mapping[str, Float[np.ndarray, " numbers"]]  # of each method, once it is tuned
    runs: int  # of each seed, family and method
    seed: int  # the first

    @property
    def name(self) -> str:
        return "judging"

    @property
    def units(self) -> list[tuple[int, str, str]]:
        """The tile, the rails and the method of each shard, the methods by turns."""
        return [
            (place, rails, method)
            for place in range(-(-SEEDS * self.runs // TILE))
            for rails in self.families
            for method in self.field.entrants
        ]

    @property
    def shards(self) -> int:
        return len(self.units)

    def runs_of(self, shard: int) -> int:
        return min(TILE, SEEDS * self.runs - self.units[shard][0] * TILE)

    @property
    def record(self) -> Mapping[str, Any]:
        told = {"--seed": str(self.seed), "--rails": ",".join(self.families)}
        depends = {**told, **self.field.depends_on([*self.families.values()])}
        return {"units": self.units, "depends on": depends}


def keys_of(seed: int, rails: str, lanes: np.ndarray) -> Key[Array, " lanes"]:
    """The key of each run: run l // SEEDS of seed + l % SEEDS, so that more runs come last."""
    runs = jnp.asarray(lanes // SEEDS)
    of_seed = jnp.stack([noise_keys(seed + n, rails, runs) for n in range(SEEDS)])
    return of_seed[lanes % SEEDS, jnp.arange(len(lanes))]


def content(job: Judging, number: int, tell: Tell = silent) -> Content:
    """What is stored of a shard: the figures of every segment, and the courses of three runs."""
    place, rails, method = job.units[number]
    tell(0, f"{method} on {rails}")
    lanes = np.arange(place * TILE, (place + 1) * TILE)
    found = tile(
        job.field.terms,
        job.field.timing,
        job.field.entrants[method],
        job.families[rails],
        np.broadcast_to(job.points[method], (TILE, len(job.points[method]))),
        keys_of(job.seed, job.families[rails].drawn_as or rails, lanes),
    )
    runs = job.runs_of(number)
    used = np.nan_to_num(found.figures["utilisation"][:runs, -1], nan=-np.inf)
    order = np.argsort(-used)
    shown = order[[0, (runs - 1) // 2, runs - 1]]
    course = Course(*(values[shown] for values in found.course))
    segments = range(found.figures["utilisation"].shape[1] - 1)
    ends = np.stack([_ends(course.segment, segment) for segment in segments], axis=1)
    course = course._replace(curve=course.curve[np.arange(len(shown))[:, None], ends])
    arrays = {f"course {name}": values for name, values in course._asdict().items()}
    rows = _rows(rails, method, job.seed, lanes[:runs], found.figures, found.course)
    return Content({**arrays, "shown": used[shown], **found.took()}, rows)


def _rows(
    rails: str,
    method: str,
    seed: int,
    lanes: np.ndarray,
    figures: Mapping[str, np.ndarray],
    course: Course,
) -> pa.Table:
    """A row for each run and segment, and for the whole run, which has no peak."""
    runs, segments = len(lanes), next(iter(figures.values())).shape[1]
    ends = [_ends(course.segment[:runs], segment) for segment in range(segments)]

    def at_ends(values: np.ndarray) -> np.ndarray:
        found = [np.where(end < 0, np.nan, values[np.arange(runs), end, 0]) for end in ends]
        return np.stack(found, axis=1)

    return segment_rows(
        {"rails": rails, "method": method},
        {"seed": seed + lanes % SEEDS, "run": lanes // SEEDS},
        [*map(str, range(1, segments)), WHOLE],
        {
            **{name: figures[name][:runs] for name in FIGURES},
            **{name: at_ends(getattr(course, name)) for name in PEAKS},
        },
    )


def _ends(of_rows: np.ndarray, segment: int) -> np.ndarray:
    """The last row of each run in a segment, -1 where there is none."""
    there = of_rows == segment
    last = of_rows.shape[1] - 1 - there[:, ::-1].argmax(axis=1)
    return np.where(there.any(axis=1), last, -1)


class Shown(NamedTuple):
    """The courses of three runs, and which they are."""

    utilisation: np.ndarray  # of each
    course: Course  # NumPy arrays [runs, rows, ...]; the curve is that of segments' ends


def shown_of(job: Judging, shards: Iterable[Arrays]) -> Mapping[tuple[str, str], Shown]:
    """The best, a median and the worst run of each method by rails and method."""
    parts: dict[tuple[str, str], list[Shown]] = defaultdict(list)
    for (_, rails, method), arrays in zip(job.units, shards, strict=True):
        course = Course(*(arrays[f"course {name}"] for name in Course._fields))
        parts[rails, method].append(Shown(arrays["shown"], course))
    found = {}
    for name, several in parts.items():
        best = max(several, key=lambda one: one.utilisation[0])
        worst = min(several, key=lambda one: one.utilisation[2])
        middle = sorted(several, key=lambda one: one.utilisation[1])[len(several) // 2]
        chosen = ((best, 0), (middle, 1), (worst, 2))
        course = Course(
            *(np.stack([getattr(one.course, f)[n] for one, n in chosen]) for f in Course._fields)
        )
        found[name] = Shown(np.array([one.utilisation[n] for one, n in chosen]), course)
    return found
