"""What methods that take one sample after the other share."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from adhesion_jax.records import Known, Record

R = TypeVar("R")

#: (recursion, slip, adhesion, conditions asked for) to the recursion after that sample.
Step = Callable[..., R]


class OnlineState(NamedTuple):
    """The recursion of the method, and of the last record what an estimate tells of it."""

    known: Known
    recursion: Any  # the method's own
    objective: Float[Array, ""]  # sum of squared residuals
    samples: Int[Array, ""]  # those not seen before
    skipped: Int[Array, ""]  # those of them that were left out


def begin(known: Known, recursion: R) -> OnlineState:
    """Before any data."""
    return OnlineState(known, recursion, jnp.zeros(()), jnp.int32(0), jnp.int32(0))


def over_fresh_samples(
    step: Step[R], state: OnlineState, record: Record, conditions: Sequence[str] = ()
) -> OnlineState:
    """The state after every point of the record that has not been seen before.

    A sample that would leave anything in the recursion NaN or infinite is left out and counted:
    one value that is no number would otherwise stay in the sums for good.
    """

    def one_sample(recursion: R, sample: tuple[Array, ...]) -> tuple[R, Bool[Array, ""]]:
        fresh, *columns = sample
        taken = step(recursion, *columns)
        finite = _all_finite(taken)
        after = jax.tree.map(lambda new, old: jnp.where(fresh & finite, new, old), taken, recursion)
        return after, fresh & ~finite

    asked_for = (record.conditions[name] for name in conditions)
    samples = (record.fresh, record.slip, record.adhesion, *asked_for)
    recursion, skipped = jax.lax.scan(one_sample, state.recursion, samples)
    return state._replace(
        recursion=recursion,
        samples=jnp.sum(record.fresh, dtype=jnp.int32),
        skipped=jnp.sum(skipped, dtype=jnp.int32),
    )


def _all_finite(recursion: Any) -> Bool[Array, ""]:
    """Whether every number is; their sum is NaN or infinite as soon as one of them is."""
    numbers = (x for x in jax.tree.leaves(recursion) if jnp.issubdtype(x.dtype, jnp.inexact))
    return jnp.isfinite(sum((jnp.sum(x) for x in numbers), jnp.zeros(())))
