"""Surfaces of the shape of Polach's law with falling friction."""

import jax
import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from adhesion_jax.curves import (
    SLIP_LIMIT,
    Conditions,
    Law,
    Peak,
    PolachFalling,
    Scalar,
    Signal,
)
from adhesion_jax.traction.families.base import (
    Family,
    between,
    log_between,
    peaks,
    starts,
)
from adhesion_jax.traction.rails import ByTime
from adhesion_jax.traction.surface import RailSurface

#: Bounds of the shape at mu0 = 1, slip in units of 1/b: A and kS, and C, which is log-uniform.
LEFT, REDUCTIONS, STIFFNESSES = (0.2, 0.6), (0.2, 1.0), (30.0, 120.0)


class Stretched(Law):
    """mu(v) = mu_max g(x v/v*)/g(x): a shape g of slip with its peak at x, put to (v*, mu_max)."""

    shape: Law
    top: Peak  # of the shape
    slip: Scalar  # v*, m/s
    adhesion: Scalar  # mu_max

    def __call__(self, slip: Signal, conditions: Conditions) -> Signal:
        # The shape is one of slip velocity alone, whatever the speed of the train.
        found = self.shape(self.top.slip / self.slip * slip, {"vehicle_speed_mps": 1.0})
        return self.adhesion / self.top.adhesion * found

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        return Peak(jnp.asarray(self.slip), jnp.asarray(self.adhesion), self.top.found)


class PolachRails(Family):
    """Peaks are those of the nominal rails; how steep and how flat the curve is beside them varies.

    The law is PolachFalling in slip velocity.
    """

    TITLE = "curves of Polach's shape, one for each segment"

    def draw(self, key: PRNGKeyArray, step: float) -> ByTime:
        keys = jax.random.split(key, 5)
        shapes = (
            between(keys[0], LEFT),
            between(keys[1], REDUCTIONS),
            log_between(keys[2], STIFFNESSES),
        )
        surfaces = RailSurface(jax.vmap(_law)(*peaks(keys[3]), *shapes))
        return ByTime(surfaces, starts(keys[4], step))


def _law(slip: Scalar, adhesion: Scalar, left: Scalar, k_s: Scalar, stiffness: Scalar) -> Stretched:
    shape = PolachFalling(mu0=1.0, a=left, b=1.0, stiffness=stiffness, k_s=k_s)
    return Stretched(shape, shape.peak({"vehicle_speed_mps": 1.0}), slip, adhesion)
