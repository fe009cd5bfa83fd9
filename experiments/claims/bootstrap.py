"""Standard errors by a bootstrap over whole runs."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

_RESAMPLES = 400


def resamples(runs: int, random: np.random.Generator) -> Iterator[NDArray[np.intp]]:
    """The run numbers of each resample."""
    for _ in range(_RESAMPLES):
        yield random.integers(runs, size=runs)


def spread(resampled: list[float]) -> float:
    """The standard error from the values of the resamples; NaN if one of them is infinite."""
    return float(np.std(resampled, ddof=1)) if np.isfinite(resampled).all() else float("nan")
