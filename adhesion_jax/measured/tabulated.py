"""Laws that a loop asks millions of times: what takes long to compute in them is in tables."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import SLIP_LIMIT, Conditions, Curve, Law, Peak, Scalar, Signal
from adhesion_jax.curves.bent import Bent, place_of

#: Number of cubics that a departure is made of, for slips of either sign.
_CUBICS = 2048

#: Speeds of the train in m/s at which the peak of a law is sought.
_SPEEDS = np.geomspace(0.05, 150.0, 512)


class Tabulated(Law):
    """A curve and its departure, the sum of sines as cubics in the place u."""

    curve: Curve
    cubics: Float[Array, "cells powers"]  # from u = -1, of negative slips, to 1
    reach: Scalar
    largest: Scalar

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        place = jnp.sign(slip) * place_of(slip, self.reach, self.largest)
        cell = jnp.clip(jnp.floor(_CUBICS * place), -_CUBICS, _CUBICS - 1)
        within = _CUBICS * place - cell
        a, b, c, d = jnp.moveaxis(self.cubics[cell.astype(int) + _CUBICS], -1, 0)
        return self.curve(slip, conditions) * (1 + a + within * (b + within * (c + within * d)))


def tabulated(law: Law) -> Law:
    """The law, a departure of it in a table, each cubic of which goes through four points."""
    if not isinstance(law, Bent):
        return law
    within = np.arange(4) / 3
    places = (np.arange(-_CUBICS, _CUBICS)[:, None] + within) / _CUBICS
    width = jnp.log1p(law.largest / law.reach)
    slips = jnp.sign(places) * law.reach * jnp.expm1(jnp.abs(places) * width)
    powers = np.linalg.inv(np.vander(within, increasing=True))
    return Tabulated(law.curve, law.departure(slips) @ powers.T, law.reach, law.largest)


class Peaked(Law):
    """A law whose peak is known at some speeds of the train, and is not sought at others.

    Beyond the speeds it has the slip of the nearest.
    """

    law: Law
    peaks: Peak  # [speeds]

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        return self.law(slip, conditions)

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        last, speed = len(_SPEEDS) - 1, jnp.maximum(conditions["vehicle_speed_mps"], _SPEEDS[0])
        ratio = np.log(_SPEEDS[-1] / _SPEEDS[0]) / last
        place = jnp.minimum(jnp.log(speed / _SPEEDS[0]) / ratio, last)
        before = jnp.minimum(place.astype(int), last - 1)
        low, high = self.peaks.slip[before], self.peaks.slip[before + 1]
        # From one speed to the next the peak may go over to another maximum.
        slips = jnp.stack([low + (place - before) * (high - low), low, high])
        adhesion = self.law(slips, conditions)
        best = jnp.argmax(adhesion)
        found = self.peaks.found[jnp.round(place).astype(int)]
        return Peak(slips[best], adhesion[best], found)


def peaked(law: Law, slip_limit: float) -> Peaked:
    """The law, with its peaks up to a slip."""
    sought = jax.vmap(lambda speed: law.peak({"vehicle_speed_mps": speed}, slip_limit))
    return Peaked(law, sought(jnp.asarray(_SPEEDS)))
