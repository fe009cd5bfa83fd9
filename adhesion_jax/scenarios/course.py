"""How the samples of a run come in blocks, each of which is identified or ends with an estimate."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from adhesion_jax.metrics.information import information_along, information_of
from adhesion_jax.scenarios.excitation import Excitation, Reached
from adhesion_jax.scenarios.noise import Noise

Mask = Bool[Array, "blocks points"]
Slopes = Float[Array, "blocks free points"]  # of adhesion by each parameter
Way = Float[Array, "blocks points free"]  # of the parameters
Products = Float[Array, "blocks free free"]


class Group(NamedTuple):
    """Blocks whose estimates are pooled into one row of a table.

    `switched` is the number of the stretch that began with a switch to this rail, or None; k is
    the number of points seen, in tables that are ordered by it.
    """

    rail: str
    blocks: tuple[int, ...]
    switched: int | None = None
    k: int | None = None


class Figure(NamedTuple):
    """A figure of estimates over the blocks of a run, by the name of its file."""

    name: Literal["tracking", "bands", "convergence", "drift"]
    reached: Reached | None = None  # of a convergence, at each block


Tables = Mapping[str, Sequence[Group]]


def switches(rails: Sequence[str]) -> list[int]:
    """The blocks that are the first ones on another rail."""
    return [b for b, (old, new) in enumerate(pairwise(rails), 1) if old != new]


class Course(eqx.Module):
    """The signals of a run have the shape `shape`; its blocks are views of them."""

    @property
    @abstractmethod
    def shape(self) -> tuple[int, ...]:
        """Of the signals of a run: neighbours along the last axis are neighbours in time."""

    @abstractmethod
    def blocks_of(self, signal: Float[Array, "*shape"]) -> Float[Array, "blocks points"]:
        """What the blocks have of a signal of a run."""

    @abstractmethod
    def ends(self, signal: Float[Array, "*shape"]) -> Float[Array, " blocks"]:
        """The values of such a signal at the end of each block."""

    def seen(self) -> tuple[Mask, Mask]:
        """The points that a block has, by default all, and those of them that none before has."""
        every = self.blocks_of(jnp.ones(self.shape)) > 0
        return every, every

    @abstractmethod
    def support(self, rails: Sequence[str]) -> np.ndarray:
        """The number of points that an estimate after each block can use, [blocks]."""

    def information(
        self, sensitivity: Slopes, mask: Mask, noise: Noise, rails: Sequence[str], path: Way | None
    ) -> Products:
        """J'J over those points, J made white as the noise is by `Noise.whitened`.

        `path` are the parameters of a rail that drifts, at each point. By default a block has all
        the points that an estimate after it can use.
        """
        return jax.vmap(lambda j, seen: information_of(jnp.where(seen, noise.whitened(j), 0.0)))(
            sensitivity, mask
        )

    @abstractmethod
    def tables(self, rails: Sequence[str]) -> Tables:
        """The rows of each table that is reported: the name of a table to its groups."""

    @abstractmethod
    def figures(self, excitation: Excitation) -> list[Figure]:
        """What is drawn over the blocks of a run."""


class Apart(Course):
    """Blocks that have nothing in common: each is excited by itself, the rail constant in it."""

    points: int = eqx.field(static=True)
    blocks: int = eqx.field(default=1, static=True)

    @property
    def shape(self) -> tuple[int, ...]:
        return self.blocks, self.points

    def blocks_of(self, signal: Float[Array, "*shape"]) -> Float[Array, "blocks points"]:
        return signal

    def ends(self, signal: Float[Array, "*shape"]) -> Float[Array, " blocks"]:
        return signal[:, -1]

    def support(self, rails: Sequence[str]) -> np.ndarray:
        return np.full(self.blocks, self.points)

    def tables(self, rails: Sequence[str]) -> Tables:
        """The first block after a switch has a table of its own, which shows the tracking."""
        starts = switches(rails)
        switched = {rails[b]: number for number, b in enumerate(starts, 1)}
        summary = [
            Group(
                rail,
                tuple(b for b, other in enumerate(rails) if other == rail and b not in starts),
                switched.get(rail),
            )
            for rail in dict.fromkeys(rails)
        ]
        if not starts:
            return {"summary": summary}
        after = [Group(rails[b], (b,), number) for number, b in enumerate(starts, 1)]
        return {"summary": summary, "switches": after}

    def figures(self, excitation: Excitation) -> list[Figure]:
        return [Figure("tracking")] if self.blocks > 1 else []  # a single block has no course


class Growing(Course):
    """One sequence; a block is the sequence up to a length, so that blocks overlap."""

    lengths: tuple[int, ...] = eqx.field(static=True)

    @property
    def shape(self) -> tuple[int, ...]:
        return (self.lengths[-1],)

    def blocks_of(self, signal: Float[Array, "*shape"]) -> Float[Array, "blocks points"]:
        return jnp.broadcast_to(signal, (len(self.lengths), *self.shape))

    def ends(self, signal: Float[Array, "*shape"]) -> Float[Array, " blocks"]:
        return signal[np.array(self.lengths) - 1]

    def seen(self) -> tuple[Mask, Mask]:
        mask = jnp.arange(self.lengths[-1]) < jnp.array(self.lengths)[:, None]
        return mask, mask & ~jnp.roll(mask, 1, axis=0).at[0].set(False)

    def support(self, rails: Sequence[str]) -> np.ndarray:
        return np.array(self.lengths)

    def tables(self, rails: Sequence[str]) -> Tables:
        """The whole sequence in the summary, every length in a table of checkpoints."""
        checkpoints = [Group(rails[b], (b,), k=length) for b, length in enumerate(self.lengths)]
        return {"summary": [Group(rails[-1], (len(rails) - 1,))], "checkpoints": checkpoints}

    def figures(self, excitation: Excitation) -> list[Figure]:
        return [Figure("tracking"), Figure("convergence", excitation.reached(self.lengths))]


#: Number of samples between two reports of a stream.
REPORT = 10


class Followed(Course):
    """A stream that is followed at every sample; a block is what lies between two reports.

    An estimate can use the data since the rail was last switched. `spacing` is the number of
    reports between two checkpoints, and `steady` whether the end of a stretch is reported, too.
    """

    points: int = eqx.field(static=True)
    spacing: int = eqx.field(static=True)
    steady: bool = eqx.field(static=True)

    @property
    def shape(self) -> tuple[int, ...]:
        return (self.points,)

    def blocks_of(self, signal: Float[Array, "*shape"]) -> Float[Array, "blocks points"]:
        return signal.reshape(-1, REPORT)

    def ends(self, signal: Float[Array, "*shape"]) -> Float[Array, " blocks"]:
        return signal[REPORT - 1 :: REPORT]

    def support(self, rails: Sequence[str]) -> np.ndarray:
        lengths = np.diff([0, *switches(rails), len(rails)])
        return REPORT * np.concatenate([np.arange(1, length + 1) for length in lengths])

    def information(
        self, sensitivity: Slopes, mask: Mask, noise: Noise, rails: Sequence[str], path: Way | None
    ) -> Products:
        def of_stretch(sensitivity: Slopes, path: Way | None) -> Products:
            along = jnp.swapaxes(sensitivity, 0, 1).reshape(sensitivity.shape[1], -1)
            way = None if path is None else path.reshape(-1, len(along)).T
            return information_along(noise.whitened(along), way, noise.sigma, REPORT)

        starts = switches(rails)
        paths = [None] * (len(starts) + 1) if path is None else jnp.split(path, starts)
        stretches = zip(jnp.split(sensitivity, starts), paths, strict=True)
        return jnp.concatenate([of_stretch(*stretch) for stretch in stretches])

    def tables(self, rails: Sequence[str]) -> Tables:
        """The end of each stretch in the summary; k counts the samples seen.

        Steady running is the second half of a stretch, against the bound of the data since its
        start. Around a switch the checkpoints are denser.
        """
        blocks, starts = len(rails), switches(rails)
        ends = sorted({b - 1 for b in starts} | {blocks - 1})
        near = {b + j for b in starts for j in range(-1, self.spacing)} if starts else set()
        spaced = set(range(self.spacing - 1, blocks, self.spacing))
        halves = [
            tuple(range(end + 1 - self.support(rails)[end] // REPORT // 2, end + 1)) for end in ends
        ]
        tables = {"summary": [Group(rails[b], (b,)) for b in ends]}
        if self.steady:
            tables["steady"] = [Group(rails[half[0]], half) for half in halves]
        tables["checkpoints"] = [
            Group(rails[b], (b,), k=REPORT * (b + 1))
            for b in sorted(near | spaced | {blocks - 1})
            if b < blocks
        ]
        return tables

    def figures(self, excitation: Excitation) -> list[Figure]:
        return [Figure("bands")]
