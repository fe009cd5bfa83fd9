"""Means over runs with their Monte Carlo standard errors, summed up part by part."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Moments(NamedTuple):
    """Number of runs, sum and sum of squares of some statistics of a run.

    The runs are independent, the blocks of a run need not be: a statistic is therefore first
    averaged within each run. Parts are added in the order of their runs, so the sums do not
    depend on how many parts are computed at a time.
    """

    runs: int
    total: Mapping[str, Array]
    total_square: Mapping[str, Array]

    @staticmethod
    def of(statistics: Mapping[str, Array]) -> "Moments":
        """Moments of statistics whose first axis is that of the runs."""
        runs = len(next(iter(statistics.values())))
        return Moments(
            runs,
            {name: np.sum(x, axis=0) for name, x in statistics.items()},
            {name: np.sum(x * x, axis=0) for name, x in statistics.items()},
        )

    def arrays(self, name: str) -> dict[str, NDArray[Any]]:
        """The same as arrays, under names that begin with this one."""
        return {
            f"{name} runs": np.array(self.runs),
            **{f"{name} total {key}": sums for key, sums in self.total.items()},
            **{f"{name} square {key}": squares for key, squares in self.total_square.items()},
        }

    @staticmethod
    def of_arrays(arrays: Mapping[str, NDArray[Any]], name: str) -> "Moments":
        """The inverse of `arrays`."""

        def of(kind: str) -> dict[str, Array]:
            begin = f"{name} {kind} "
            return {key[len(begin) :]: arrays[key] for key in arrays if key.startswith(begin)}

        return Moments(int(arrays[f"{name} runs"]), of("total"), of("square"))

    def at(self, place: int | tuple[int, ...]) -> "Moments":
        """The moments at one place of the first axes of all statistics."""
        return Moments(
            self.runs,
            {name: np.asarray(x[place]) for name, x in self.total.items()},
            {name: np.asarray(x[place]) for name, x in self.total_square.items()},
        )

    def mean(self, name: str) -> Array:
        return np.asarray(self.total[name] / self.runs)

    def standard_error(self, name: str) -> Array:
        """Standard error of the mean; NaN for a single run."""
        if self.runs < 2:
            return np.asarray(np.full_like(self.total[name], np.nan))
        variance = self.total_square[name] / self.runs - self.mean(name) ** 2
        return np.asarray(np.sqrt(np.maximum(variance, 0.0) / (self.runs - 1)))


class KnownMoments(NamedTuple):
    """Number, sum and sum of squares of the values of some statistics that are finite.

    Statistics may be NaN in some runs (the time until an event is, in a run without the
    event): mean and error are those of the runs in which it is known, NaN if these are too few.
    """

    runs: int
    known: Mapping[str, Array]
    total: Mapping[str, Array]
    total_square: Mapping[str, Array]

    @staticmethod
    def of(statistics: Mapping[str, Array]) -> "KnownMoments":
        """Moments of statistics whose first axis is that of the runs."""
        known = Moments.of({name: 1.0 * np.isfinite(x) for name, x in statistics.items()})
        values = Moments.of(
            {name: np.where(np.isfinite(x), x, 0.0) for name, x in statistics.items()}
        )
        return KnownMoments(values.runs, known.total, values.total, values.total_square)

    def mean(self, name: str) -> Array:
        """Mean over the runs in which the statistic is known."""
        known = self.known[name]
        return np.asarray(self.total[name] / np.where(known > 0, known, np.nan))

    def standard_error(self, name: str) -> Array:
        """Standard error of that mean; NaN if the statistic is known in fewer than two runs."""
        known = np.where(self.known[name] > 1, self.known[name], np.nan)
        variance = self.total_square[name] / known - self.mean(name) ** 2
        return np.asarray(np.sqrt(np.maximum(variance, 0.0) / (known - 1)))
