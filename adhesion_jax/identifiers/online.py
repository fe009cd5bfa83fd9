"""The state and the loop of methods that take one sample after the other."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array

from adhesion_jax.identifiers.base import as_arrays
from adhesion_jax.optim.arrays import Count, Value, Whether
from adhesion_jax.records import Known, Record

R = TypeVar("R")


class Sample(NamedTuple):
    """What is measured at one moment; where it is not `taken`, all numbers are 0."""

    taken: Whether
    slip: Value
    adhesion: Value
    conditions: tuple[Value, ...]  # those asked for


#: The recursion after a sample, from that before it.
Step = Callable[[R, Sample], R]


class OnlineState(NamedTuple):
    """The recursion, and the quantities of the last record that an estimate reports."""

    known: Known
    recursion: Any  # the method's own
    objective: Value  # sum of squared residuals
    samples: Count  # number of samples not seen before
    skipped: Count  # number of these that were left out


#: The largest adhesion that is believed: three times that of a racing tyre.
LARGEST = 10.0


def begin(known: Known, recursion: R) -> OnlineState:
    """The state before any data."""
    return as_arrays(OnlineState(known, recursion, jnp.zeros(()), jnp.int32(0), jnp.int32(0)))


def over_fresh_samples(
    step: Step[R], state: OnlineState, record: Record, conditions: Sequence[str] = ()
) -> OnlineState:
    """The state after every point of the record that has not been seen before.

    A sample that is not finite, or whose adhesion no contact has, is left out and counted, because
    it would stay in the sums. To the step it comes, like one that is not fresh, with zeros for its
    columns, and as not taken; the recursion must then stay as it is.
    """

    def one_sample(
        carry: tuple[R, Value], sample: tuple[Array, ...]
    ) -> tuple[tuple[R, Value], None]:
        (recursion, skipped), (fresh, *columns) = carry, sample
        # The sum of the columns is NaN or infinite as soon as one of them is.
        possible = jnp.isfinite(sum(columns[1:], columns[0])) & (jnp.abs(columns[1]) <= LARGEST)
        taken = fresh & possible
        slip, adhesion, *others = (jnp.where(taken, column, 0.0) for column in columns)
        after = step(recursion, Sample(taken, slip, adhesion, (*others,)))
        return (after, skipped + jnp.where(fresh & ~taken, 1.0, 0.0)), None

    asked_for = (record.conditions[name] for name in conditions)
    samples = (record.fresh, record.slip, record.adhesion, *asked_for)
    # Counted in the type of the recursion: numbers of another width would slow the loop down.
    start = (state.recursion, jnp.zeros(()))
    (recursion, skipped), _ = jax.lax.scan(one_sample, start, samples)
    return state._replace(
        recursion=recursion,
        samples=jnp.sum(record.fresh, dtype=jnp.int32),
        skipped=skipped.astype(jnp.int32),
    )
