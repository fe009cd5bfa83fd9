"""A curve that the package does not have, as somebody would add it: all of it is in this file."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves.base import SLIP_LIMIT, Conditions, Curve, Parameter, Peak, Scalar


class Hyperbolic(Curve):
    """mu(l) = a tanh(b l) - c l, odd in l. Peak where a b/cosh(b l)^2 = c."""

    a: Scalar
    b: Scalar
    c: Scalar
    free: tuple[str, ...] = eqx.field(default=("a", "b", "c"), static=True)

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "a": Parameter("1", 0.001, 2.0, "level of the plateau", "made up"),
        "b": Parameter("1", 0.5, 5000.0, "steepness of the rise", "made up"),
        "c": Parameter("1", 0.0, 5.0, "fall behind the peak", "made up"),
    }
    NEEDS: ClassVar[tuple[str, ...]] = ()
    AUTOMATIC: ClassVar[bool] = True

    @classmethod
    def starts(cls, top: float) -> Sequence[Sequence[float]]:
        return [(1.1 * top, steep, top) for steep in (15.0, 40.0, 120.0)]

    def __call__(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        return self.a * jnp.tanh(self.b * slip) - self.c * slip

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        steepness = self.a * self.b / jnp.maximum(self.c, 1e-300)
        rises = steepness > 1
        stationary = jnp.arccosh(jnp.sqrt(jnp.where(rises, steepness, 1.0))) / self.b
        slip = jnp.clip(stationary, 0.0, slip_limit)
        return Peak(slip, self(slip, conditions), rises & (stationary <= slip_limit))
