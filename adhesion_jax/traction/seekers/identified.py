"""Any identifier as a seeker: v* is the slip of the peak that it finds, as far as it is sure."""

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from adhesion_jax.curves import with_free_values
from adhesion_jax.identifiers.base import Estimate, Identifier, Status
from adhesion_jax.records import Known, Record
from adhesion_jax.traction.box import Range
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Peak, Seeker
from adhesion_jax.traction.signals import PerAxle, Reference, Setting, Signals

#: Turns of the dither in a second.
_TURNS = 2.0

#: An estimate whose slip has a larger relative standard error than this is not trusted.
_DOUBTED = 0.3

#: Times in s after a change of the rail: for the first v* is held, and none is seen in the second.
_HELD, _LOCKED_OUT = 0.05, 0.5

#: What is left of v* where the new rail has less adhesion, but not below half of the start.
_BACK = 0.6

#: A sample whose slip changes faster than this is left out, m/s^2: the observer's lag takes it off
#: the curve.
_HURRY = 6.0

#: While no peak is trusted, v* follows the slope: its logarithm by `_PROBED` a second at most, and
#: at most where the relative slope d log mu/d log v_s is `_STEEP`.
_PROBED, _STEEP = 3.0, 0.1


class IdentifiedState(NamedTuple):
    identifier: Any  # of each axle
    record: Float[Array, "3 axles samples"]  # slip and adhesion of the latest, 1 where they count
    slip: PerAxle  # at the last control sample, m/s
    peak: Peak
    asked: PerAxle  # v* without dither, m/s
    trusted: Bool[Array, " axles"]
    since: PerAxle  # the last change of the rail, s
    number: Int[Array, ""]  # of control samples so far


