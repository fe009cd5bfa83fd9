"""The methods of a board, and what their numbers depend on."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from adhesion_jax.campaign.identity import own_files, settings_of, surroundings
from adhesion_jax.metrics.closed_loop import PRICES
from adhesion_jax.traction.entrants import Entrant
from adhesion_jax.traction.families import Family
from adhesion_jax.traction.loop import Timing
from adhesion_jax.traction.systems.base import Terms

#: The methods that are told the slip of the largest utility at a price.
OPTIMA: Mapping[int, str] = {
    price: f"true-optimum-{price}" if price else "true-optimum" for price in PRICES
}


class Field(NamedTuple):
    """Methods by name, on equal terms and one grid of time."""

    terms: Terms
    timing: Timing
    entrants: Mapping[str, Entrant]

    def depends_on(self, families: Sequence[Family]) -> Mapping[str, str]:
        """What all numbers depend on beside the options of a job."""
        return {
            "--methods": ",".join(self.entrants),
            "settings of plant, methods and rails": settings_of(
                (self.terms, [*self.entrants.values()], [*families])
            ),
            "grid of time": repr(self.timing),
            **surroundings(),
            **own_files(),
        }
