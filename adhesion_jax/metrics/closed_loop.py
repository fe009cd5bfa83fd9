"""How well a traction loop uses a rail: figures of each segment of a run, reduced as it goes."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

#: Tracking and estimation are also told without this time after a switch, in s.
SETTLED = 2.0

#: t95 is the start of the first stretch of this length in s in which this share of the samples has
#: at least this share of the largest adhesion.
STRETCH, SHARE_OF_SAMPLES, SHARE_OF_PEAK = 0.3, 0.95, 0.95

#: Slip has run away where, settled, it is this many times that of the largest adhesion.
RUNAWAY = 10.0

#: A train that never was faster than this in m/s stood still; one slower than its negative rolls
#: back.
STANDSTILL = 0.01


class Sample(NamedTuple):
    """What is true and what is known at one moment.

    In braking slip, adhesion and torque are negative, and so is the slip of the optimum.
    """

    segment: Int[Array, ""]
    counts: Bool[Array, ""]  # false once the driver asks for no more
    direction: Float[Array, ""]  # 1 in traction, -1 in braking
    slip: Float[Array, " axles"]  # m/s
    optimum: Float[Array, " axles"]  # m/s
    adhesion: Float[Array, " axles"]
    largest: Float[Array, " axles"]  # mu_max
    observed: Float[Array, " axles"]  # adhesion as the observer has it
    asked: Float[Array, " axles"]  # slip that a seeker asks for, m/s; NaN if none did yet
    torque: Float[Array, " axles"]  # of the motor, N m
    slip_power: Float[Array, ""]  # of all axles, W
    pull: Float[Array, ""]  # of all axles, N
    train_speed: Float[Array, ""]  # m/s


class Sums(NamedTuple):
    """What adds up [segments] over the samples of a run; squares are means over the axles."""

    samples: Float[Array, " segments"]
    utilised: Float[Array, " segments"]
    slip_energy: Float[Array, " segments"]
    useful_work: Float[Array, " segments"]
    torque_variation: Float[Array, " segments"]
    jerk_squares: Float[Array, " segments"]
    tracking_squares: Float[Array, " segments"]
    estimation_squares: Float[Array, " segments"]
    adhesion_squares: Float[Array, " segments"]
    asked_samples: Float[Array, " segments"]
    settled_asked_samples: Float[Array, " segments"]
    settled_samples: Float[Array, " segments"]
    settled_slip: Float[Array, " segments"]
    settled_utilised: Float[Array, " segments"]
    settled_tracking_squares: Float[Array, " segments"]
    settled_estimation_squares: Float[Array, " segments"]
    runaway_samples: Float[Array, " segments"]


class Totals(NamedTuple):
    """Sums and extremes [segments] over the samples of a run, and what the next sample needs."""

    sums: Sums
    overshoot: Float[Array, " segments"]
    torque_largest: Float[Array, " segments"]
    slowest: Float[Array, " segments"]  # speed of the train, m/s
    fastest: Float[Array, " segments"]
    reached: Float[Array, " segments"]  # s; NaN: not yet
    age: Int[Array, ""]  # samples since the segment began
    last: Sample
    acceleration: Float[Array, ""]  # of the train, m/s^2
    near: Bool[Array, " stretch"]  # whether each sample of the last stretch was near the peak


def start(first: Sample, segments: int, period: float) -> Totals:
    """Nothing counted yet; `period` is the time from a sample to the next, in s."""
    none = jnp.zeros(segments)
    return Totals(
        sums=Sums(*[none] * len(Sums._fields)),
        overshoot=none - jnp.inf,
        torque_largest=none,
        slowest=none + jnp.inf,
        fastest=none - jnp.inf,
        reached=none + jnp.nan,
        age=jnp.zeros((), dtype=int),
        last=first,
        acceleration=jnp.zeros(()),
        near=jnp.zeros(max(round(STRETCH / period), 1), dtype=bool),
    )


def add(totals: Totals, sample: Sample, number: Int[Array, ""], period: float) -> Totals:
    """After one more sample, of which `number` are before it in the run."""
    last = totals.last
    same = (sample.segment == last.segment) & (number > 0)
    age = jnp.where(same, totals.age + 1, 0)
    here = (jnp.arange(totals.overshoot.size) == sample.segment) & sample.counts
    settled = age * period >= SETTLED

    utilised = jnp.mean(sample.direction * sample.adhesion / sample.largest)
    tracking = jnp.mean((sample.slip - sample.optimum) ** 2)
    asks = jnp.all(jnp.isfinite(sample.asked))
    estimation = jnp.where(asks, jnp.mean((sample.asked - sample.slip) ** 2), 0.0)
    acceleration = jnp.where(number > 0, (sample.train_speed - last.train_speed) / period, 0.0)
    jerk = jnp.where(number > 1, (acceleration - totals.acceleration) / period, 0.0)
    moved = jnp.where(number > 0, jnp.mean(jnp.abs(sample.torque - last.torque)), 0.0)
    ran_away = jnp.any(jnp.abs(sample.slip) > RUNAWAY * jnp.abs(sample.optimum))

    # A ring of flags: what leaves the stretch is what stood where the new one goes.
    near = jnp.where(same, totals.near, False)
    place = number % near.size
    near = jax.lax.dynamic_update_index_in_dim(near, utilised >= SHARE_OF_PEAK, place, 0)
    held = (jnp.sum(near) >= SHARE_OF_SAMPLES * near.size) & (age + 1 >= near.size)
    began = (age + 1 - near.size) * period
    fills = here & held & jnp.isnan(totals.reached)

    def if_settled(what: Array) -> Array:
        return jnp.where(settled, what, 0.0)

    one = jnp.ones(())
    more = Sums(
        samples=one,
        utilised=utilised,
        slip_energy=period * sample.slip_power,
        useful_work=period * sample.pull * sample.train_speed,
        torque_variation=moved,
        jerk_squares=jerk**2,
        tracking_squares=tracking,
        estimation_squares=estimation,
        adhesion_squares=jnp.mean((sample.observed - sample.adhesion) ** 2),
        asked_samples=one * asks,
        settled_asked_samples=if_settled(one * asks),
        settled_samples=if_settled(one),
        settled_slip=if_settled(jnp.mean(sample.slip)),
        settled_utilised=if_settled(utilised),
        settled_tracking_squares=if_settled(tracking),
        settled_estimation_squares=if_settled(estimation),
        runaway_samples=if_settled(one * ran_away),
    )
    over = jnp.max(sample.direction * (sample.slip - sample.optimum))
    torque, speed = jnp.max(jnp.abs(sample.torque)), sample.train_speed
    return Totals(
        sums=jax.tree.map(lambda sum_, new: sum_ + jnp.where(here, new, 0.0), totals.sums, more),
        overshoot=jnp.where(here, jnp.maximum(totals.overshoot, over), totals.overshoot),
        torque_largest=jnp.where(
            here, jnp.maximum(totals.torque_largest, torque), totals.torque_largest
        ),
        slowest=jnp.where(here, jnp.minimum(totals.slowest, speed), totals.slowest),
        fastest=jnp.where(here, jnp.maximum(totals.fastest, speed), totals.fastest),
        reached=jnp.where(fills, began, totals.reached),
        age=age,
        last=sample,
        acceleration=acceleration,
        near=near,
    )


#: Unit and meaning of each figure of a segment.
FIGURES: Mapping[str, tuple[str, str]] = {
    "utilisation": ("1", "mean adhesion as a share of the largest"),
    "overshoot": ("m/s", "largest slip beyond that of the largest adhesion"),
    "t95": ("s", "until adhesion stays above 95 % of the largest; empty where it never does"),
    "never95": ("1", "share of the runs in which it never does"),
    "slip_energy": ("J", "lost in the contact"),
    "slip_energy_share": ("1", "the same, per useful work of traction"),
    "torque_variation": ("kN m/s", "sum of the changes of torque, in a second"),
    "torque_largest": ("kN m", "largest torque of a motor"),
    "jerk_rms": ("m/s^3", "of the train"),
    "tracking_rms": ("m/s", "slip less that of the largest adhesion"),
    "tracking_rms_settled": ("m/s", "the same, from 2 s after the switch on"),
    "estimation_rms": ("m/s", "slip asked for less slip"),
    "estimation_rms_settled": ("m/s", "the same, from 2 s after the switch on"),
    "adhesion_rms": ("1", "adhesion observed less adhesion"),
    "slip_settled": ("m/s", "mean slip from 2 s after the switch on"),
    "utilisation_settled": ("1", "utilisation from 2 s after the switch on"),
    "ran_away": ("1", "share of the runs in which slip, settled, exceeds ten times the best"),
    "rolled_back": ("1", "share of the runs in which the train rolls back"),
    "stood": ("1", "share of the runs in which the train never moves"),
}


def figures(totals: Totals, period: float) -> dict[str, Float[Array, " segments"]]:
    """The figures of FIGURES for each segment of a run; NaN where a segment has no sample."""
    sums = totals.sums

    def mean(total: Array, count: Array) -> Array:
        return total / jnp.where(count > 0, count, jnp.nan)

    def root(squares: Array, count: Array) -> Array:
        return jnp.sqrt(mean(squares, count))

    def where_seen(what: Array) -> Array:
        return jnp.where(sums.samples > 0, what, jnp.nan)

    return {
        "utilisation": mean(sums.utilised, sums.samples),
        "overshoot": where_seen(totals.overshoot),
        "t95": totals.reached,
        "never95": where_seen(jnp.isnan(totals.reached)),
        "slip_energy": where_seen(sums.slip_energy),
        "slip_energy_share": mean(sums.slip_energy, jnp.abs(sums.useful_work)),
        "torque_variation": mean(sums.torque_variation, 1e3 * period * sums.samples),
        "torque_largest": where_seen(totals.torque_largest / 1e3),
        "jerk_rms": root(sums.jerk_squares, sums.samples),
        "tracking_rms": root(sums.tracking_squares, sums.samples),
        "tracking_rms_settled": root(sums.settled_tracking_squares, sums.settled_samples),
        "estimation_rms": root(sums.estimation_squares, sums.asked_samples),
        "estimation_rms_settled": root(sums.settled_estimation_squares, sums.settled_asked_samples),
        "adhesion_rms": root(sums.adhesion_squares, sums.samples),
        "slip_settled": mean(sums.settled_slip, sums.settled_samples),
        "utilisation_settled": mean(sums.settled_utilised, sums.settled_samples),
        "ran_away": where_seen(sums.runaway_samples > 0),
        "rolled_back": where_seen(totals.slowest < -STANDSTILL),
        "stood": where_seen(jnp.maximum(totals.fastest, -totals.slowest) < STANDSTILL),
    }


def whole(totals: Totals) -> Totals:
    """The totals of a run whose segments are taken as one; its t95 is that of the first."""
    return totals._replace(
        sums=jax.tree.map(lambda sum_: jnp.sum(sum_, keepdims=True), totals.sums),
        overshoot=jnp.max(totals.overshoot, keepdims=True),
        torque_largest=jnp.max(totals.torque_largest, keepdims=True),
        slowest=jnp.min(totals.slowest, keepdims=True),
        fastest=jnp.max(totals.fastest, keepdims=True),
        reached=totals.reached[:1],
    )
