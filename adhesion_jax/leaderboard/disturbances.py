"""What acts on a train and its method does not know: one list, with levels, tags and words."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import pandas as pd
from jaxtyping import Array, Bool, Int, PRNGKeyArray

from adhesion_jax.campaign.traction import WHOLE
from adhesion_jax.metrics.closed_loop import FIGURES
from adhesion_jax.traction.families import Family
from adhesion_jax.traction.families.base import LENGTH, SEGMENTS
from adhesion_jax.traction.families.exponential import ExponentialRails
from adhesion_jax.traction.loop import Loop
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.plants.reading import read_plant, shipped
from adhesion_jax.traction.plants.rigid_axles import RigidAxles
from adhesion_jax.traction.rails import Rails, Timed
from adhesion_jax.traction.sensors import SpeedNoise
from adhesion_jax.traction.signals import Number
from adhesion_jax.traction.surface import RailSurface

Level = Number | float


class Hurried(Timed):
    """Rails whose segments follow one another some times as fast, from the first on again."""

    surfaces: RailSurface
    starts: Int[Array, " segments"]
    times: Int[Array, ""]
    length: int = eqx.field(static=True)  # of all segments, in steps

    def segment(
        self, step: Int[Array, ""], train_speed: Number, braking: Bool[Array, ""]
    ) -> Int[Array, ""]:
        return super().segment(self.times * step % self.length, train_speed, braking)


class Disturbance(Family):
    """Exponential rails, and what differs of train and sensors from what is known; 0 is nothing.

    What is known wrong is changed in the knowledge: an axle that bears more than is known is one of
    which less is known.
    """

    TITLE = "exponential curves, and a disturbance"

    radius: Level = 0.0  # share by which the radius is known too large
    count: Level = 0.0  # share by which the speed of the motor is read too fast
    speed: Level = 0.0  # by which the speed of the train is read too fast, m/s
    noise: Level = 0.0  # of the speeds beyond the nominal one, in units of it
    inertia: Level = 0.0  # share by which it is larger than known
    load: Level = 0.0  # share by which an axle bears more than is known
    lag: Level = 0.0  # of the motor beyond the known one, s
    dead_time: Level = 0.0  # from a command to its first effect, s
    dip: Level = 0.0  # share of the power that is missing in .2 s of each second
    hurry: int | Int[Array, ""] = 0  # changes of the rail in the time of one, beyond it
    plant: Plant | None = None  # of another build than is known
    pulses: int = eqx.field(default=0, static=True)  # of an encoder read by its last period

    @property
    def drawn_as(self) -> str:
        return "exponential"

    def draw(self, key: PRNGKeyArray, step: float) -> Rails:
        rails = ExponentialRails().draw(key, step)
        length = round(SEGMENTS * LENGTH / step)
        return Hurried(rails.surfaces, rails.starts, jnp.asarray(1 + self.hurry), length)

    def met(self, loop: Loop) -> Loop:
        known, sensors = loop.nominal, loop.sensors
        if not isinstance(known, RigidAxles) or sensors.noise is None:
            raise TypeError("a disturbance acts on a train that is known as rigid, with noise")
        plant = loop.plant if self.plant is None else self.plant
        more = 1 + self.noise
        return replace(
            loop,
            plant=replace(
                plant,
                torque_lag=plant.torque_lag + self.lag,
                dead_time=plant.dead_time + self.dead_time,
            ),
            nominal=replace(
                known,
                motor_inertia=known.motor_inertia / (1 + self.inertia),
                wheelset_inertia=known.wheelset_inertia / (1 + self.inertia),
                axle_load=known.axle_load / (1 + self.load),
            ),
            sensors=replace(
                sensors,
                noise=SpeedNoise(more * sensors.noise.motor, more * sensors.noise.train),
                train_bias=sensors.train_bias + self.speed,
                radius_error=sensors.radius_error + self.radius,
                count_error=sensors.count_error + self.count,
                pulses=self.pulses,
                by_period=self.pulses > 0,
            ),
            dip=loop.dip + self.dip,
        )


class Listed(NamedTuple):
    """A disturbance, in words, where its level comes from, and whether it is tuned on."""

    disturbance: Disturbance
    words: str
    tag: str = "A"
    tuned_on: bool = False


def _twisting(
    frequency: float, damping: float = 0.01, backlash: float = 0.0, dead_time: float = 0.0
) -> Disturbance:
    plant: Any = read_plant(shipped()["hxd1f_twist"]).plant
    plant = replace(
        plant,
        twist_frequency=jnp.asarray(frequency),
        twist_damping=jnp.asarray(damping),
        backlash=jnp.asarray(backlash),
    )
    return Disturbance(plant=plant, dead_time=dead_time)


@cache
def disturbances() -> Mapping[str, Listed]:
    """All, by name. Half are tuned on, a third of which twist; all are judged."""
    return {
        "nominal": Listed(Disturbance(), "nothing differs from what is known", "D", True),
        "wheel-0.5%": Listed(Disturbance(radius=0.005), "the wheel is .5 % smaller than known"),
        "wheel+0.5%": Listed(
            Disturbance(radius=-0.005), "the wheel is .5 % larger than known", tuned_on=True
        ),
        "wheel-1%": Listed(
            Disturbance(radius=0.01), "the wheel is 1 % smaller than known", tuned_on=True
        ),
        "wheel+1%": Listed(Disturbance(radius=-0.01), "the wheel is 1 % larger than known"),
        "inertia+20%": Listed(
            Disturbance(inertia=0.2), "inertia is 20 % larger than known", tuned_on=True
        ),
        "inertia-20%": Listed(Disturbance(inertia=-0.2), "inertia is 20 % smaller than known"),
        "speed-bias": Listed(
            Disturbance(speed=0.05), "the speed of the train is read .05 m/s too fast"
        ),
        "noise-x3": Listed(
            Disturbance(noise=2.0), "noise of the speeds is three times as large", tuned_on=True
        ),
        "encoder": Listed(
            Disturbance(pulses=80), "the speed of the motor is that of the last of 80 pulses a turn"
        ),
        "worn-and-miscounted": Listed(
            Disturbance(radius=0.01, count=0.0125),
            "the wheel is 1 % smaller than known, and 81 pulses of the encoder count as 80",
        ),
        "dead-time-5ms": Listed(
            Disturbance(dead_time=0.005), "torque begins 5 ms after its command", tuned_on=True
        ),
        "dead-time-10ms": Listed(
            Disturbance(dead_time=0.01), "torque begins 10 ms after its command", tuned_on=True
        ),
        "dead-time-5ms-switches": Listed(
            Disturbance(dead_time=0.005, hurry=4),
            "torque begins 5 ms after its command, and the rail changes every second",
        ),
        "lag-20ms": Listed(Disturbance(lag=0.01), "the lag of the motor is 20 ms instead of 10"),
        "load+10%": Listed(Disturbance(load=0.1), "the axle bears 10 % more than is known"),
        "load-10%": Listed(
            Disturbance(load=-0.1), "the axle bears 10 % less than is known", tuned_on=True
        ),
        "power-dips": Listed(
            Disturbance(dip=2 / 3), "two thirds of the power are missing in .2 s of each second"
        ),
        "twist-30Hz": Listed(_twisting(30.0), "the axle twists at 30 Hz", tuned_on=True),
        "twist-45Hz": Listed(_twisting(45.0), "the axle twists at 45 Hz", tuned_on=True),
        "twist-45Hz-undamped": Listed(
            _twisting(45.0, 0.005),
            "the axle twists at 45 Hz, damped by half as much",
            tuned_on=True,
        ),
        "twist-70Hz": Listed(_twisting(70.0), "the axle twists at 70 Hz", tuned_on=True),
        "backlash": Listed(
            _twisting(45.0, backlash=1e-3), "the axle twists at 45 Hz with a play of 1 mrad"
        ),
        "twist-30Hz-dead-10ms": Listed(
            _twisting(30.0, dead_time=0.01),
            "the axle twists at 30 Hz, and torque begins 10 ms after its command",
        ),
    }


#: The name of the rows over all disturbances.
ALL = "all"


def over_all(segments: pd.DataFrame) -> pd.DataFrame:
    """Each run of a method as the mean over the disturbances; of the axle its largest torque."""
    whole = segments[segments["segment"] == WHOLE]
    runs = whole.astype({"method": str}).groupby(["method", "seed", "run"], sort=False)
    means = runs[[*FIGURES]].mean()
    means.loc[runs["utilisation"].count() < runs.size(), "utilisation"] = float("nan")
    means["axle_torque_over_static"] = runs["axle_torque_over_static"].max()
    return means.reset_index().assign(rails=ALL, segment=WHOLE)


def with_worst(table: pd.DataFrame) -> pd.DataFrame:
    """With the worst run under any disturbance in the rows over all, and the mean of never95."""
    everywhere = table["rails"] == ALL
    by_method = table[~everywhere].groupby("method")
    found = {"worst": by_method["worst"].min(), "never95": by_method["never95"].mean()}
    return table.assign(
        **{
            name: table[name].where(~everywhere, table["method"].map(values))
            for name, values in found.items()
        }
    )
