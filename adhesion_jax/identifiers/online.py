"""Methods that take one sample after the other: their state, their loop and what they report."""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar, NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, PRNGKeyArray

from adhesion_jax.curves import free_values
from adhesion_jax.identifiers.base import Estimate, Identifier, as_arrays
from adhesion_jax.identifiers.curve_fit import Fit, residual, to_estimate
from adhesion_jax.optim.arrays import Count, Matrix, Value, Vector, Whether
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
    step: Step[R], state: OnlineState, record: Record, conditions: Sequence[str]
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


class Found(NamedTuple):
    """What a recursion tells of the free parameters; x is NaN where it has overflowed."""

    x: Vector
    covariance: Matrix
    converged: Whether
    forgetting: Value  # factor by which earlier samples were last discounted


class OnlineMethod(Identifier):
    """A method with a curve whose recursion is `initial`, then one `step` a sample, then `found`.

    The three are functions of their arguments and the settings alone. The recursion of a method
    that resets itself has a field `reset`, whether it did in the last record.
    """

    FITS_LAST_RECORD = False

    #: Evaluations of the curve at each sample.
    EVALUATIONS: ClassVar[int] = 1

    @abstractmethod
    def initial(self, known: Known, key: PRNGKeyArray) -> Any:
        """The recursion before any data."""

    @abstractmethod
    def step(self, known: Known, recursion: Any, sample: Sample) -> Any:
        """The recursion after one more sample, or as it was where that is not taken."""

    @abstractmethod
    def found(self, known: Known, recursion: Any) -> Found:
        """What the recursion tells."""

    def init(self, known: Known, key: PRNGKeyArray) -> OnlineState:
        return begin(known, self.initial(known, key))

    def update(self, state: OnlineState, record: Record) -> OnlineState:
        known, recursion = state.known, state.recursion
        if self.RESETS:
            none = jnp.zeros((), dtype=bool)
            recursion = eqx.tree_at(lambda one: one.reset, recursion, none)
        state = state._replace(recursion=recursion)
        state = over_fresh_samples(partial(self.step, known), state, record, known.curve.NEEDS)
        misfit = residual(known, record, self.found(known, state.recursion).x)
        return state._replace(objective=jnp.sum(jnp.where(jnp.isfinite(misfit), misfit, 0.0) ** 2))

    def estimate(self, state: OnlineState) -> Estimate:
        known, recursion = state.known, state.recursion
        x, covariance, converged, forgetting = self.found(known, recursion)
        finite = jnp.all(jnp.isfinite(x))
        fit = Fit(
            jnp.where(finite, x, free_values(known.curve)),
            covariance,
            state.objective,
            self.EVALUATIONS * state.samples,
            converged,
            finite,
            state.skipped,
        )
        reset = recursion.reset if self.RESETS else jnp.zeros((), dtype=bool)
        return to_estimate(known, fit, forgetting, reset)


class SelectiveMethod(OnlineMethod):
    """A method that passes over the samples which tell it nothing.

    Slip and adhesion of a sample are made positive together, for curves are odd.
    """

    @abstractmethod
    def after(self, known: Known, recursion: Any, sample: Sample) -> Any:
        """The recursion after a sample that tells something."""

    def tells(self, recursion: Any, sample: Sample) -> Whether | bool:
        """Whether a sample tells anything; by default each does."""
        return True

    def step(self, known: Known, recursion: Any, sample: Sample) -> Any:
        slip, adhesion = sample.slip, sample.adhesion
        upright = jnp.where(slip < 0, -adhesion, adhesion)
        sample = sample._replace(slip=jnp.abs(slip), adhesion=upright)
        taken = sample.taken & self.tells(recursion, sample)
        after = self.after(known, recursion, sample)
        return jax.tree.map(lambda new, old: jnp.where(taken, new, old), after, recursion)
