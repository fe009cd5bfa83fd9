"""How well a traction loop uses a rail: figures of each segment of a run, reduced as it goes."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt64

#: Tracking and estimation errors are given a second time from this time after a switch on, s.
SETTLED = 2.0

#: t95 is the start of the first stretch of this length in s that is near the largest adhesion.
STRETCH = 0.3

#: A stretch is near the largest adhesion if at least this share of its samples is.
SHARE_OF_SAMPLES = 0.95

#: A sample is near the largest adhesion if it has at least this share of it.
SHARE_OF_PEAK = 0.95

#: Number of flags in a word.
_BITS = 64

#: Prices of slip at which the utility of a run is told: useful work that a joule of slip is worth.
PRICES = (0, 1, 3)

#: Slip has run away if from `SETTLED` on it exceeds that of the largest adhesion by this factor.
RUNAWAY = 5.0

#: A train stood still if its speed never reached this in either direction, and rolled back if it
#: exceeded this backwards, m/s.
STANDSTILL = 0.01


class Sample(NamedTuple):
    """What is true and what is known at one moment.

    In braking slip, adhesion and torque are negative, and so is the slip of the optimum.
    """

    segment: Int[Array, ""]
    counts: Bool[Array, ""]  # false after the run of the driver has ended
    direction: Float[Array, ""]  # 1 in traction, -1 in braking
    slip: Float[Array, " axles"]  # m/s
    optimum: Float[Array, " axles"]  # m/s
    adhesion: Float[Array, " axles"]
    largest: Float[Array, " axles"]  # mu_max
    observed: Float[Array, " axles"]  # adhesion as the observer has it
    asked: Float[Array, " axles"]  # slip that a seeker asks for, m/s; NaN before it has asked
    torque: Float[Array, " axles"]  # of the motor, N m
    shaft: Float[Array, " axles"]  # torque between the wheels of an axle, N m; NaN: it cannot twist
    static_shaft: Float[Array, " axles"]  # that at the largest adhesion without acceleration, N m
    slip_power: Float[Array, ""]  # of all axles, W
    pull: Float[Array, ""]  # of all axles, N
    largest_pull: Float[Array, ""]  # that at the largest adhesion of every axle, N
    train_speed: Float[Array, ""]  # m/s


Numbers = Mapping[str, Float[Array, "..."]]


class Segment(NamedTuple):
    """Numbers over the samples of a segment, by name; squares are means over the axles."""

    sums: Numbers
    settled: Numbers  # sums over the samples from `SETTLED` on
    largest: Numbers
    least: Numbers


#: How the numbers of each part are joined, all of them along an axis, and what changes none.
_JOINED: tuple[Callable[..., Array], ...] = (jnp.add, jnp.add, jnp.maximum, jnp.minimum)
_OF_ALL: tuple[Callable[..., Array], ...] = (jnp.sum, jnp.sum, jnp.max, jnp.min)
_NEUTRAL = (0.0, 0.0, -jnp.inf, jnp.inf)


class Totals(NamedTuple):
    """The totals of a run, from which its figures follow.

    Each segment has scalars of its own: arrays [segments] would take longer, since so short an
    axis keeps the compiler from working on several runs at once.
    """

    segments: tuple[Segment, ...]
    age: Int[Array, ""]  # samples since the segment began
    last: Sample
    acceleration: Float[Array, ""]  # of the train, m/s^2
    near: tuple[UInt64[Array, ""], ...]  # a bit for each sample of the last stretch, latest first
    near_count: Int[Array, ""]  # of those in this segment


def start(first: Sample, segments: int, period: float) -> Totals:
    """The totals before the first sample; `period` is the time between samples in s."""
    zero = jnp.zeros(())
    found = zip(_NEUTRAL, _numbers(first, period, zero, zero, zero), strict=True)
    nothing = Segment(*({name: jnp.asarray(none) for name in part} for none, part in found))
    return Totals(
        segments=(nothing,) * segments,
        age=jnp.zeros((), dtype=int),
        last=first,
        acceleration=jnp.zeros(()),
        near=(jnp.zeros((), dtype=jnp.uint64),) * -(-_stretch(period) // _BITS),
        near_count=jnp.zeros((), dtype=int),
    )


def _stretch(period: float) -> int:
    """The number of samples of the stretch of t95."""
    return max(round(STRETCH / period), 1)


def _shifted(
    words: tuple[UInt64[Array, ""], ...], newest: Bool[Array, ""], length: int
) -> tuple[tuple[UInt64[Array, ""], ...], Bool[Array, ""]]:
    """The last `length` flags with a new one in front, and the flag that drops out.

    They are bits of words: an array of flags would be copied whole at every sample. The ages of the
    latest samples that are not near, one more than a stretch may have, give the same and are
    shorter to write, but took 59 CPU-seconds for the job of fang2018 that takes 30 with the words.
    """
    word, bit = divmod(length - 1, _BITS)
    oldest = (words[word] >> bit) & 1
    carried, shifted = newest.astype(jnp.uint64), []
    for one in words:
        shifted.append((one << 1) | carried)
        carried = one >> (_BITS - 1)
    return tuple(shifted), oldest.astype(bool)


def add(totals: Totals, sample: Sample, number: Int[Array, ""], period: float) -> Totals:
    """The totals after one more sample; `number` is the number of samples before it in the run."""
    last = totals.last
    same = (sample.segment == last.segment) & (number > 0)
    age = jnp.where(same, totals.age + 1, 0)
    acceleration = jnp.where(number > 0, (sample.train_speed - last.train_speed) / period, 0.0)
    jerk = jnp.where(number > 1, (acceleration - totals.acceleration) / period, 0.0)
    moved = jnp.where(number > 0, jnp.mean(jnp.abs(sample.torque - last.torque)), 0.0)

    stretch = _stretch(period)
    is_near = _utilised(sample) >= SHARE_OF_PEAK
    near, oldest = _shifted(totals.near, is_near, stretch)
    leaves = (age >= stretch) & oldest
    count = jnp.where(same, totals.near_count, 0) + is_near - leaves
    held = (count >= SHARE_OF_SAMPLES * stretch) & (age + 1 >= stretch)

    reached = jnp.where(held, (age + 1 - stretch) * period, jnp.inf)
    found = _numbers(sample, period, moved, jerk, reached)

    def after(segment: Segment, index: int) -> Segment:
        here = (sample.segment == index) & sample.counts
        counts = here, here & (age * period >= SETTLED), here, here
        parts = zip(_JOINED, _NEUTRAL, counts, segment, found, strict=True)
        return Segment(
            *(
                {name: join(had[name], jnp.where(which, new[name], none)) for name in new}
                for join, none, which, had, new in parts
            )
        )

    return Totals(
        segments=tuple(after(segment, index) for index, segment in enumerate(totals.segments)),
        age=age,
        last=sample,
        acceleration=acceleration,
        near=near,
        near_count=count,
    )


def _utilised(sample: Sample) -> Float[Array, ""]:
    return jnp.mean(sample.direction * sample.adhesion / sample.largest)


def _numbers(
    sample: Sample,
    period: float,
    moved: Float[Array, ""],
    jerk: Float[Array, ""],
    reached: Float[Array, ""],
) -> Segment:
    """What a sample alone makes of a segment, with what it is told of those before it."""
    asks = jnp.all(jnp.isfinite(sample.asked))
    ran_away = jnp.any(jnp.abs(sample.slip) > RUNAWAY * jnp.abs(sample.optimum))
    both = {
        "samples": jnp.ones(()),
        "utilised": _utilised(sample),
        "tracking_squares": jnp.mean((sample.slip - sample.optimum) ** 2),
        "estimation_squares": jnp.where(asks, jnp.mean((sample.asked - sample.slip) ** 2), 0.0),
        "asked_samples": 1.0 * asks,
    }
    return Segment(
        sums={
            **both,
            "pulled": sample.direction * sample.pull,
            "largest_pulled": sample.largest_pull,
            "slip_energy": period * sample.slip_power,
            "useful_work": period * sample.direction * sample.pull * sample.train_speed,
            "torque_variation": moved,
            "jerk_squares": jerk**2,
            "adhesion_squares": jnp.mean((sample.observed - sample.adhesion) ** 2),
        },
        settled={
            **both,
            "slip": jnp.mean(sample.direction * sample.slip),
            "runaway_samples": 1.0 * ran_away,
        },
        largest={
            "overshoot": jnp.max(sample.direction * (sample.slip - sample.optimum)),
            "torque": jnp.max(jnp.abs(sample.torque)),
            "shaft": jnp.max(jnp.abs(sample.shaft)),
            "static_shaft": jnp.max(jnp.abs(sample.static_shaft)),
            "speed": sample.train_speed,
        },
        least={"speed": sample.train_speed, "reached": reached},
    )


#: Unit and meaning of each figure of a segment.
FIGURES: Mapping[str, tuple[str, str]] = {
    "utilisation": ("1", "mean adhesion, as a share of the largest possible"),
    "pull": ("kN", "mean pull of the train"),
    "pull_share": ("1", "mean pull, as a share of that at the largest adhesion of every axle"),
    "overshoot": ("m/s", "largest excess of slip over that of the largest adhesion"),
    "t95": (
        "s",
        "time until 95 % of the largest adhesion is kept for .3 s; empty if it never is; of the "
        "whole run that of its first segment",
    ),
    "never95": (
        "1",
        "share of the runs in which it never is, of the whole run in the first segment",
    ),
    "slip_energy": ("J", "energy lost in the contact"),
    "slip_energy_share": ("1", "energy lost in the contact, per useful work: traction and braking"),
    **{
        f"utility_{price}": (
            "J",
            f"useful work, traction and braking, less {price} times slip_energy",
        )
        for price in PRICES
    },
    "torque_variation": ("kN m/s", "sum of the sizes of the changes of torque, per second"),
    "torque_largest": ("kN m", "largest torque of a motor"),
    "axle_torque_over_static": (
        "1",
        "largest torque between the wheels of an axle, over the largest that it carries where both "
        "roll steadily at the largest adhesion; empty where no axle twists",
    ),
    "jerk_rms": ("m/s^3", "jerk of the train, root mean square"),
    "tracking_rms": ("m/s", "slip minus that of the largest adhesion, root mean square"),
    "tracking_rms_settled": ("m/s", "tracking_rms from 2 s after the switch on"),
    "estimation_rms": ("m/s", "slip asked for minus slip, root mean square"),
    "estimation_rms_settled": ("m/s", "estimation_rms from 2 s after the switch on"),
    "adhesion_rms": ("1", "adhesion observed minus adhesion, root mean square"),
    "slip_settled": (
        "m/s",
        "mean slip from 2 s after the switch on, in braking with its sign turned",
    ),
    "utilisation_settled": ("1", "utilisation from 2 s after the switch on"),
    "ran_away": (
        "1",
        "share of the runs in which slip, from 2 s after the switch on, exceeds five times that of "
        "the largest adhesion",
    ),
    "rolled_back": ("1", "share of the runs in which the train rolls back"),
    "stood": ("1", "share of the runs in which the train never moves"),
}


def by_segment(totals: Totals) -> Segment:
    """The sums and extremes of all segments, arrays [segments]."""
    return jax.tree.map(lambda *each: jnp.stack(each), *totals.segments)


def whole(totals: Totals) -> Segment:
    """The whole run as one segment, arrays [1]; its t95 is that of its first segment."""
    segments = by_segment(totals)
    joined = Segment(
        *(
            {name: of_all(values, keepdims=True) for name, values in numbers.items()}
            for of_all, numbers in zip(_OF_ALL, segments, strict=True)
        )
    )
    return joined._replace(least={**joined.least, "reached": segments.least["reached"][:1]})


def figures(of: Segment, period: float) -> dict[str, Float[Array, " segments"]]:
    """The figures of FIGURES from arrays [segments]; NaN where a segment has no sample."""
    sums, settled, largest, least = of
    samples = sums["samples"]

    def mean(total: Array, count: Array) -> Array:
        return total / jnp.where(count > 0, count, jnp.nan)

    def rms(of: Numbers, name: str, count: str = "samples") -> Array:
        return jnp.sqrt(mean(of[f"{name}_squares"], of[count]))

    def where_seen(what: Array) -> Array:
        return jnp.where(samples > 0, what, jnp.nan)

    never = jnp.isinf(least["reached"])
    work, lost = sums["useful_work"], sums["slip_energy"]
    return {
        "utilisation": mean(sums["utilised"], samples),
        "pull": mean(sums["pulled"], 1e3 * samples),
        "pull_share": mean(sums["pulled"], sums["largest_pulled"]),
        "overshoot": where_seen(largest["overshoot"]),
        "t95": jnp.where(never, jnp.nan, least["reached"]),
        "never95": where_seen(never),
        "slip_energy": where_seen(lost),
        "slip_energy_share": mean(lost, jnp.abs(work)),
        **{f"utility_{price}": where_seen(work - price * lost) for price in PRICES},
        "torque_variation": mean(sums["torque_variation"], 1e3 * period * samples),
        "torque_largest": where_seen(largest["torque"] / 1e3),
        "axle_torque_over_static": where_seen(largest["shaft"] / largest["static_shaft"]),
        "jerk_rms": rms(sums, "jerk"),
        "tracking_rms": rms(sums, "tracking"),
        "tracking_rms_settled": rms(settled, "tracking"),
        "estimation_rms": rms(sums, "estimation", "asked_samples"),
        "estimation_rms_settled": rms(settled, "estimation", "asked_samples"),
        "adhesion_rms": rms(sums, "adhesion"),
        "slip_settled": mean(settled["slip"], settled["samples"]),
        "utilisation_settled": mean(settled["utilised"], settled["samples"]),
        "ran_away": where_seen(settled["runaway_samples"] > 0),
        "rolled_back": where_seen(least["speed"] < -STANDSTILL),
        "stood": where_seen(jnp.maximum(largest["speed"], -least["speed"]) < STANDSTILL),
    }
