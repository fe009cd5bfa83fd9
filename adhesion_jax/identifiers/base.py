"""The contract of an identifier: it takes records one by one and gives an estimate at any time."""

from abc import abstractmethod
from collections.abc import Mapping
from enum import IntEnum
from typing import Any, ClassVar, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from adhesion_jax.curves import content_hash
from adhesion_jax.metrics.tracking import Tracker, Tracking
from adhesion_jax.optim.arrays import Whether
from adhesion_jax.records import Known, Record
from adhesion_jax.runtime import require_double_precision

S = TypeVar("S")

Flag = bool | Whether
State = Any  # each identifier carries its own
Carry = tuple[State, Tracking]


class Status(IntEnum):
    """Why an estimate may not be trusted; if several reasons apply, the first of this list."""

    NOT_FINITE = 5
    INADMISSIBLE = 4
    NO_PEAK = 3
    NOT_CONVERGED = 2
    ON_BOX = 1
    TRUSTED = 0

    @property
    def sentence(self) -> str:
        return _SENTENCES[self]


_SENTENCES = {
    Status.NOT_FINITE: (
        "The solver produced NaN or infinity; the previous estimate, or the start, is reported."
    ),
    Status.INADMISSIBLE: "The curve gives no positive adhesion; the values are reported as found.",
    Status.NO_PEAK: (
        "No peak between slip 0 and the largest slip asked for; "
        "mu_max is the largest adhesion in that range."
    ),
    Status.NOT_CONVERGED: (
        "The solver stopped before it converged; the values are those of its last step."
    ),
    Status.ON_BOX: "A parameter lies on its bound; standard errors are those without the bound.",
    Status.TRUSTED: "The solver converged to a peak inside the box.",
}


class Estimate(NamedTuple):
    """What every method reports.

    Under `jax.jit` only what is used of an estimate is computed: a controller that reads slip_opt
    at every sample does not pay for the covariance.

    Attributes:
        values: named scalars (c1, c2, c3, mu_max, slip_opt, or slope); metrics read these, so that
            a method without a curve fits in.
        covariance: that of the values, in their order.
        status: a Status, why the estimate may not be trusted.
        objective: sum of squared residuals over the last record.
        reset: whether earlier data were discarded within the last record.
        forgetting: factor by which earlier data were last discounted; NaN for a method without.
        evaluations: of the model on the whole record, for this update.
        skipped: points of the last record left out as not finite, or as no adhesion of a contact.
    """

    values: Mapping[str, Float[Array, "..."]]
    covariance: Float[Array, "... values values"]
    status: Int[Array, "..."]
    objective: Float[Array, "..."]
    reset: Bool[Array, "..."]
    forgetting: Float[Array, "..."]
    evaluations: Int[Array, "..."]
    skipped: Int[Array, "..."]


class Identifier(eqx.Module):
    """A method: batch methods see one block at a time, online ones many points in turn.

    Its fields are its settings. Numbers among them may differ without a new compilation.
    """

    __hash__ = content_hash

    #: Whether it minimises the sum of squares over the last record: only then is a gap to the
    #: exact optimum a failure.
    FITS_LAST_RECORD: eqx.AbstractClassVar[bool]

    #: Whether it may discard all earlier data at once, when new data contradict them.
    RESETS: eqx.AbstractClassVar[bool]

    #: Whether its estimates use all blocks since the rail last changed rather than the last one
    #: alone: they are then held against the bound of all these blocks.
    POOLS: ClassVar[bool] = False

    #: Whether its standard errors allow for noise with a memory, whose correlation it estimates.
    KNOWS_MEMORY: ClassVar[bool] = False

    @abstractmethod
    def accepts(self, known: Known) -> str | None:
        """None, or the reason why this method cannot work on what is known and asked."""

    @abstractmethod
    def init(self, known: Known, key: PRNGKeyArray) -> State:
        """The state before any data."""

    @abstractmethod
    def update(self, state: State, record: Record) -> State:
        """The state after one more record."""

    @abstractmethod
    def estimate(self, state: State) -> Estimate:
        """The estimate after the records so far."""


def as_arrays(state: S) -> S:
    """The initial state with every leaf in its final dtype, so that a scan compiles once.

    InputError where jax computes in single precision.
    """
    require_double_precision()
    arrays = jax.tree.map(jnp.asarray, state)
    return jax.tree.map(lambda array: jax.lax.convert_element_type(array, array.dtype), arrays)


def needs_blocks(known: Known) -> str | None:
    """None, or the reason why a method that uses whole blocks alone cannot work on this."""
    if not known.by_sample:
        return None
    return "it takes whole blocks, and here samples come one at a time"


def identify(identifier: Identifier, known: Known, blocks: Record, key: PRNGKeyArray) -> Estimate:
    """One run: the estimates after each of its blocks, arrays [blocks]."""

    def step(state: State, record: Record) -> tuple[State, Estimate]:
        state = identifier.update(state, record)
        return state, identifier.estimate(state)

    return jax.lax.scan(step, identifier.init(known, key), blocks)[1]


def follow(
    identifier: Identifier, known: Known, blocks: Record, key: PRNGKeyArray, tracker: Tracker
) -> tuple[Estimate, Tracking]:
    """The estimates of `identify`, and the tracking after every step of the method.

    A step is a whole block or, where `known.by_sample`, one sample of it. `reset`, `forgetting`
    and `skipped` of an estimate are those of all the steps since the one before: any reset, the
    least factor, the sum.
    """

    def one_step(carry: Carry, step: tuple[Array, Record]) -> tuple[Carry, Estimate]:
        (state, seen), (block, record) = carry, step
        state = identifier.update(state, record)
        now = identifier.estimate(state)
        seen = tracker.update(seen, block, now.values, now.reset)
        return (state, seen), now

    def one_sample(carry: Carry, step: tuple[Array, Record]) -> tuple[Carry, tuple[Array, ...]]:
        carry, now = one_step(carry, step)
        return carry, (now.reset, now.forgetting, now.skipped)

    def all_samples(carry: Carry, numbered: tuple[Array, Record]) -> tuple[Carry, Estimate]:
        block, record = numbered
        samples = record.mask.shape[-1]
        parts = jax.tree.map(lambda x: x.reshape(samples, 1), record)
        carry, (reset, forgetting, skipped) = jax.lax.scan(
            one_sample, carry, (jnp.full(samples, block), parts)
        )
        return carry, identifier.estimate(carry[0])._replace(
            reset=jnp.any(reset),
            forgetting=jnp.min(forgetting),
            skipped=jnp.sum(skipped, dtype=jnp.int32),
        )

    start = (identifier.init(known, key), tracker.init())
    count = blocks.mask.shape[-2]
    one_block = all_samples if known.by_sample else one_step
    (_, seen), estimates = jax.lax.scan(one_block, start, (jnp.arange(count), blocks))
    return estimates, seen
