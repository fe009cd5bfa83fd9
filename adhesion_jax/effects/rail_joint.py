"""Joints and corrugation modulate the adhesion along the track."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "Grassie 2009, Proc. IMechE F 223:581-596"


class RailJoint(Effect):
    """mu (1 + wave(2 pi x/L)), a wave and its second harmonic, x in m, L the length of a rail.

    Source: Grassie 2009, Proc. IMechE F 223:581-596.
    """

    sine: Scalar
    cosine: Scalar
    sine2: Scalar
    cosine2: Scalar
    length: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "sine": Parameter("1", -0.9, 0.9, "amplitude of the sine", _SOURCE),
        "cosine": Parameter("1", -0.9, 0.9, "amplitude of the cosine", _SOURCE),
        "sine2": Parameter("1", -0.9, 0.9, "amplitude of the second sine", _SOURCE),
        "cosine2": Parameter("1", -0.9, 0.9, "amplitude of the second cosine", _SOURCE),
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
        first = self.sine * jnp.sin(phase) + self.cosine * jnp.cos(phase)
        second = self.sine2 * jnp.sin(2 * phase) + self.cosine2 * jnp.cos(2 * phase)
        return adhesion * (1 + first + second)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [
            cls(sine=0.03, cosine=0.03, sine2=0.0, cosine2=0.0, length=length)
            for length in (10.0, 12.5, 15.0, 18.0, 20.0, 25.0, 30.0, 36.0)
        ]
