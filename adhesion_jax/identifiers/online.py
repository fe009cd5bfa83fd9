"""What methods that take one sample after the other share."""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.identifiers.curve_fit import FitState
from adhesion_jax.scenarios import Record

R = TypeVar("R")

#: (recursion, slip, adhesion) to the recursion after that sample.
Step = Callable[[R, Float[Array, ""], Float[Array, ""]], R]


class OnlineState(NamedTuple):
    """The fit as it was last asked for, and the recursion of the method."""

    batch: FitState
    recursion: Any  # the method's own


def over_fresh_samples(step: Step[R], recursion: R, record: Record) -> R:
    """The recursion after every point of the record that has not been seen before."""

    def one_sample(recursion: R, sample: tuple[Array, Array, Array]) -> tuple[R, None]:
        slip, adhesion, fresh = sample
        taken = step(recursion, slip, adhesion)
        return jax.tree.map(lambda new, old: jnp.where(fresh, new, old), taken, recursion), None

    samples = (record.slip, record.adhesion, record.fresh)
    return jax.lax.scan(one_sample, recursion, samples)[0]
