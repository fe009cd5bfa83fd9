import jax.numpy as jnp

from adhesion_jax.effects.api import Conditions, Facts, Multiplier, Scalar, Values
from adhesion_jax.effects.dynamic import (
    Dynamic,
    Filtered,
    State,
    Stepped,
    Value,
    filtered,
    lagged,
    now,
    rate,
)


class Hysteresis(Multiplier, Dynamic):
    k: Scalar
    rate: Scalar
    memory: Scalar

    FACTS = Facts(
        source="Zhang et al. 2002; Trummer et al. 2017, Wear 378:1-9",
        described={
            "k": ("1", -0.9, 0.9, "relative difference, rising less steady"),
            "rate": ("1/s", 1e-05, 10.0, "slip rate of full effect"),
            "memory": ("s", 0.0, 5.0, "time it takes to turn"),
        },
        strengths=("k",),
        starts=tuple(
            {"k": 0.03, "rate": rate, "memory": 0.02} for rate in (0.001, 0.005, 0.02, 0.1)
        ),
        needs=("time_s",),
        sentence="Adhesion differs between rising and falling slip.",
        formula="mu (1 + k h), T dh/dt + h = tanh((d|l|/dt)/s), s in 1/s, T the memory in s",
        phrase="hysteresis",
        family="in time",
        rests_on=("slip_ratio", "time_s"),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        direction = jnp.tanh(rate(jnp.abs(slip), conditions) / self.rate)
        return 1 + self.k * lagged(direction, self.memory, conditions)

    def init(self, adhesion: Value, slip: Value, conditions: Conditions) -> State:
        nothing = jnp.zeros(())
        return Filtered(now(conditions), nothing, nothing), jnp.abs(slip)

    def step(self, state: State, adhesion: Value, slip: Value, conditions: Conditions) -> Stepped:
        turning, before = state
        passed = now(conditions) - turning.time
        change = (jnp.abs(slip) - before) / jnp.where(passed > 0, passed, jnp.inf)
        turning = filtered(turning, jnp.tanh(change / self.rate), self.memory, now(conditions))
        return (turning, jnp.abs(slip)), adhesion * (1 + self.k * turning.value)
