"""The settings of the parts of a loop: other ones, and the ranges in which some are tuned."""

import dataclasses
from typing import Any, NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

P = TypeVar("P", bound=eqx.Module)


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


def with_settings(part: P, **settings: Any) -> P:
    """The part with these settings, and the others as they are."""
    return dataclasses.replace(part, **settings)
