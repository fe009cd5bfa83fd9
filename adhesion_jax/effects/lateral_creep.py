"""Lateral creep takes its share of the friction."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "Polach 2005, Wear 258, 992-1000"

#: Keeps the square root differentiable where there is neither slip nor lateral creepage.
_SMALL = 1e-16


class LateralCreep(Effect):
    """mu(l_t) l/l_t, l_t^2 = l^2 + l_y^2, l_y = g (y - y0).

    y is the lateral creepage where it is measured (g near one), else the curvature of the track,
    which an axle meets at an angle of about its distance from the middle times kappa (g in m).
    Source: Polach 2005; Kalker 1967.
    """

    gain: Scalar
    offset: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "gain": Parameter("1 or m", 0.0, 50.0, "lateral creepage a unit of the column", _SOURCE),
        "offset": Parameter(
            "1 or 1/m", -0.2, 0.2, "column value without lateral creepage", _SOURCE
        ),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("gain",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("lateral_measure",)
    ORDER: ClassVar[int] = 0

    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        lateral = self.gain * (conditions["lateral_measure"] - self.offset)
        return jnp.where(slip < 0, -1.0, 1.0) * jnp.sqrt(slip**2 + lateral**2 + _SMALL)

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        lateral = self.gain * (conditions["lateral_measure"] - self.offset)
        total = jnp.sqrt(slip**2 + lateral**2 + _SMALL)
        return adhesion * jnp.abs(slip) / total

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        spread = float(np.std(columns["lateral_measure"]))
        return [
            cls(gain=min(gain, 50.0), offset=0.0) for gain in (0.3, 1.0, 0.005 / max(spread, 1e-6))
        ]
