"""Errors of the signals: offsets, lateness, and the inertia in a torque."""

import jax.numpy as jnp

from adhesion_jax.effects.api import (
    AdhesionTransform,
    Conditions,
    Facts,
    Scalar,
    Signal,
    SlipTransform,
)
from adhesion_jax.effects.dynamic import (
    Dynamic,
    Lagging,
    State,
    Stepped,
    Value,
    has_history,
    now,
    rate,
    shifted,
)


class SlipBias(SlipTransform):
    """Burckhardt's curve changes as by a torque offset."""

    bias: Scalar

    FACTS = Facts(
        source="any odometry",
        described={"bias": ("1", -0.05, 0.05, "slip ratio that is missing")},
        strengths=("bias",),
        starts=({"bias": 5e-4},),
        needs=(),
        sentence="The wheel radius differs from the one that the slip was calculated with.",
        formula="mu(l + e sign(l)), e the bias of the slip ratio",
        phrase="a bias of the slip",
        family="offset",
        rests_on=("slip_ratio",),
        same_as=("torque_offset",),
        of_slip_alone=True,
    )

    def before(self, slip: Signal, conditions: Conditions) -> Signal:
        return slip + self.bias * jnp.sign(slip)


class TorqueOffset(AdhesionTransform):
    offset: Scalar

    FACTS = Facts(
        source="any measured driving torque",
        described={"offset": ("1", -0.5, 0.5, "adhesion that is added")},
        strengths=("offset",),
        starts=({"offset": 0.002},),
        needs=(),
        sentence="The force signal has an offset, such as the torque of losses.",
        formula="mu + b sign(l)",
        phrase="an offset of the force",
        family="offset",
        rests_on=("slip_ratio",),
        same_as=("slip_bias",),
        of_slip_alone=True,
    )
    ORDER = 3

    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        return adhesion + self.offset * jnp.sign(slip)


#: Number of samples that the step form keeps: a longer delay is cut to these.
_KEPT = 1024


class Delay(AdhesionTransform, Dynamic):
    delay: Scalar

    FACTS = Facts(
        source="any measuring chain with separate channels",
        described={"delay": ("s", -2.0, 5.0, "time by which adhesion is late")},
        strengths=("delay",),
        starts=tuple({"delay": delay} for delay in (0.05, 0.15, 0.4, 1.0)),
        needs=("time_s",),
        sentence="The adhesion signal comes later than the slip signal.",
        formula="mu(t - d), d in s; negative where the slip signal is the late one",
        phrase="a delay between the signals",
        family="in time",
    )
    ORDER = 3

    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        return shifted(adhesion, self.delay, conditions)

    def init(self, adhesion: Value, slip: Value, conditions: Conditions) -> State:
        times = jnp.full(_KEPT, now(conditions))
        return times - jnp.arange(_KEPT)[::-1], jnp.full(_KEPT, adhesion)

    def step(self, state: State, adhesion: Value, slip: Value, conditions: Conditions) -> Stepped:
        times, values = state
        # A second sample at the same time replaces the first.
        again = now(conditions) == times[-1]
        times = jnp.where(again, times, jnp.append(times[1:], now(conditions)))
        values = jnp.where(again, values.at[-1].set(adhesion), jnp.append(values[1:], adhesion))
        return (times, values), jnp.interp(now(conditions) - self.delay, times, values)


class Lag(Lagging):
    time_constant: Scalar

    FACTS = Facts(
        source="any filtered signal",
        described={"time_constant": ("s", 0.0, 20.0, "time constant of the filter")},
        strengths=("time_constant",),
        starts=tuple({"time_constant": time} for time in (0.05, 0.2, 0.6, 1.5, 5.0, 15.0)),
        needs=("time_s",),
        sentence="The adhesion signal passes a first-order filter.",
        formula="T dmu/dt + mu = mu_steady, T in s",
        phrase="a lag of the adhesion signal",
        family="in time",
    )

    def time(self, conditions: Conditions) -> Scalar:
        return self.time_constant


class Inertia(AdhesionTransform, Dynamic):
    """k = J/(r^2 F), J the moment of inertia of what turns."""

    k: Scalar

    FACTS = Facts(
        source="Newton; Voltr and Lata 2015, Veh. Syst. Dyn. 53:605-618",
        described={"k": ("s^2/m", -1.0, 1.0, "rotating mass over load")},
        strengths=("k",),
        starts=({"k": 0.003},),
        needs=("vehicle_speed_mps", "acceleration_mps2", "time_s"),
        sentence="The torque that accelerates the wheel was taken for adhesion.",
        formula="mu + k d(V (1 + l))/dt, the circumferential acceleration of the wheel in m/s^2",
        phrase="inertia of the wheel",
        family="in time",
    )
    ORDER = 3

    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        if not has_history(conditions):
            return adhesion
        # The speed is noisy, the slip is not: their rates are taken over different times.
        slipping = conditions["vehicle_speed_mps"] * rate(slip, conditions)
        rolling = conditions["acceleration_mps2"] * (1 + slip)
        return adhesion + self.k * (slipping + rolling)

    def init(self, adhesion: Value, slip: Value, conditions: Conditions) -> State:
        return now(conditions), slip

    def step(self, state: State, adhesion: Value, slip: Value, conditions: Conditions) -> Stepped:
        time, before = state
        passed = now(conditions) - time
        rate = (slip - before) / jnp.where(passed > 0, passed, jnp.inf)
        rolling = conditions["acceleration_mps2"] * (1 + slip)
        change = self.k * (conditions["vehicle_speed_mps"] * rate + rolling)
        return (now(conditions), slip), adhesion + change
