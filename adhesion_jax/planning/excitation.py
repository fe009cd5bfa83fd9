"""Which slips a measurement passes through: sweeps, or those of one's own log again."""

from typing import NamedTuple, TypeAlias

import numpy as np
from jaxtyping import Float, Int

#: Largest number of samples of a log from which its information is computed.
_MOST_SAMPLES = 200_000

#: Number of samples of a piece of a single long run.
_PIECE = 2000


class Excitation(NamedTuple):
    """Runs that begin at `starts`; all of them are taken `repeats` times."""

    share: Float[np.ndarray, " points"]  # slip over the largest slip
    starts: Int[np.ndarray, " runs"]
    repeats: float

    @property
    def runs(self) -> float:
        return self.repeats * self.starts.size

    @property
    def samples(self) -> float:
        return self.repeats * self.share.size


class Sweeps(NamedTuple):
    """Runs that rise evenly from slip 0 to the largest; too few samples for one are a short one."""

    samples_per_run: int

    def __call__(self, samples: float) -> Excitation:
        runs = max(1, round(samples / self.samples_per_run))
        share = np.linspace(0.0, 1.0, max(2, round(samples / runs)))
        return Excitation(share, np.zeros(1, dtype=int), float(runs))


class Again(NamedTuple):
    """The runs of a log again and again, all its slips stretched by one factor."""

    share: Float[np.ndarray, " points"]
    starts: Int[np.ndarray, " runs"]
    samples: int  # of the whole log

    def __call__(self, samples: float) -> Excitation:
        return Excitation(self.share, self.starts, samples / self.share.size)


#: Called with a number of samples, it gives an excitation of about that number.
Design: TypeAlias = Sweeps | Again


def again(slip: Float[np.ndarray, " points"], starts: Int[np.ndarray, " runs"]) -> Again:
    """The design of a log; of a long one evenly chosen runs stand for all."""
    chosen, fewer = _some_runs(slip.size, starts)
    return Again(slip[chosen] / np.abs(slip).max(), fewer, slip.size)


def _some_runs(
    points: int, starts: Int[np.ndarray, " runs"]
) -> tuple[Int[np.ndarray, " chosen"], Int[np.ndarray, " fewer"]]:
    """Samples of whole runs, evenly chosen, if a log is long, and where they begin.

    A single run is cut into pieces, which then are the runs.
    """
    if points <= _MOST_SAMPLES:
        return np.arange(points), starts
    if starts.size == 1:
        starts = np.arange(0, points, _PIECE)
    ends = np.append(starts[1:], points)
    kept = slice(None, None, -(-points // _MOST_SAMPLES))
    chosen = [np.arange(start, end) for start, end in zip(starts[kept], ends[kept], strict=True)]
    begins = np.cumsum([0, *(run.size for run in chosen[:-1])])
    return np.concatenate(chosen), begins
