"""How fast and how steadily a method follows a rail that changes, reduced step by step.

A step is one update of the method: a sample of a stream, or a whole block. A stretch is a part of
a run on one rail.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import NDArray

#: A rail is tracked when mu_max is within this share of the truth ...
TRACKED = 0.03

#: ... for this many steps in a row: samples of a stream, or blocks.
_IN_A_ROW = {True: 10, False: 1}

#: A reset within this many steps of a switch answers it; a later one is false.
_GRACE = {True: 20, False: 1}

#: Overshoot is looked for in this many steps after a switch.
_TRANSIENT = {True: 100, False: 5}


class Course(eqx.Module):
    """What a run has in store: for each block its stretch and the true mu_max."""

    stretch: Int[Array, " blocks"]
    truth: Float[Array, " blocks"]
    before: Float[Array, " blocks"]  # true mu_max at the end of the stretch before; NaN: none
    stretches: int = eqx.field(static=True)
    by_sample: bool = eqx.field(static=True)

    @staticmethod
    def of(rails: Sequence[str], truth: NDArray[np.float64], by_sample: bool) -> "Course":
        """From the rail and the true mu_max of each block; another rail, another stretch."""
        starts = np.array([b > 0 and rails[b] != rails[b - 1] for b in range(len(rails))])
        stretch = np.cumsum(starts)
        ends = np.concatenate([[np.nan], truth[np.flatnonzero(starts) - 1]])
        arrays = (jnp.asarray(stretch), jnp.asarray(truth), jnp.asarray(ends[stretch]))
        return Course(*arrays, int(stretch[-1]) + 1, by_sample)


class Tracking(NamedTuple):
    """What has been seen of one run; arrays are [stretches].

    `delay` are the steps from the start of a stretch to the first of those in a row that are
    tracked; as long as there is none, the steps gone by. `overshoot` is the furthest that mu_max
    went beyond the truth, seen from the rail before, as a share of the truth.
    """

    stretch: Int[Array, ""]
    streak: Int[Array, ""]
    delay: Int[Array, " stretches"]
    settled: Int[Array, " stretches"]  # 1 where the delay is final
    length: Int[Array, " stretches"]  # steps gone by
    resets: Float[Array, " stretches"]  # in answer to a switch; NaN: not a method that resets
    false_resets: Float[Array, " stretches"]
    overshoot: Float[Array, " stretches"]


def start_tracking(course: Course) -> Tracking:
    none = jnp.zeros(course.stretches, dtype=int)
    zero = jnp.zeros(course.stretches)
    return Tracking(jnp.int64(0), jnp.int64(0), none, none, none, zero, zero, zero)


def track(
    course: Course,
    seen: Tracking,
    block: Int[Array, ""],
    mu_max: Float[Array, ""],
    forgetting: Float[Array, ""],
) -> Tracking:
    """One step on; `forgetting` is what the method kept of its past, 0 at a reset.

    A method without a past (NaN), or one that discounts it (between 0 and 1), has no resets.
    """
    s, truth = course.stretch[block], course.truth[block]
    since = seen.length[s]
    close = jnp.abs(mu_max - truth) < TRACKED * truth
    streak = jnp.where(close, jnp.where(s == seen.stretch, seen.streak, 0) + 1, 0)
    settled = (seen.settled[s] == 1) | (streak >= _IN_A_ROW[course.by_sample])
    # Until it is settled the delay is that of a row which begins now, or has begun.
    delay = jnp.where(seen.settled[s] == 1, seen.delay[s], since + 1 - streak)

    keeps_or_resets = (forgetting == 0) | (forgetting == 1)
    reset = jnp.where(keeps_or_resets, forgetting == 0, jnp.nan)
    answer = (since < _GRACE[course.by_sample]) & ~jnp.isnan(course.before[block])
    first = (since == 0) & jnp.isnan(course.before[block])  # the start of a run is no reset
    answering = jnp.where(answer, reset, 0 * reset)
    false = jnp.where(answer | first, 0 * reset, reset)

    beyond = jnp.sign(truth - course.before[block]) * (mu_max - truth) / truth
    counts = (since < _TRANSIENT[course.by_sample]) & (beyond > seen.overshoot[s])
    return Tracking(
        s,
        streak,
        seen.delay.at[s].set(delay),
        seen.settled.at[s].set(settled.astype(int)),
        seen.length.at[s].add(1),
        seen.resets.at[s].add(answering),
        seen.false_resets.at[s].add(false),
        seen.overshoot.at[s].set(jnp.where(counts, beyond, seen.overshoot[s])),
    )


def _mean(x: NDArray[np.float64]) -> tuple[float, float]:
    """Mean over runs and its standard error."""
    error = np.std(x, ddof=1) / np.sqrt(len(x)) if len(x) > 1 else np.nan
    return float(np.mean(x)), float(error)


def _median(x: NDArray[np.float64]) -> tuple[float, float]:
    """Median over runs; its standard error from the order statistics half a deviation apart."""
    reach = 0.5 * np.sqrt(len(x)) / len(x)
    low, high = np.quantile(x, [max(0.5 - reach, 0), min(0.5 + reach, 1)])
    return float(np.median(x)), float(high - low) / 2


def tracking_row(seen: Tracking, stretch: int, by_sample: bool) -> Mapping[str, object]:
    """One row of the table: a method on one stretch, from arrays [runs, stretches]."""
    at = {
        name: np.asarray(x, dtype=float)[:, stretch]
        for name, x in seen._asdict().items()
        if np.ndim(x) == 2
    }
    length = at["length"][0]
    rows: dict[str, object] = {"unit": "sample" if by_sample else "block"}
    # A row of in-a-row steps that begins too near the end cannot settle: never tracked.
    delay = np.where(at["settled"] == 1, at["delay"], length)
    figures = {
        "delay_median": _median(delay),
        "delay_mean": _mean(delay),
        "never_tracked_share": _mean(1 - at["settled"]),
        "overshoot": _mean(at["overshoot"]),
        "missed_share": _mean(np.where(np.isnan(at["resets"]), np.nan, at["resets"] == 0)),
        "false_resets_per_1000": _mean(1000 * at["false_resets"] / length),
    }
    for name, (value, error) in figures.items():
        rows |= {name: value, f"{name}_se": error}
    if stretch == 0:  # it did not begin with a switch
        for name in ("missed_share", "overshoot"):
            rows |= {name: np.nan, f"{name}_se": np.nan}
    return rows