class Identified(Seeker):
    """v* = slip_opt of the identifier, with a dither v* (1 + d sin(4 pi t)).

    Slip and adhesion have the same lag, and samples whose slip changes fast are left out. One is
    taken every `spacing`, because the noise within a loop has a memory of some milliseconds, and
    `block` of them make a record. An estimate that is not finite, gives no peak, or is unsure of
    its slip by more than 30 %, is not followed: v* stays or, where it tells a curve all the same,
    creeps up the slope of that. d is the relative standard error of the slip, within a fifth of
    `dither` and `dither`, and `dither` without trust. After a change of the rail v* is held for
    50 ms, lower than before where the adhesion fell, and no other change is seen for .5 s. A change
    is a reset of the identifier or, with one that has none, a mean residual of a record above
    `threshold`, which then begins it anew.
    """

    identifier: Identifier
    known: Known  # of the curve in m/s
    dither: Setting
    start: Setting  # m/s
    threshold: Setting  # of adhesion
    spacing: float = eqx.field(static=True)  # s
    block: int = eqx.field(static=True)
    ranges: tuple[tuple[str, Range], ...] = eqx.field(static=True)  # of numbers of the identifier

    BOX: ClassVar = {"dither": Range(0.02, 0.2, log=True)}

    @property
    def box(self) -> Mapping[str, Range]:
        own = {} if self.identifier.RESETS else {"threshold": Range(0.004, 0.05, log=True)}
        return {**self.BOX, **own, **dict(self.ranges)}

    def init(self, nominal: Plant, signals: Signals) -> IdentifiedState:
        none = jnp.zeros_like(signals.slip)
        unknown = none + jnp.nan
        return IdentifiedState(
            self._begun(none),
            jnp.zeros((3, none.size, self.block)),
            signals.slip_beside,
            Peak(unknown, unknown, unknown, unknown),
            none + self.start,
            jnp.zeros(none.size, dtype=bool),
            none + _HELD,
            jnp.zeros((), dtype=int),
        )

    def _begun(self, axles: PerAxle) -> Any:
        """The identifier of each axle before any data."""
        one = self.identifier.init(self.known, jax.random.key(0))
        return jax.tree.map(lambda x: jnp.broadcast_to(x, (axles.size, *x.shape)), one)

    def update(
        self, state: IdentifiedState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[IdentifiedState, Reference]:
        sign = signals.direction
        every = max(round(self.spacing / period), 1)
        calm = jnp.abs(signals.slip_beside - state.slip) < _HURRY * period
        sample = jnp.stack([sign * signals.slip_beside, sign * signals.adhesion, 1.0 * calm])

        def taken(state: IdentifiedState) -> IdentifiedState:
            record = jnp.concatenate([state.record[..., 1:], sample[..., None]], axis=-1)
            state = state._replace(record=record)
            full = state.number % (every * self.block) == 0
            learned = lambda state: self._learned(state, every * self.block * period)  # noqa: E731
            return jax.lax.cond(full, learned, lambda state: state, state)

        state = state._replace(
            number=state.number + 1, since=state.since + period, slip=signals.slip_beside
        )
        # Counted alike in all runs, so that what is not due costs nothing in any of them.
        state = jax.lax.cond(state.number % every == 0, taken, lambda state: state, state)
        unsure = jnp.clip(state.peak.slip_error / state.peak.slip, 0.2 * self.dither, self.dither)
        size = jnp.where(state.trusted & jnp.isfinite(unsure), unsure, self.dither)
        turn = 2 * jnp.pi * _TURNS
        angle = turn * state.number * period
        slip = state.asked * (1 + size * jnp.sin(angle))
        rate = state.asked * size * turn * jnp.cos(angle)
        return state, Reference(sign * slip, sign * rate)

    def identified(self, state: IdentifiedState) -> Peak:
        return state.peak

    def _learned(self, state: IdentifiedState, time: float) -> IdentifiedState:
        """The state after a full record, `time` seconds after the one before."""
        slips, adhesions, calm = state.record
        fresh = calm > 0
        records = Record(slips, adhesions, fresh, fresh, {})
        before = jax.vmap(self.identifier.estimate)(state.identifier)
        identifier = jax.vmap(self.identifier.update)(state.identifier, records)
        found = jax.vmap(self.identifier.estimate)(identifier)
        may = state.since >= _LOCKED_OUT
        changed = found.reset & may
        misfit = jnp.mean(adhesions - self._adhesion(before, slips), axis=-1)
        if not self.identifier.RESETS:
            changed = may & state.trusted & (jnp.abs(misfit) > self.threshold)
            identifier = jax.tree.map(
                lambda new, old: jnp.where(changed.reshape(-1, *[1] * (old.ndim - 1)), new, old),
                self._begun(state.asked),
                identifier,
            )
        peak = _peak(found)
        sure = ~(peak.slip_error > _DOUBTED * peak.slip)
        trusted = (found.status <= Status.ON_BOX) & (peak.slip > 0) & sure & ~changed
        since = jnp.where(changed, 0.0, state.since)
        # The slope of a curve without a peak, over a tenth of the slip.
        around = state.asked[:, None] * jnp.array([0.95, 1.0, 1.05])
        left, middle, right = jnp.moveaxis(self._adhesion(found, around), -1, 0)
        uphill = (right - left) / (0.1 * jnp.maximum(middle, 1e-3))
        step = time * _PROBED * jnp.clip(uphill / _STEEP, -1.0, 1.0)
        probes = (found.status <= Status.NO_PEAK) & jnp.isfinite(step)
        probes = probes & (found.status != Status.NOT_CONVERGED)
        probed = state.asked * jnp.exp(jnp.where(probes, step, 0.0))
        asked = jnp.where(trusted, peak.slip, probed)
        back = jnp.maximum(_BACK * state.asked, jnp.minimum(state.asked, self.start / 2))
        held = jnp.where(changed & (misfit < 0), back, state.asked)
        return state._replace(
            identifier=identifier,
            peak=jax.tree.map(lambda new, old: jnp.where(trusted, new, old), peak, state.peak),
            asked=jnp.where(since < _HELD, held, asked),
            trusted=trusted,
            since=since,
        )

    def _adhesion(
        self, found: Estimate, slips: Float[Array, "axles samples"]
    ) -> Float[Array, "axles samples"]:
        """That of the curves found."""
        values = jnp.stack([found.values[name] for name in self.known.curve.free], axis=-1)
        curves = jax.vmap(lambda x, slip: with_free_values(self.known.curve, x)(slip, {}))
        return curves(values, slips)


def _peak(found: Estimate) -> Peak:
    """The peaks of some estimates [axles], with their standard errors."""
    names = [*found.values]
    errors = jnp.sqrt(jnp.diagonal(found.covariance, axis1=-2, axis2=-1))
    slip, adhesion = (names.index(name) for name in ("slip_opt", "mu_max"))
    return Peak(
        found.values["slip_opt"], found.values["mu_max"], errors[..., slip], errors[..., adhesion]
    )
