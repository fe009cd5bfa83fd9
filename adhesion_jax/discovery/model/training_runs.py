"""Test runs that are none, because the law was fitted to them."""

from hashlib import blake2b

import numpy as np

from adhesion_jax.data.reading import POINTS
from adhesion_jax.data.runs import RunSet
from adhesion_jax.errors import InputError


def refuse_training_runs(runs: RunSet, test: RunSet) -> None:
    """InputError if a run of the test data is one of the training data, point for point."""
    known = _contents(runs)
    same = [known[content] for content in _contents(test) if content in known]
    if same:
        count = len(test.names)
        what = "block" if test.blocks else "run"
        raise InputError(
            f"{len(same)} of the {count} {what}s of the test data "
            f"{'is' if len(same) == 1 else 'are'} in the training data as well (the first is "
            f"{same[0]}), and an error on what was fitted to says nothing of new runs; give other "
            "runs as test data, or none."
        )


def _contents(runs: RunSet) -> dict[bytes, str]:
    """What each run of some length holds, in a number of fixed length, and the name of the run."""
    found = {}
    for name, start, length in zip(runs.names, runs.starts, runs.lengths, strict=True):
        rows = slice(start, start + length)
        content = np.concatenate([runs.whole.slip[rows], runs.whole.adhesion[rows]])
        if length >= POINTS:  # a few rounded numbers may be equal by chance
            found[blake2b(content.data).digest()] = name
    return found
