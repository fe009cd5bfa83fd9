import jax.numpy as jnp

from adhesion_jax.effects.api import AdhesionTransform, Conditions, Facts, Scalar, Signal
from adhesion_jax.effects.dynamic import Dynamic, State, Stepped, Value, has_history, now, rate


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
    ORDER = 2

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
