"""What acts in time: filters, shifts and sums along a run, and the causes with a memory."""

from abc import abstractmethod
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array

from adhesion_jax.effects.api import (
    AdhesionTransform,
    Cause,
    Conditions,
    Points,
    Scalar,
    Signal,
    Value,
    Values,
)


def has_history(conditions: Conditions) -> bool:
    """Whether the conditions are those of a run in time rather than of one steady state."""
    return "time_s" in conditions and jnp.ndim(conditions["time_s"]) == 1


def steps(conditions: Conditions) -> Points:
    """Seconds from the point before, zero at the first."""
    time = jnp.asarray(conditions["time_s"])
    return jnp.diff(time, prepend=time[:1])


def rate(signal: Signal, conditions: Conditions) -> Signal:
    """Central difference in time, per second; zero where time stands still or nothing changes."""
    if not has_history(conditions):
        return jnp.zeros_like(signal)
    time = jnp.asarray(conditions["time_s"])
    before = jnp.concatenate([signal[:1], signal[:-1]])
    behind = jnp.concatenate([signal[1:], signal[-1:]])
    span = jnp.concatenate([time[1:], time[-1:]]) - jnp.concatenate([time[:1], time[:-1]])
    return jnp.where(span > 0, (behind - before) / jnp.where(span > 0, span, 1.0), 0.0)


def recurrence(kept: Points, drive: Points) -> Points:
    """y(k) = kept(k) y(k-1) + drive(k), y(-1) = 0."""
    return jax.lax.scan(_step, jnp.zeros(()), (kept, drive))[1]


# A function of the module, so that the scan is compiled once.
def _step(state: Array, now: tuple[Array, Array]) -> tuple[Array, Array]:
    state = now[0] * state + now[1]
    return state, state


def lagged(signal: Signal, time_constant: Values | Scalar, conditions: Conditions) -> Signal:
    """First-order lag T y' + y = signal, the signal a straight line between points; T in s.

    The exact response to a ramp: y(k) = a y(k-1) + (g - a) s(k-1) + (1 - g) s(k), with
    a = exp(-dt/T), g = (1 - a) T/dt. It starts settled, and is so in a steady state.
    """
    if not has_history(conditions):
        return signal
    # A tiny constant is added, rather than a maximum taken, so that the derivative by a time
    # constant of zero is its limit from above.
    kept, gain = _response(steps(conditions) / (time_constant + 1e-12))
    before = jnp.concatenate([signal[:1], signal[:-1]])
    drive = (gain - kept) * before + (1 - gain) * signal

    return recurrence(kept.at[0].set(0.0), drive.at[0].set(signal[0]))


class Filtered(NamedTuple):
    """A first-order lag between two samples."""

    time: Value  # s
    value: Value
    signal: Value


def filtered(before: Filtered, signal: Value, time_constant: Scalar, time: Value) -> Filtered:
    """The lag one sample on: `lagged`, step by step."""
    kept, gain = _response((time - before.time) / (time_constant + 1e-12))
    value = kept * before.value + (gain - kept) * before.signal + (1 - gain) * signal
    return Filtered(time, value, signal)


def _response(ratio: Values) -> tuple[Values, Values]:
    """exp(-r) and (1 - exp(-r))/r."""
    small = ratio < 1e-4
    gain = jnp.where(small, 1 - ratio / 2, -jnp.expm1(-ratio) / jnp.where(small, 1.0, ratio))
    return jnp.exp(-ratio), gain


def shifted(signal: Signal, delay: Scalar, conditions: Conditions) -> Signal:
    """signal(t - delay), a straight line between points, held at the ends; a steady state stays."""
    if not has_history(conditions):
        return signal
    time = jnp.asarray(conditions["time_s"])
    return jnp.interp(time - delay, time, signal)


#: Neighbours on either side that a local line is laid through.
_REACH = 12


def smoothed(signal: Points, time: Points, width: Scalar) -> tuple[Points, Points]:
    """Level and slope of a local straight line, neighbours weighted by exp(-(dt/width)^2/2).

    At most twelve neighbours on either side take part; beyond the ends of the run there are none.
    """
    places = jnp.arange(signal.size)[:, None] + jnp.arange(-_REACH, _REACH + 1)
    inside = (places >= 0) & (places < signal.size)
    places = jnp.clip(places, 0, signal.size - 1)
    lead = time[places] - time[:, None]
    weight = jnp.where(inside, jnp.exp(-0.5 * (lead / width) ** 2), 0.0)
    total, first, second = (jnp.sum(weight * lead**power, axis=1) for power in (0, 1, 2))
    level, tilt = (jnp.sum(weight * lead**power * signal[places], axis=1) for power in (0, 1))
    spread = total * second - first**2
    flat = spread <= 1e-12 * total * second
    safe = jnp.where(flat, 1.0, spread)
    line = jnp.where(flat, level / total, (second * level - first * tilt) / safe)
    return line, jnp.where(flat, 0.0, (total * tilt - first * level) / safe)


#: What a cause remembers, and this after one more sample with the adhesion of that sample.
State = Any
Stepped = tuple[State, Value]


class Dynamic(Cause):
    """A cause with a memory, which a plant advances sample by sample.

    `init` is told the first sample of a run, `step` every sample from the first on; conditions
    are scalars with `time_s`. Over a run it gives what `after` gives; where `after` looks a sample
    ahead, for a rate, to the first order in the time between two samples.
    """

    @abstractmethod
    def init(self, adhesion: Value, slip: Value, conditions: Conditions) -> State:
        """The memory at the start of a run."""

    @abstractmethod
    def step(self, state: State, adhesion: Value, slip: Value, conditions: Conditions) -> Stepped:
        """The memory after one more sample, and the adhesion of that sample."""


class Lagging(AdhesionTransform, Dynamic):
    """A first-order lag of the adhesion, T dmu/dt + mu = mu_steady."""

    ORDER = 3

    @abstractmethod
    def time(self, conditions: Conditions) -> Values | Scalar:
        """The time constant T in s."""

    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        return lagged(adhesion, self.time(conditions), conditions)

    def init(self, adhesion: Value, slip: Value, conditions: Conditions) -> State:
        return Filtered(now(conditions), adhesion, adhesion)

    def step(self, state: State, adhesion: Value, slip: Value, conditions: Conditions) -> Stepped:
        state = filtered(state, adhesion, self.time(conditions), now(conditions))
        return state, state.value


def now(conditions: Conditions) -> Value:
    """Time of a sample, s."""
    return jnp.asarray(conditions["time_s"])
