"""What an identifier is: a stream that takes records and can be asked for an estimate."""

from abc import abstractmethod
from collections.abc import Mapping
from enum import IntEnum
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from adhesion_jax.metrics.tracking import Course, Tracking, start_tracking, track
from adhesion_jax.records import Known, Record
from adhesion_jax.scenarios import Scenario

State = Any  # each identifier carries its own
Carry = tuple[State, Tracking]


class Status(IntEnum):
    """Why an estimate may not be trusted; of several reasons the first of this list counts."""

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
    Status.NOT_FINITE: "The solver left the real numbers; the values are those it started from.",
    Status.INADMISSIBLE: "The curve gives no positive adhesion; the values are as found.",
    Status.NO_PEAK: "No peak between slip 0 and 1; mu_max is the largest adhesion in that range.",
    Status.NOT_CONVERGED: "The solver stopped before it converged; the values are its last.",
    Status.ON_BOX: "A parameter lies on its bound; standard errors are those without the bound.",
    Status.TRUSTED: "The solver converged to a peak inside the box.",
}


class Estimate(NamedTuple):
    """What every method reports.

    `values` are named scalars (c1, c2, c3, mu_max, slip_opt, or slope); metrics read these, so
    a method without a curve fits in. `covariance` is that of the values, in their order.
    """

    values: Mapping[str, Float[Array, "..."]]
    covariance: Float[Array, "... values values"]
    status: Int[Array, "..."]  # a Status
    objective: Float[Array, "..."]  # sum of squared residuals over the last record
    #: The factor its past was last discounted by: 0 at a reset, NaN for a method without a past.
    forgetting: Float[Array, "..."]
    evaluations: Int[Array, "..."]  # of the model on the whole record, for this update


class Identifier(eqx.Module):
    """A method: batch methods see one block at a time, online ones many points in turn.

    Its fields are its settings. Numbers among them may differ without a new compilation.
    """

    #: Whether it looks for the least sum of squares over the last record: only then is a gap to
    #: the exact optimum a failure.
    fits_last_record: eqx.AbstractClassVar[bool]

    @abstractmethod
    def accepts(self, scenario: Scenario) -> str | None:
        """None, or the reason why this method cannot work on the scenario."""

    @abstractmethod
    def init(self, known: Known, key: PRNGKeyArray) -> State:
        """The state before any data."""

    @abstractmethod
    def update(self, state: State, record: Record) -> State:
        """The state after one more record."""

    @abstractmethod
    def estimate(self, state: State) -> Estimate:
        """What is known now."""


def needs_blocks(scenario: Scenario) -> str | None:
    """None, or the reason why a method without a past cannot work on the scenario."""
    if not scenario.by_sample:
        return None
    return "it takes whole blocks, and this scenario gives one sample at a time"


def identify(identifier: Identifier, known: Known, blocks: Record, key: PRNGKeyArray) -> Estimate:
    """One run: the estimates after each of its blocks, arrays [blocks]."""

    def step(state: State, record: Record) -> tuple[State, Estimate]:
        state = identifier.update(state, record)
        return state, identifier.estimate(state)

    return jax.lax.scan(step, identifier.init(known, key), blocks)[1]


def follow(
    identifier: Identifier, known: Known, blocks: Record, key: PRNGKeyArray, course: Course
) -> tuple[Estimate, Tracking]:
    """`identify`, and what is seen of the method on its way, at every step.

    A step is a whole block or, where the course is by sample, one sample of it.
    """

    def one_step(carry: Carry, step: tuple[Array, Record]) -> tuple[Carry, Estimate]:
        (state, seen), (block, record) = carry, step
        state = identifier.update(state, record)
        estimate = identifier.estimate(state)
        mu_max = estimate.values.get("mu_max", jnp.asarray(jnp.nan))
        return (state, track(course, seen, block, mu_max, estimate.forgetting)), estimate

    def one_block(carry: Carry, numbered: tuple[Array, Record]) -> tuple[Carry, Estimate]:
        block, record = numbered
        steps = record.mask.shape[-1] if course.by_sample else 1
        parts = jax.tree.map(lambda x: x.reshape(steps, -1), record)
        carry, estimates = jax.lax.scan(one_step, carry, (jnp.full(steps, block), parts))
        last: Estimate = jax.tree.map(lambda x: x[-1], estimates)
        # The least of the factors, so that a reset between two reports is seen.
        return carry, last._replace(forgetting=jnp.min(estimates.forgetting))

    start = (identifier.init(known, key), start_tracking(course))
    count = blocks.mask.shape[-2]
    (_, seen), estimates = jax.lax.scan(one_block, start, (jnp.arange(count), blocks))
    return estimates, seen
