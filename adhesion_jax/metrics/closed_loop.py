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


class Sample(NamedTuple):
    """What is true and what is known at one moment; means over the axles where there are several.

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


class Totals(NamedTuple):
    """Sums and extremes [segments] over the samples of a run, and what the next sample needs."""

    samples: Float[Array, " segments"]
    utilised: Float[Array, " segments"]
    overshoot: Float[Array, " segments"]
    reached: Float[Array, " segments"]  # s; NaN: not yet
    slip_energy: Float[Array, " segments"]
    useful_work: Float[Array, " segments"]
    torque_variation: Float[Array, " segments"]
    torque_largest: Float[Array, " segments"]
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
    largest_slip: Float[Array, ""]  # of the run, m/s
    lowest_speed: Float[Array, ""]  # of the run, m/s
    age: Int[Array, ""]  # samples since the segment began
    last: Sample
    acceleration: Float[Array, ""]  # of the train, m/s^2
    near: Bool[Array, " stretch"]  # whether each sample of the last stretch was near the peak


def start(first: Sample, segments: int, period: float) -> Totals:
    """Nothing counted yet; `period` is the time from a sample to the next, in s."""
    none = jnp.zeros(segments)
    zero = jnp.zeros(())
    counted = dict.fromkeys(Totals._fields[:19], none)
    counted |= {"overshoot": none - jnp.inf, "reached": none + jnp.nan}
    return Totals(
        **counted,
        largest_slip=zero,
        lowest_speed=first.train_speed,
        age=jnp.zeros((), dtype=int),
        last=first,
        acceleration=zero,
        near=jnp.zeros(max(round(STRETCH / period), 1), dtype=bool),
    )


def add(totals: Totals, sample: Sample, number: Int[Array, ""], period: float) -> Totals:
    """After one more sample, of which `number` are before it in the run."""
    last = totals.last
    same = (sample.segment == last.segment) & (number > 0)
    age = jnp.where(same, totals.age + 1, 0)
    here = (jnp.arange(totals.samples.size) == sample.segment) & sample.counts
    settled = here & (age * period >= SETTLED)

    share = sample.direction * sample.adhesion / sample.largest
    utilised = jnp.mean(share)
    tracking = jnp.mean((sample.slip - sample.optimum) ** 2)
    asks = jnp.all(jnp.isfinite(sample.asked))
    estimation = jnp.where(asks, jnp.mean((sample.asked - sample.slip) ** 2), 0.0)
    acceleration = jnp.where(number > 0, (sample.train_speed - last.train_speed) / period, 0.0)
    jerk = jnp.where(number > 1, (acceleration - totals.acceleration) / period, 0.0)
    moved = jnp.where(number > 0, jnp.mean(jnp.abs(sample.torque - last.torque)), 0.0)

    # A ring of flags: what leaves the stretch is what stood where the new one goes.
    near = jnp.where(same, totals.near, False)
    place = number % near.size
    near = jax.lax.dynamic_update_index_in_dim(near, utilised >= SHARE_OF_PEAK, place, 0)
    held = (jnp.sum(near) >= SHARE_OF_SAMPLES * near.size) & (age + 1 >= near.size)
    began = (age + 1 - near.size) * period
    fills = here & held & jnp.isnan(totals.reached)

    def summed(total: Array, what: Array | float, where: Array = here) -> Array:
        return total + jnp.where(where, what, 0.0)

    over = sample.direction * (sample.slip - sample.optimum)
    slip = jnp.mean(sample.slip)
    return Totals(
        samples=summed(totals.samples, 1.0),
        utilised=summed(totals.utilised, utilised),
        overshoot=jnp.where(here, jnp.maximum(totals.overshoot, jnp.max(over)), totals.overshoot),
        reached=jnp.where(fills, began, totals.reached),
        slip_energy=summed(totals.slip_energy, period * jnp.abs(sample.slip_power)),
        useful_work=summed(totals.useful_work, period * sample.pull * sample.train_speed),
        torque_variation=summed(totals.torque_variation, moved),
        torque_largest=jnp.where(
            here,
            jnp.maximum(totals.torque_largest, jnp.max(jnp.abs(sample.torque))),
            totals.torque_largest,
        ),
        jerk_squares=summed(totals.jerk_squares, jerk**2),
        tracking_squares=summed(totals.tracking_squares, tracking),
        estimation_squares=summed(totals.estimation_squares, estimation),
        adhesion_squares=summed(
            totals.adhesion_squares, jnp.mean((sample.observed - sample.adhesion) ** 2)
        ),
        asked_samples=summed(totals.asked_samples, 1.0 * asks),
        settled_asked_samples=summed(totals.settled_asked_samples, 1.0 * asks, settled),
        settled_samples=summed(totals.settled_samples, 1.0, settled),
        settled_slip=summed(totals.settled_slip, slip, settled),
        settled_utilised=summed(totals.settled_utilised, utilised, settled),
        settled_tracking_squares=summed(totals.settled_tracking_squares, tracking, settled),
        settled_estimation_squares=summed(totals.settled_estimation_squares, estimation, settled),
        largest_slip=jnp.maximum(totals.largest_slip, jnp.max(jnp.abs(sample.slip))),
        lowest_speed=jnp.minimum(totals.lowest_speed, sample.train_speed),
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
}


def figures(totals: Totals, period: float) -> dict[str, Float[Array, " segments"]]:
    """The figures of FIGURES for each segment of a run; NaN where a segment has no sample."""
    samples = jnp.where(totals.samples > 0, totals.samples, jnp.nan)
    settled = jnp.where(totals.settled_samples > 0, totals.settled_samples, jnp.nan)
    asked = jnp.where(totals.asked_samples > 0, totals.asked_samples, jnp.nan)
    settled_asked = totals.settled_asked_samples
    settled_asked = jnp.where(settled_asked > 0, settled_asked, jnp.nan)
    work = jnp.abs(totals.useful_work)
    return {
        "utilisation": totals.utilised / samples,
        "overshoot": jnp.where(jnp.isnan(samples), jnp.nan, totals.overshoot),
        "t95": totals.reached,
        "never95": jnp.where(jnp.isnan(samples), jnp.nan, 1.0 * jnp.isnan(totals.reached)),
        "slip_energy": totals.slip_energy * samples / samples,
        "slip_energy_share": totals.slip_energy / jnp.where(work > 0, work, jnp.nan),
        "torque_variation": totals.torque_variation / (1e3 * period * samples),
        "torque_largest": totals.torque_largest / 1e3 * samples / samples,
        "jerk_rms": jnp.sqrt(totals.jerk_squares / samples),
        "tracking_rms": jnp.sqrt(totals.tracking_squares / samples),
        "tracking_rms_settled": jnp.sqrt(totals.settled_tracking_squares / settled),
        "estimation_rms": jnp.sqrt(totals.estimation_squares / asked),
        "estimation_rms_settled": jnp.sqrt(totals.settled_estimation_squares / settled_asked),
        "adhesion_rms": jnp.sqrt(totals.adhesion_squares / samples),
        "slip_settled": totals.settled_slip / settled,
        "utilisation_settled": totals.settled_utilised / settled,
    }
