import jax.numpy as jnp

from adhesion_jax.effects.api import AdhesionTransform, Conditions, Facts, Scalar, Signal
from adhesion_jax.effects.dynamic import Dynamic, State, Stepped, Value, now, shifted

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
    ORDER = 2

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
