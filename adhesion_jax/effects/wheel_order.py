"""A wheel out of round modulates the adhesion with its angle."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "Iwnicki 2006, Handbook of Railway Vehicle Dynamics"


class WheelOrder(Effect):
    """mu (1 + wave(n theta)), a wave and its second harmonic, theta the wheel's angle in rad.

    Without an angle, the rolled distance over a nominal radius of .46 m; n is then no whole number.
    Source: Iwnicki 2006, chapter 4.
    """

    sine: Scalar
    cosine: Scalar
    sine2: Scalar
    cosine2: Scalar
    order: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "sine": Parameter("1", -0.9, 0.9, "amplitude of the sine", _SOURCE),
        "cosine": Parameter("1", -0.9, 0.9, "amplitude of the cosine", _SOURCE),
        "sine2": Parameter("1", -0.9, 0.9, "amplitude of the second sine", _SOURCE),
        "cosine2": Parameter("1", -0.9, 0.9, "amplitude of the second cosine", _SOURCE),
        "order": Parameter("1", 0.2, 40.0, "waves a turn", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("sine", "cosine")
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("wheel_angle_rad",)
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
        phase = self.order * conditions["wheel_angle_rad"]
        first = self.sine * jnp.sin(phase) + self.cosine * jnp.cos(phase)
        second = self.sine2 * jnp.sin(2 * phase) + self.cosine2 * jnp.cos(2 * phase)
        return adhesion * (1 + first + second)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(0.03, 0.03, 0.0, 0.0, order=float(n)) for n in (1, 2, 3, 4, 5, 6)]
