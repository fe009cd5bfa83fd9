"""Control of the slip that will be there once the torque on its way has come."""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.controllers.base import Controller, at_least, followed, torque_for
from adhesion_jax.traction.driver import lowered
from adhesion_jax.traction.filters import Swing, lagged
from adhesion_jax.traction.plants.base import Plant, limited
from adhesion_jax.traction.signals import PerAxle, Setting, Signals

#: Command and torque pass this lag before they are compared, so that noise tells no delay, s.
_SMOOTH = 0.03

#: The memory of the delay of the drive, and of the torque that is on its way, s.
_MEMORY, _FADE = 3.0, 0.02

#: The longest delay that is believed, s, and the rate of torque in N m/s of which it is learned.
_LONGEST, _LIVELY = 0.04, 1e3

#: A drive later than known by this time, a third of a turn at 30 Hz, drives the twist that it would
#: damp, s; and the least torque that swings are weighed against, as a share of the largest.
_LATE, _LEAST = 0.01, 0.1


class AnticipatingState(NamedTuple):
    command: PerAxle  # as the drive may follow it, N m
    smooth_command: PerAxle
    smooth_torque: PerAxle
    asked: PerAxle  # sum of (T_cmd - T) dT/dt, which fades
    moved: PerAxle  # sum of (dT/dt)^2
    coming: PerAxle  # torque times time that was commanded and has not come, N m s
    swing: Swing  # of the torque wanted


class Anticipating(Controller):
    """T = T_L + (i J/r)(dV + dv* - k z^), z^ = z + (r/(i J)) (q - d T_L), z = v_s - v*.

    q is the integral of T_cmd - T, T as the drive reports it, and fades towards d T: torque that is
    commanded and has not come. Whatever lag and dead time the drive has, (i J/r) dz^ = T_cmd - T_L
    for a constant load. d is the delay of the drive by least squares that forget, from
    T_cmd - T = d dT/dt, not below the known lag; k = min(gain, share/d). As d grows beyond the
    known lag, strong swings of T in the band of an axle's twist are taken out of it: a torque that
    would damp them drives them where it is late.
    """

    gain: Setting = 100.0  # 1/s
    share: Setting = 1.5  # of the delay, in 1
    least: Setting = -0.3  # torque, as a share of the largest

    BOX: ClassVar = {"gain": Range(20.0, 150.0, log=True), "share": Range(0.3, 2.0, log=True)}

    def init(self, nominal: Plant, signals: Signals) -> AnticipatingState:
        none = jnp.zeros_like(signals.slip)
        return AnticipatingState(none, none, none, none, none, none, Swing.still(none))

    def update(
        self, state: AnticipatingState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[AnticipatingState, PerAxle]:
        known = nominal.torque_lag + nominal.dead_time
        torque = signals.torque
        command = lagged(state.smooth_command, state.command, _SMOOTH, period)
        smooth = lagged(state.smooth_torque, torque, _SMOOTH, period)
        rate = (smooth - state.smooth_torque) / period
        kept = 1 - period / _MEMORY
        middle = (smooth + state.smooth_torque) / 2
        asked = kept * state.asked + period * (command - middle) * rate
        moved = kept * state.moved + period * rate**2
        prior = period * _LIVELY**2
        delay = jnp.clip((asked + known * prior) / (moved + prior), known, _LONGEST)
        coming = state.coming + period * (state.command - torque)
        coming = lagged(coming, delay * torque, _FADE, period)

        wanted = followed(signals)
        turning = nominal.gear_ratio * nominal.inertia / nominal.radius
        error = signals.slip - wanted.slip + (coming - delay * signals.load) / turning
        gain = jnp.minimum(self.gain, self.share / delay)
        torque = torque_for(nominal, signals, wanted.rate - gain * error)
        swing = state.swing.after(torque, period)
        late = jnp.minimum((delay - known) / _LATE, 1.0)
        torque = torque - late * swing.strength(_LEAST * nominal.torque_limit) * swing.band
        torque = at_least(self.least, nominal, signals, torque)
        acting = limited(nominal, lowered(signals.demand, torque), signals.motor_speed)
        return AnticipatingState(acting, command, smooth, asked, moved, coming, swing), torque
