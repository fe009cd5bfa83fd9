"""Joints and corrugation modulate the adhesion along the track."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.discovery.effects.base import Columns, Effect

_SOURCE = "Grassie 2009, Proc. IMechE F 223:581-596"


class RailJoint(Effect):
    """mu (1 + a sin(2 pi x/L) + b cos(2 pi x/L)), x the position in m, L the length of a rail.

    Source: Grassie 2009, Proc. IMechE F 223:581-596.
    """

    sine: Scalar
    cosine: Scalar
    length: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "sine": Parameter("1", -0.9, 0.9, "amplitude of the sine", _SOURCE),
        "cosine": Parameter("1", -0.9, 0.9, "amplitude of the cosine", _SOURCE),
        "length": Parameter("m", 0.5, 200.0, "distance from joint to joint", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("sine", "cosine")
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("position_m",)
    ORDER: ClassVar[int] = 1

    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        return slip

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        phase = 2 * jnp.pi * conditions["position_m"] / self.length
        return adhesion * (1 + self.sine * jnp.sin(phase) + self.cosine * jnp.cos(phase))

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [
            cls(sine=0.03, cosine=0.03, length=length)
            for length in (10.0, 12.5, 15.0, 18.0, 20.0, 25.0, 30.0, 36.0)
        ]
