"""What acts on a train and its method does not know: disturbances.toml has levels, tags, words."""

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import pandas as pd
from jaxtyping import Array, Bool, Int, PRNGKeyArray

from adhesion_jax.campaign.traction import WHOLE
from adhesion_jax.metrics.closed_loop import FIGURES
from adhesion_jax.traction.families import Family
from adhesion_jax.traction.families.base import LENGTH, SEGMENTS
from adhesion_jax.traction.families.by_segment import ExponentialRails
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
            ),
            dip=loop.dip + self.dip,
        )


class Listed(NamedTuple):
    """A disturbance, in words, where its level comes from, and whether it is tuned on."""

    disturbance: Disturbance
    words: str
    tag: str
    tuned_on: bool


@cache
def disturbances() -> Mapping[str, Listed]:
    """All, by name. Half are tuned on, a third of which twist; all are judged."""
    path = Path(__file__).with_suffix(".toml")
    return {name: _listed(**told) for name, told in tomllib.loads(path.read_text("utf-8")).items()}


def _listed(
    words: str,
    tag: str = "A",
    tuned_on: bool = False,
    twisting: Mapping[str, float] | None = None,
    **levels: Any,
) -> Listed:
    """A disturbance of some levels; `twisting` are those of axles that twist."""
    if twisting is not None:
        plant: Any = read_plant(shipped()["hxd1f_twist"]).plant
        numbers = {name: jnp.asarray(value) for name, value in twisting.items()}
        levels["plant"] = replace(plant, **numbers)
    return Listed(Disturbance(**levels), words, tag, tuned_on)


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
