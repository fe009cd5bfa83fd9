"""Moments gathered in parts against NumPy over all runs at once."""

import operator
from functools import partial, reduce

import jax
import numpy as np

from adhesion_jax.metrics.moments import KnownMoments


def test_moments_of_known_values_are_those_of_numpy():
    random = np.random.default_rng(0)
    draws = random.normal(3, 2, (400, 4))
    unknown = random.random(draws.shape) < [0.0, 0.3, 1.0, 1.0]
    draws[unknown & (random.random(draws.shape) < 0.5)] = np.inf
    draws[unknown & np.isfinite(draws)] = np.nan
    draws[7, 3] = 5.0  # known in this run alone
    parts = [KnownMoments.of({"x": part}) for part in np.split(draws, [1, 60, 300])]
    found = reduce(partial(jax.tree.map, operator.add), parts)
    assert found.runs == 400
    for column in range(4):
        known = draws[np.isfinite(draws[:, column]), column]
        assert found.known["x"][column] == len(known)
        mean = known.mean() if len(known) else np.nan
        error = known.std(ddof=1) / np.sqrt(len(known)) if len(known) > 1 else np.nan
        np.testing.assert_allclose(found.mean("x")[column], mean, rtol=1e-12)
        np.testing.assert_allclose(found.standard_error("x")[column], error, rtol=1e-9)
    assert 200 < found.known["x"][1] < 360
    assert found.known["x"][2:].tolist() == [0.0, 1.0]
