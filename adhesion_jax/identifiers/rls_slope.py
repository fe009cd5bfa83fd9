"""Fang et al. 2018: the slope of the adhesion curve by recursive least squares, without a curve."""

from collections import OrderedDict
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from adhesion_jax.curves import Scalar
from adhesion_jax.identifiers.base import Estimate, Identifier, Status
from adhesion_jax.identifiers.online import OnlineState, Sample, begin, over_fresh_samples
from adhesion_jax.optim.arrays import Value
from adhesion_jax.optim.kalman import slope_step
from adhesion_jax.records import Known, Record

#: Variance of the slope at the start, per unit of the noise variance: so large that the start does
#: not matter.
_DIFFUSE = 1e12


class SlopeRecursion(NamedTuple):
    """The filters, the recursion, and the covariance of its error per unit of the noise.

    `uu`, `ud` and `dd` are E u^2, E u d and E d^2, u the noise that is left in the filtered
    adhesion, d the error of theta.
    """

    time: Value  # of the last sample, s; NaN before the first
    adhesion: Value  # filtered
    slip_velocity: Value  # filtered, m/s
    theta: Value  # s/m
    p: Value
    kappa: Value
    residual: Value  # of the last sample, 1/s
    uu: Value
    ud: Value
    dd: Value
    squares: Value  # sum of squared innovations over their variance per unit of noise
    samples: Value  # that gave an innovation


class RecursiveSlope(Identifier):
    """Theta = d mu/d v_s from y = d mu/dt = theta phi, phi = d v_s/dt (Eq. 11 and 12).

        theta <- theta - P phi (theta phi - y)/(1 + phi^2 P),
        P <- (1/kappa) (P - P^2 phi^2/(1 + phi^2 P)), kappa = 1/(1 + gamma phi^2).

    The forgetting factor kappa tends to one where the slip velocity rests, so P does not wind up;
    at constant phi, P tends to gamma and, for white noise s in y, var(theta) to
    gamma s^2/(2 + gamma phi^2): the memory is 1/(gamma phi^2) samples.

    mu and v_s pass the same first-order low-pass before they are differenced; unequal filters
    would bias the slope. The noise of such a derivative is not white, so the covariance reported
    is carried through filter and recursion instead, with the noise of a sample estimated from the
    innovations. It contains neither the lag behind a slope that changes nor the noise of v_s in
    phi, which lowers the slope by the share of that noise in E phi^2.
    """

    FITS_LAST_RECORD = False
    RESETS = False

    gamma: Scalar  # s^4/m^2
    time_constant: Scalar  # of the low-pass, s

    def accepts(self, known: Known) -> str | None:
        if "slope" in known.asked:
            return None
        return "it gives the slope of the curve alone, which is not asked for here"

    def init(self, known: Known, key: PRNGKeyArray) -> OnlineState:
        zero, one, none = jnp.zeros(()), jnp.ones(()), jnp.asarray(jnp.nan)
        p = jnp.asarray(_DIFFUSE)
        return begin(
            known, SlopeRecursion(none, zero, zero, zero, p, one, zero, one, zero, p, zero, zero)
        )

    def update(self, state: OnlineState, record: Record) -> OnlineState:
        names = ("slip_velocity_mps", "time_s")
        state = over_fresh_samples(self._step, state, record, names)
        return state._replace(objective=state.recursion.residual**2)

    def estimate(self, state: OnlineState) -> Estimate:
        recursion: SlopeRecursion = state.recursion
        variance = recursion.squares / jnp.maximum(recursion.samples, 1.0) * recursion.dd
        return Estimate(
            OrderedDict(slope=recursion.theta),
            variance[None, None],
            jnp.where(recursion.samples > 0, Status.TRUSTED.value, Status.NOT_CONVERGED.value),
            state.objective,
            jnp.zeros((), dtype=bool),
            recursion.kappa,
            state.samples,
            state.skipped,
        )

    def _step(self, state: SlopeRecursion, sample: Sample) -> SlopeRecursion:
        taken, _, adhesion, (slip_velocity, time) = sample
        first = jnp.isnan(state.time)
        span = jnp.where(first, 1.0, time - state.time)
        share = -jnp.expm1(-span / self.time_constant)
        rise = share / span
        # The filters begin at the first sample, which has no derivative yet.
        y = jnp.where(first, 0.0, rise * (adhesion - state.adhesion))
        phi = jnp.where(first, 0.0, rise * (slip_velocity - state.slip_velocity))

        found = slope_step(state.theta, state.p, y, phi, jnp.asarray(self.gamma))
        gain, innovation = found.gain, found.innovation

        # The noise of y is rise (e - u), where e is the noise of the sample; the innovation has
        # the error of theta in it besides: rise (e - u) - d phi.
        kept, keep = 1 / found.scale, 1 - share
        uu, ud, dd = state.uu, state.ud, state.dd
        unit = rise**2 * (1 + uu) + phi**2 * dd + 2 * rise * phi * ud
        later = SlopeRecursion(
            time=time,
            adhesion=state.adhesion + span * y,
            slip_velocity=state.slip_velocity + span * phi,
            theta=found.theta,
            p=found.p,
            kappa=found.kappa,
            residual=y - found.theta * phi,
            uu=keep**2 * uu + share**2,
            ud=keep * (kept * ud - gain * rise * uu) + share * gain * rise,
            dd=kept**2 * dd - 2 * kept * gain * rise * ud + (gain * rise) ** 2 * (1 + uu),
            squares=state.squares + innovation**2 / unit,
            samples=state.samples + 1,
        )
        begun = state._replace(time=time, adhesion=adhesion, slip_velocity=slip_velocity)
        after = jax.tree.map(lambda a, b: jnp.where(first, a, b), begun, later)
        return jax.tree.map(lambda new, old: jnp.where(taken, new, old), after, state)


#: gamma and the time constant are not printed; these are our choice. If the slip velocity changes
#: by 1 m/s^2 and samples are 10 ms apart, the filter reaches back 0.1 s and the recursion 3 samples
#: more. On fang2018-slope a longer memory adds more error by its lag than it saves in noise.
rls_slope = RecursiveSlope(gamma=0.3, time_constant=0.1)
