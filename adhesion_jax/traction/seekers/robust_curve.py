"""The curve with an offset, which tells a change of the rail from noise and from chatter."""

from typing import NamedTuple, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.filters import Swing, lagged
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Peak, Seeker
from adhesion_jax.traction.seekers.offset_curve import (
    MeanCurve,
    OffsetCurve,
    OffsetCurveState,
    Sums,
)
from adhesion_jax.traction.signals import PerAxle, Reference, Signals

T = TypeVar("T")

#: The time constants of the squared misfit, by which a change is told from noise, and of the misfit
#: to the old curve in s; and the multiple of the root of the former that a change exceeds.
_USUAL, _MISFIT, _UNUSUAL = 0.3, 0.005, 3.0

#: If the samples of the second half of this time in s lie on the old curve, there was no change.
_SURE = 0.15

#: Where slip went beyond so many times v* meanwhile, the axle chattered: so much of v* is left, and
#: it may rise again with this time constant in s.
_AWAY, _LESS, _LIFTED = 2.0, 0.85, 20.0

#: The least adhesion that swings are weighed against, and how long in s an axle has chattered until
#: nothing is learned of it: a drive that is not late ends it sooner by what is learned.
_LEAST, _LONG = 0.03, 0.1

#: v* stays until this share of it has been seen as slip.
_SEEN = 0.5


class Doubted(NamedTuple):
    """What was known at the latest change, until it is sure to be one."""

    sums: Sums
    curve: MeanCurve
    known: Bool[Array, " axles"]
    asked: PerAxle  # m/s
    misfit: PerAxle  # of the samples since to the old curve, with a lag
    worst: PerAxle  # largest square of it
    furthest: PerAxle  # largest slip, m/s


class RobustCurveState(NamedTuple):
    curve: OffsetCurveState
    usual: PerAxle  # square of the misfit, with a lag
    before: Doubted
    ceiling: PerAxle  # of v*, m/s
    swing: Swing  # of adhesion
    rings: PerAxle  # for so long it has swung strongly, s


class RobustCurve(Seeker):
    """The seeker `OffsetCurve`, but for what it takes for a change, and what it asks for then.

    A misfit is a change where it exceeds sqrt(threshold^2 + 9 s^2), s its root mean square of late:
    on a steep curve noise of slip is a misfit of adhesion. Past the peak the contact drives the
    torsion of an axle, whose slip breaks away and comes back without a change of the rail: where
    the samples from .075 to .15 s later lie on the old curve it is taken up again, and v* stays
    below what it was. As long as adhesion swings v* does not rise, and after .1 s of that nothing
    is learned until it is over. Where v* is not yet half seen, as while the drive answers late, it
    stays.
    """

    curve: OffsetCurve

    @property
    def box(self) -> dict[str, Range]:
        return {f"curve.{name}": one for name, one in self.curve.box.items()}

    def init(self, nominal: Plant, signals: Signals) -> RobustCurveState:
        curve, none = self.curve.init(nominal, signals), jnp.zeros_like(signals.slip)
        swing = Swing.still(none)
        return RobustCurveState(curve, none, _doubted(curve), none + jnp.inf, swing, none)

    def update(
        self, state: RobustCurveState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[RobustCurveState, Reference]:
        old = state.curve
        most = self.curve.threshold**2 + _UNUSUAL**2 * state.usual
        seeker = eqx.tree_at(lambda one: one.threshold, self.curve, jnp.sqrt(most))
        curve, asked = seeker.update(old, nominal, signals, period)
        changed = curve.since < old.since
        slip, adhesion = (
            signals.direction * one for one in (signals.slip_beside, signals.adhesion)
        )

        swing = state.swing.after(adhesion, period)
        rings = jnp.where(swing.strength(_LEAST) > 0.5, state.rings + period, 0.0)
        held = (rings > _LONG) & (curve.since < _SURE)
        curve = curve._replace(since=jnp.where(held, 0.0, curve.since))

        before = state.before
        misfit = lagged(before.misfit, adhesion - before.curve.of(slip), _MISFIT, period)
        before = before._replace(
            misfit=misfit,
            worst=jnp.where(curve.since > _SURE / 2, jnp.maximum(before.worst, misfit**2), 0.0),
            furthest=jnp.maximum(before.furthest, slip),
        )
        before = _chosen(changed, _doubted(old), before)

        due = (curve.since >= _SURE) & (curve.since - period < _SURE)
        taken_back = due & before.known & (before.worst < most)
        away = before.furthest > _AWAY * before.asked
        left = jnp.where(away, _LESS, 1.0) * before.asked
        ceiling = jnp.where(due & ~taken_back, jnp.inf, state.ceiling * (1 + period / _LIFTED))
        ceiling = jnp.where(taken_back & away, left, ceiling)
        unseen = ~changed & (curve.seen[1] < _SEEN * old.asked)
        wanted = jnp.where(unseen, old.asked, curve.asked)
        curve = curve._replace(
            sums=_chosen(taken_back, before.sums, curve.sums),
            curve=_chosen(taken_back, before.curve, curve.curve),
            known=curve.known | taken_back,
            asked=jnp.minimum(
                jnp.where(taken_back, left, wanted), jnp.where(rings > 0, old.asked, ceiling)
            ),
        )
        usual = lagged(state.usual, jnp.minimum(curve.misfit**2, most), _USUAL, period)
        return RobustCurveState(curve, usual, before, ceiling, swing, rings), asked

    def identified(self, state: RobustCurveState) -> Peak:
        return self.curve.identified(state.curve)


def _doubted(curve: OffsetCurveState) -> Doubted:
    none = jnp.zeros_like(curve.asked)
    return Doubted(curve.sums, curve.curve, curve.known, curve.asked, none, none, none)


def _chosen(which: Bool[Array, " axles"], one: T, other: T) -> T:
    """One of two for each axle, whose numbers lie along the first axis."""

    def of(a: Array, b: Array) -> Array:
        return jnp.where(which.reshape(-1, *(1,) * (b.ndim - 1)), a, b)

    return jax.tree.map(of, one, other)
