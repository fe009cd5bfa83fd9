"""The ranges that the numbers of a method may have when it is tuned."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float


class Range(NamedTuple):
    """From low to high: by equal steps or, where `log`, by equal factors, both of one sign."""

    low: float
    high: float
    log: bool = False

    def at(self, share: Float[Array, ""]) -> Float[Array, ""]:
        """The number at a share of the range from 0 to 1."""
        if self.log:
            return self.low * jnp.asarray(self.high / self.low) ** share
        return self.low + (self.high - self.low) * share
