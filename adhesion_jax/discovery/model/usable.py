"""What of measured runs a discovery can use, and test runs that are none."""

from hashlib import blake2b

import numpy as np

from adhesion_jax.data.reading import POINTS
from adhesion_jax.data.runs import RunSet
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed

#: Values of a column that are larger are no measurement, and their squares no numbers.
_LARGEST = 1e100

#: A column whose values vary by less, although they vary, cannot be multiplied without loss.
_FINEST = 1e-100


def usable(runs: RunSet) -> tuple[RunSet, list[str]]:
    """The runs without unknown columns whose size is no measurement, and sentences on them."""
    odd = []
    for name in runs.covariates:
        values = runs.whole.conditions[name]
        low, high = float(values.min()), float(values.max())
        if max(-low, high) > _LARGEST or 0 < high / 2 - low / 2 < _FINEST:
            odd.append(name)
    if not odd:
        return runs, []
    return _without(runs, odd), [
        f"The column{'s' if len(odd) > 1 else ''} {listed(odd)} {'are' if len(odd) > 1 else 'is'} "
        f"left out: values beyond {_LARGEST:g}, or that differ by less than {_FINEST:g}, cannot be "
        "computed with; give them in another unit."
    ]


def _without(runs: RunSet, names: list[str]) -> RunSet:
    conditions = {
        name: values for name, values in runs.whole.conditions.items() if name not in names
    }
    return runs._replace(
        whole=runs.whole._replace(conditions=conditions),
        covariates=tuple(name for name in runs.covariates if name not in names),
    )


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
