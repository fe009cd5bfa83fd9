"""Three exponential surfaces one after the other: the nominal rails."""

import jax
from jaxtyping import PRNGKeyArray

from adhesion_jax.traction.families.base import Family, exponentials, starts
from adhesion_jax.traction.rails import ByTime


class ExponentialRails(Family):
    """mu(v) = c (exp(-a v) - exp(-b v)), b/a = 2.2222; the peak is drawn for each segment."""

    TITLE = "exponential curves, one for each segment"

    def draw(self, key: PRNGKeyArray, step: float) -> ByTime:
        of_surfaces, of_starts = jax.random.split(key)
        return ByTime(exponentials(of_surfaces), starts(of_starts, step))
