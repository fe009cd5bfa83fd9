import jax.numpy as jnp

from adhesion_jax.effects.api import Conditions, Facts, Multiplier, Scalar, Values
from adhesion_jax.effects.dynamic import (
    Dynamic,
    State,
    Stepped,
    Value,
    has_history,
    now,
    recurrence,
    steps,
)


class Sanding(Multiplier, Dynamic):
    """In the source the build-up takes about 1 s and the decay 5 to 12 s."""

    k: Scalar
    build_up: Scalar
    decay: Scalar

    FACTS = Facts(
        source="Arias-Cuevas et al. 2010, Wear 268:543-551",
        described={
            "k": ("1", -0.9, 3.0, "relative gain under sand"),
            "build_up": ("s", 0.05, 10.0, "time constant of arrival"),
            "decay": ("s", 0.05, 60.0, "time constant of loss"),
        },
        strengths=("k",),
        starts=tuple(
            {"k": 0.05, "build_up": up, "decay": down}
            for up in (0.3, 1.0)
            for down in (0.3, 3.0, 8.0)
        ),
        needs=("sanding", "time_s"),
        sentence="Sand raises adhesion; it takes time to arrive and stays for a while.",
        formula="mu (1 + k s), s following the sanding flag: build-up over t1, decay over t2, in s",
        phrase="sanding",
        family="sand",
        one_sided=True,
        rests_on=("sanding",),
        same_as=("covariate:sanding",),
        driven_by="sanding",
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        flag = conditions["sanding"]
        if not has_history(conditions):
            return jnp.asarray(1 + self.k * flag)
        on = jnp.exp(-steps(conditions) / self.build_up)
        off = jnp.exp(-steps(conditions) / self.decay)
        kept = flag * on + (1 - flag) * off
        sand = recurrence(kept, (1 - kept) * flag)
        return 1 + self.k * sand

    def init(self, adhesion: Value, slip: Value, conditions: Conditions) -> State:
        return now(conditions), jnp.zeros(())

    def step(self, state: State, adhesion: Value, slip: Value, conditions: Conditions) -> Stepped:
        time, sand = state
        flag = conditions["sanding"]
        passed = now(conditions) - time
        kept = flag * jnp.exp(-passed / self.build_up) + (1 - flag) * jnp.exp(-passed / self.decay)
        sand = kept * sand + (1 - kept) * flag
        return (now(conditions), sand), adhesion * (1 + self.k * sand)
