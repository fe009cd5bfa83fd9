"""One block a run under a law with effects, while the curve below them is all that is assumed."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from adhesion_jax.curves import Curve, free_values, with_free_values
from adhesion_jax.effects.conditions import NOMINAL_RADIUS
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.effects.saved import law_from
from adhesion_jax.errors import InputError
from adhesion_jax.metrics.information import (
    bound_of_information,
    information_of,
    stacked,
    true_quantities,
)
from adhesion_jax.options import Law, Outliers, Points, Sigma, SlipMax
from adhesion_jax.programs import kept
from adhesion_jax.records import Known, Record, record_axes
from adhesion_jax.scenarios.base import Group, Scenario
from adhesion_jax.scenarios.noise import draw_noise

#: Seconds from point to point.
_STEP = 0.1

#: The box of a parameter reaches from its value divided by this to its value times this.
_BOX = 5.0

#: The slips are the same in every run; adhesion and conditions are its own.
_RUN_AXES = record_axes(None, 0, 0)


class Corrected(Scenario):
    """mu = law(slip, conditions) + e, e ~ N(0, sigma^2), at one operating point a run.

    Every run sweeps the slip (a ratio; in m/s where the law was found so) from 0 to `slip_max` in
    traction, at 10 points a second. Each column of the law's ranges is drawn uniformly from its
    range and held through the run; what follows from time goes on: the position to and fro inside
    its range at the vehicle speed, the angle of the wheel from a random one on, the time from a
    random one of the campaign on.

    The truth is the curve below the effects: its parameters and its peak, under conditions in the
    middle of their ranges where the curve needs any. An identifier is told the form of that curve,
    and where the conditions are part of that form it knows them, but it knows of no effect. Its
    bias, RMSE and coverage are held against the bound of one who knows effects and conditions and
    lacks the parameters of the curve alone: what lies between them is the price of ignoring the
    effects.
    """

    rails: tuple[str, ...] = eqx.field(static=True)
    sigma: float = eqx.field(static=True)
    outliers: float = eqx.field(static=True)
    slip: Float[Array, " points"]
    law: CorrectedLaw
    known: Known
    run_axes: Any = eqx.field(default=_RUN_AXES, static=True)

    def conditions(self, key: PRNGKeyArray) -> dict[str, Float[Array, " points"]]:
        """The measured columns of one run."""
        ranges, calendar = self.law.ranges, self.law.calendar
        start_key, place_key, angle_key, *keys = jax.random.split(key, 3 + len(ranges))
        held = {
            name: _drawn(name, key, *ranges[name])
            for name, key in zip(sorted(ranges), keys, strict=True)
        }
        clock = _STEP * jnp.arange(self.slip.size)
        start = jax.random.uniform(start_key, minval=calendar.start, maxval=calendar.end)
        if calendar.column != "time_s":
            held[calendar.column], start = start, jnp.zeros(())
        columns = {name: jnp.broadcast_to(value, clock.shape) for name, value in held.items()}
        columns["time_s"] = start + clock
        speed = held.get("vehicle_speed_mps")
        if speed is not None:
            turned = jnp.cumsum(speed * (1 + self.slip) * _STEP) / NOMINAL_RADIUS
            angle = jax.random.uniform(angle_key, maxval=2 * jnp.pi)
            columns.setdefault("wheel_angle_rad", angle + turned)
            if "position_m" in ranges:
                place = _to_and_fro(place_key, speed * clock, *ranges["position_m"])
                columns["position_m"] = place
        return columns

    def draw(self, key: PRNGKeyArray) -> Record:
        noise_key, conditions_key = jax.random.split(key)
        conditions = self.conditions(conditions_key)
        clean = self.law(self.slip, conditions)[None]
        noise = draw_noise(noise_key, clean.shape, self.sigma, self.outliers)
        every = jnp.ones(clean.shape, dtype=bool)
        measured = {name: values[None] for name, values in conditions.items()}
        return Record(self.slip[None], clean + noise, every, every, measured)

    def quantities(self) -> Mapping[str, np.ndarray]:
        return true_quantities(stacked([self.known.curve]), self.known)

    def bound(self, record: Record) -> Float[Array, "blocks values"]:
        """For the parameters of the curve from this run, its effects and conditions known."""
        curve = self.known.curve
        conditions = {name: values[0] for name, values in record.conditions.items()}

        def adhesion(values: Float[Array, " free"]) -> Float[Array, " points"]:
            changed = with_free_values(curve, values)
            return dataclasses.replace(self.law, curve=changed)(self.slip, conditions)

        _, push = jax.linearize(adhesion, free_values(curve))
        information = information_of(jax.vmap(push)(jnp.eye(len(curve.free))))
        return bound_of_information(curve, information, self.sigma, self.known)[None]

    def support(self) -> np.ndarray:
        return np.array([self.slip.size])

    def tables(self) -> Mapping[str, Sequence[Group]]:
        return {"summary": [Group(self.rails[0], (0,))]}


def _drawn(name: str, key: PRNGKeyArray, low: float, high: float) -> Float[Array, ""]:
    """Uniform from low to high; of a label one of those between."""
    if name == "axle":
        return jnp.floor(jax.random.uniform(key, minval=low, maxval=high + 1))
    return jax.random.uniform(key, minval=low, maxval=high)


def _to_and_fro(
    key: PRNGKeyArray, way: Float[Array, " points"], low: float, high: float
) -> Float[Array, " points"]:
    """The places after these ways, turned back at either end.

    The start is uniform over there and back, and so every later place is uniform over the range.
    """
    span = high - low
    if span == 0.0:
        return jnp.full_like(way, low)
    start = jax.random.uniform(key, maxval=2 * span)
    return high - jnp.abs((start + way) % (2 * span) - span)


def _box(curve: Curve) -> tuple[Float[Array, " free"], Float[Array, " free"]]:
    """From a fifth to five times each parameter; where it may be of either sign, as far about it.

    Never beyond the physical bounds; a parameter that is zero may have a fifth of them.
    """
    lower, upper = [], []
    for name in curve.free:
        value, physical = float(getattr(curve, name)), curve.PARAMETERS[name]
        reach = _BOX * max(abs(value), 1.0)
        low, high = (
            (value - reach, value + reach)
            if physical.lower < 0
            else (value / _BOX, _BOX * value or physical.upper / _BOX)
        )
        lower.append(max(low, physical.lower))
        upper.append(min(high, physical.upper))
    return jnp.array(lower), jnp.array(upper)


@kept()
def _has_peak(known: Known) -> Bool[Array, ""]:
    return known.curve.peak(known.conditions, known.slip_limit).found


def corrected(
    law: Law,
    sigma: Sigma = 0.01,
    points: Points = 500,
    slip_max: SlipMax = 0.2,
    outliers: Outliers = 0.0,
) -> Corrected:
    """One block a run under a law with effects (--law), for who knows only the curve below them.

    InputError where the law has no peak or rests on what is not known.
    """
    truth = law_from(law, "the file of --law")
    curve, ranges = truth.curve, truth.ranges
    assert isinstance(curve, Curve)
    lower, upper = _box(curve)
    middle = {name: sum(ranges[name]) / 2 for name in curve.NEEDS if name in ranges}
    scenario = Corrected(
        rails=("corrected",),
        sigma=sigma,
        outliers=outliers,
        slip=jnp.linspace(0.0, slip_max, points),
        law=truth,
        known=Known(curve=curve, lower=lower, upper=upper, conditions=middle),
    )
    try:
        # A law asks for the columns it needs by name, so a missing one is a KeyError.
        jax.eval_shape(scenario.draw, jax.random.key(0))
    except KeyError as missing:
        raise InputError(
            f"the law of --law rests on {missing.args[0]} and has no range of it; add one to its "
            "ranges, the smallest and the largest value."
        ) from None
    if not bool(_has_peak(scenario.known)):
        raise InputError(
            "the curve of --law has no peak between slip 0 and 1, so that there is no mu_max to "
            "be identified; discover the law with another --base."
        )
    return scenario
