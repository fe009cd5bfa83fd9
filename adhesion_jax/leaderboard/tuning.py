"""Tuning: every method at as many points of its box as the others, on the same rails.

The points are the first of one scrambled Sobol sequence, in as many of its coordinates as a method
has numbers. The point with the largest mean utilisation is chosen.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pyarrow as pa
from jaxtyping import Float
from numpy.typing import NDArray
from scipy.stats.qmc import Sobol

from adhesion_jax.campaign.keys import noise_keys
from adhesion_jax.campaign.store import Arrays, Content, Tell
from adhesion_jax.leaderboard.cost import Cost, cost
from adhesion_jax.leaderboard.runs import TILE, standard_error, tile
from adhesion_jax.leaderboard.terms import Field
from adhesion_jax.runtime import silent
from adhesion_jax.traction.entrants import Entrant, numbers
from adhesion_jax.traction.families import Family

#: Number of drawn rails that each configuration runs on.
TRIPLES = 24

#: Number of coordinates of the sequence, and so the largest number of numbers of a method.
_COORDINATES = 32


class Tuning(NamedTuple):
    """A job: the methods of a field on the rails that they are tuned on.

    Several families have as many rails each, and no rail twice.
    """

    field: Field
    families: Mapping[str, Family]
    budget: int  # configurations of a method that has numbers
    seed: int  # of the rails and the noise

    @property
    def name(self) -> str:
        return "tuning"

    @property
    def runs(self) -> int:
        return self.budget

    @property
    def units(self) -> list[tuple[int, str, str]]:
        """The tile, the rails and the method of each shard, the methods by turns."""
        tiles = {name: -(-self.lanes_of(name) // TILE) for name in self.field.entrants}
        return sorted(
            (
                (place, rails, name)
                for name, count in tiles.items()
                for rails in self.families
                for place in range(count)
            ),
            key=lambda unit: unit[0],
        )

    @property
    def each(self) -> int:
        """The number of rails of a family."""
        return max(TRIPLES // len(self.families), 1)

    @property
    def shards(self) -> int:
        return len(self.units)

    def lanes_of(self, method: str) -> int:
        """The runs of a method on a family: one that has no numbers has one configuration."""
        tuned = bool(numbers(self.field.entrants[method]))
        return self.each * (self.budget if tuned else 1)

    def runs_of(self, shard: int) -> int:
        place, _, method = self.units[shard]
        return min(TILE, self.lanes_of(method) - place * TILE)

    @property
    def record(self) -> Mapping[str, Any]:
        told = {
            "--budget": str(self.budget),
            "seed of tuning": str(self.seed),
            "--rails": ",".join(self.families),
        }
        depends = {**told, **self.field.depends_on([*self.families.values()])}
        return {"depends on": depends}


def points(method: Entrant, budget: int) -> Float[np.ndarray, "budget numbers"]:
    """Points of the unit cube of the numbers of a method."""
    sequence = Sobol(_COORDINATES, scramble=True, rng=np.random.default_rng(0))
    drawn: NDArray[np.float64] = sequence.random_base2(max(budget - 1, 1).bit_length())
    return drawn[:budget, : len(numbers(method))]


def content(job: Tuning, number: int, tell: Tell = silent) -> Content:
    """What is stored of a shard: the utilisation of every run."""
    place, rails, method = job.units[number]
    tell(0, f"tuning {method}")
    entrant = job.field.entrants[method]
    lanes = np.arange(place * TILE, (place + 1) * TILE)
    configuration = np.minimum(lanes // job.each, job.budget - 1)
    family = job.families[rails]
    triples = [*job.families].index(rails) * job.each + lanes % job.each
    found = tile(
        job.field.terms,
        job.field.timing,
        entrant,
        family,
        points(entrant, job.budget)[configuration],
        noise_keys(job.seed, family.drawn_as or rails, jnp.asarray(triples)),
    )
    utilisation = found.figures["utilisation"][: job.runs_of(number), -1]
    rows = {
        "method": pa.array([method] * len(utilisation)).dictionary_encode(),
        "configuration": pa.array(configuration[: len(utilisation)]),
        "triple": pa.array(triples[: len(utilisation)]),
        "utilisation": pa.array(utilisation),
    }
    arrays = {"utilisation": utilisation, **found.took()}
    if place == 0 and rails == next(iter(job.families)):
        arrays["cost"] = np.array(cost(entrant, job.field.terms.plant))
    return Content(arrays, pa.table(rows))


class Tuned(NamedTuple):
    """The chosen configuration of a method, the utilisation that tuning promises, and its cost."""

    point: Float[np.ndarray, " numbers"]
    promised: float
    promised_se: float
    cost: Cost


def tuned(job: Tuning, shards: Iterable[Arrays]) -> Mapping[str, Tuned]:
    """The best configuration of each method: one that fails on a rail is none."""
    parts: dict[tuple[str, str], list[Arrays]] = defaultdict(list)
    for (_, rails, method), arrays in zip(job.units, shards, strict=True):
        parts[method, rails].append(arrays)
    found = {}
    for method in job.field.entrants:
        of_method = [parts[method, rails] for rails in job.families]
        of_rails = (np.concatenate([one["utilisation"] for one in each]) for each in of_method)
        used = np.hstack([each.reshape(-1, job.each) for each in of_rails])
        best = int(np.nan_to_num(used.mean(axis=1), nan=-np.inf).argmax())
        microseconds, state_bytes = of_method[0][0]["cost"]
        found[method] = Tuned(
            points(job.field.entrants[method], job.budget)[best],
            float(used[best].mean()),
            standard_error(used[best]),
            Cost(float(microseconds), int(state_bytes)),
        )
    return found
