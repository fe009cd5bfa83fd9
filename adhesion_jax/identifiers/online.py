"""What methods that take one sample after the other share."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array

from adhesion_jax.identifiers.curve_fit import FitState
from adhesion_jax.records import Record

R = TypeVar("R")

#: (recursion, slip, adhesion, conditions asked for) to the recursion after that sample.
Step = Callable[..., R]


class OnlineState(NamedTuple):
    """The fit as it was last asked for, and the recursion of the method."""

    batch: FitState
    recursion: Any  # the method's own


def over_fresh_samples(
    step: Step[R], recursion: R, record: Record, conditions: Sequence[str] = ()
) -> R:
    """The recursion after every point of the record that has not been seen before."""

    def one_sample(recursion: R, sample: tuple[Array, ...]) -> tuple[R, None]:
        fresh, *columns = sample
        taken = step(recursion, *columns)
        return jax.tree.map(lambda new, old: jnp.where(fresh, new, old), taken, recursion), None

    asked_for = (record.conditions[name] for name in conditions)
    samples = (record.fresh, record.slip, record.adhesion, *asked_for)
    return jax.lax.scan(one_sample, recursion, samples)[0]
