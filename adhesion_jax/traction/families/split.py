"""Exponential surfaces whose left rail differs from the right one."""

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from adhesion_jax.curves import Scalar
from adhesion_jax.curves.peak import find_peak
from adhesion_jax.traction.families.base import SLIPS, Family, exponential, peaks, starts
from adhesion_jax.traction.rails import ByTime
from adhesion_jax.traction.surface import BothSides, RailSurface


class SplitRails(Family):
    """Each rail has a peak of its own in each segment; the best slip is that of their mean."""

    TITLE = "exponential curves, others on the left rail than on the right"

    def draw(self, key: PRNGKeyArray, step: float) -> ByTime:
        of_right, of_left, of_starts = jax.random.split(key, 3)
        surfaces = RailSurface(jax.vmap(_law)(*peaks(of_right), *peaks(of_left)))
        return ByTime(surfaces, starts(of_starts, step))


def _law(*of_sides: Scalar) -> BothSides:
    right, left = exponential(*of_sides[:2]).law, exponential(*of_sides[2:]).law
    # Between the best slips of both.
    largest = find_peak(lambda slip: (right(slip, {}) + left(slip, {})) / 2, jnp.asarray(SLIPS[1]))
    return BothSides(right, left, largest)
