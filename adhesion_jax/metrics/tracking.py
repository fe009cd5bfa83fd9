"""Delay, overshoot and resets of a method on a rail that changes, reduced step by step.

A step is one update of the method: a sample of a stream, or a whole block. A stretch is a part of
a run on one rail.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import NDArray

from adhesion_jax.metrics.counts import quantile
from adhesion_jax.metrics.moments import Moments
from adhesion_jax.records import Known

#: The rail is tracked as long as the error of mu_max is below this share of its true value.
TRACKED = 0.03

#: A truth moves if the sum of squares of its steps is above this share of its own.
_ROUNDING = 1e-20


class Criteria(NamedTuple):
    """Numbers of steps that define tracking, answered resets and overshoot; `unit` names a step."""

    unit: str
    in_a_row: int  # the delay ends with the first of this many tracked steps in a row
    grace: int  # a reset within this many steps of a switch answers it; a later one is false
    transient: int  # overshoot is looked for in this many steps after a switch


BY_SAMPLE = Criteria("sample", in_a_row=10, grace=20, transient=100)
BY_BLOCK = Criteria("block", in_a_row=1, grace=1, transient=5)


def criteria_of(known: Known) -> Criteria:
    """The criteria in samples if a method is followed at every sample, else those in blocks."""
    return BY_SAMPLE if known.by_sample else BY_BLOCK


class Tracking(NamedTuple):
    """The tracking of one run so far; arrays are [stretches].

    `delay` is the number of steps from the start of a stretch to the first tracked one of the row
    that ends the delay; before that row, the number of steps so far. `overshoot` is the largest
    excess of mu_max over the truth, in the direction away from the rail before, as a share of the
    truth.
    """

    stretch: Int[Array, ""]
    streak: Int[Array, ""]
    delay: Int[Array, " stretches"]
    settled: Int[Array, " stretches"]  # 1 where the delay is final
    length: Int[Array, " stretches"]  # number of steps so far
    resets: Float[Array, " stretches"]  # in answer to a switch; NaN for a method without resets
    false_resets: Float[Array, " stretches"]
    overshoot: Float[Array, " stretches"]


class Tracker(eqx.Module):
    """Reduces a run to its `Tracking`: for each block its stretch and the true mu_max."""

    stretch: Int[Array, " blocks"]
    truth: Float[Array, " blocks"]
    before: Float[Array, " blocks"]  # true mu_max at the end of the stretch before, or NaN
    stretches: int = eqx.field(static=True)
    criteria: Criteria = eqx.field(static=True)
    resets: bool = eqx.field(static=True)  # whether the method makes resets

    @staticmethod
    def of(
        rails: Sequence[str], truth: NDArray[np.float64], criteria: Criteria, resets: bool
    ) -> "Tracker":
        """From the rail and the true mu_max of each block; another rail, another stretch."""
        starts = np.array([b > 0 and rails[b] != rails[b - 1] for b in range(len(rails))])
        stretch = np.cumsum(starts)
        ends = np.concatenate([[np.nan], truth[np.flatnonzero(starts) - 1]])
        arrays = (jnp.asarray(stretch), jnp.asarray(truth), jnp.asarray(ends[stretch]))
        return Tracker(*arrays, int(stretch[-1]) + 1, criteria, resets)

    def init(self) -> Tracking:
        """The state before the first step."""
        none = jnp.zeros(self.stretches, dtype=int)
        zero = jnp.zeros(self.stretches)
        return Tracking(jnp.int64(0), jnp.int64(0), none, none, none, zero, zero, zero)

    def update(
        self,
        seen: Tracking,
        block: Int[Array, ""],
        values: Mapping[str, Float[Array, ""]],
        reset: Bool[Array, ""],
    ) -> Tracking:
        """The state after one more step: the values after it, and whether it brought a reset."""
        s, truth, before = self.stretch[block], self.truth[block], self.before[block]
        mu_max = values.get("mu_max", jnp.asarray(jnp.nan))
        since = seen.length[s]
        close = jnp.abs(mu_max - truth) < TRACKED * truth
        streak = jnp.where(close, jnp.where(s == seen.stretch, seen.streak, 0) + 1, 0)
        settled = (seen.settled[s] == 1) | (streak >= self.criteria.in_a_row)
        # Until the delay is final it is counted up to the start of the row of tracked steps that
        # ends now, or up to the next step if there is no such row.
        delay = jnp.where(seen.settled[s] == 1, seen.delay[s], since + 1 - streak)

        resets = jnp.where(reset, 1.0, 0.0) if self.resets else jnp.asarray(jnp.nan)
        answers = (since < self.criteria.grace) & ~jnp.isnan(before)

        beyond = jnp.sign(truth - before) * (mu_max - truth) / truth
        counts = (since < self.criteria.transient) & (beyond > seen.overshoot[s])
        return Tracking(
            s,
            streak,
            seen.delay.at[s].set(delay),
            seen.settled.at[s].set(settled.astype(int)),
            seen.length.at[s].add(1),
            seen.resets.at[s].add(jnp.where(answers, resets, 0 * resets)),
            seen.false_resets.at[s].add(jnp.where(answers, 0 * resets, resets)),
            seen.overshoot.at[s].set(jnp.where(counts, beyond, seen.overshoot[s])),
        )


def delays(seen: Tracking) -> NDArray[np.int64]:
    """The delay of each run and stretch, [runs, stretches], from arrays of that shape.

    If tracked steps begin so near the end that the row stays too short, the stretch counts as never
    tracked, and its delay is its length.
    """
    return np.where(np.asarray(seen.settled) == 1, seen.delay, seen.length)


def delay_counts(seen: Tracking, longest: int) -> NDArray[np.int64]:
    """The number of runs with each delay from 0 to `longest`, [stretches, longest + 1]."""
    return np.stack([np.bincount(of_one, minlength=longest + 1) for of_one in delays(seen).T])


def lags(
    mu_max: NDArray[np.float64],
    truth: NDArray[np.float64],
    stretch: NDArray[np.int64],
    steps: int,
) -> NDArray[np.float64]:
    """How many steps an estimate is behind a truth that moves, [runs, stretches].

    Of a truth that is late by d steps the error is -d times its rate: d is found by least squares
    over the second half of each stretch, from mu_max [runs, blocks] and the truth [blocks] after
    blocks of so many steps. NaN where the truth does not move.
    """
    found = []
    for own in (np.flatnonzero(stretch == number) for number in range(stretch[-1] + 1)):
        rate = np.gradient(truth[own]) if len(own) > 1 else np.zeros(len(own))
        late = slice(len(own) // 2, None)
        error = (mu_max[:, own] - truth[own])[:, late]
        power = float(np.sum(rate[late] ** 2))
        moves = power > _ROUNDING * float(np.sum(truth[own] ** 2))
        found.append(-steps * (error @ rate[late]) / (power if moves else np.nan))
    return np.stack(found, axis=1)


def tracking_statistics(
    seen: Tracking, lag: NDArray[np.float64]
) -> Mapping[str, NDArray[np.float64]]:
    """The statistics of each run and stretch whose means over runs are reported."""
    resets, false_resets = np.asarray(seen.resets), np.asarray(seen.false_resets)
    return {
        "never_tracked_share": 1.0 - np.asarray(seen.settled),
        "overshoot": np.asarray(seen.overshoot),
        "missed_share": np.where(np.isnan(resets), np.nan, resets == 0),
        "false_resets_per_1000": 1000 * false_resets / np.asarray(seen.length),
        "lag": lag,
    }


#: The names of `tracking_statistics` in the order of their columns.
_FIGURES = ("never_tracked_share", "overshoot", "missed_share", "false_resets_per_1000", "lag")


def tracking_row(
    counts: NDArray[np.int64], moments: Moments, first: bool, unit: str
) -> Mapping[str, object]:
    """One row of the table: a method on one stretch, from its `delay_counts` and the moments.

    `unit` is that of the criteria; `first` says that no switch comes before the stretch.
    """
    figures = {"delay_median": _median(counts), "delay_mean": _mean(counts)}
    for name in _FIGURES:
        unknown = first and name in ("missed_share", "overshoot")
        known = (float(moments.mean(name)), float(moments.standard_error(name)))
        figures[name] = (np.nan, np.nan) if unknown else known
    rows: dict[str, object] = {"unit": unit}
    for name, (value, error) in figures.items():
        rows |= {name: value, f"{name}_se": error}
    return rows


def _mean(counts: NDArray[np.int64]) -> tuple[float, float]:
    """Mean over runs and its standard error."""
    runs, steps = counts.sum(), np.arange(len(counts))
    mean = float(counts @ steps / runs)
    variance = float(counts @ (steps - mean) ** 2 / runs)
    return mean, float(np.sqrt(variance / (runs - 1))) if runs > 1 else np.nan


def _median(counts: NDArray[np.int64]) -> tuple[float, float]:
    """Median over runs; its standard error from the order statistics half a deviation apart."""
    steps = np.arange(len(counts), dtype=float)
    reach = 0.5 / np.sqrt(counts.sum())
    low, middle, high = (
        float(quantile(counts, steps, share))
        for share in (max(0.5 - reach, 0), 0.5, min(0.5 + reach, 1))
    )
    return middle, (high - low) / 2
