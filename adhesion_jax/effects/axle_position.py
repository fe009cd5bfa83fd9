"""Leading axles run on a dirtier rail than those behind."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "Voltr and Lata 2015, Veh. Syst. Dyn. 53:605-618"


class AxlePosition(Effect):
    """mu (1 + k_j) at axle j; axle 0, the first label of the data, is the reference.

    Up to six axles; those beyond share the last. Source: Voltr and Lata 2015.
    """

    k1: Scalar
    k2: Scalar
    k3: Scalar
    k4: Scalar
    k5: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k1": Parameter("1", -0.9, 3.0, "relative change at axle 1", _SOURCE),
        "k2": Parameter("1", -0.9, 3.0, "relative change at axle 2", _SOURCE),
        "k3": Parameter("1", -0.9, 3.0, "relative change at axle 3", _SOURCE),
        "k4": Parameter("1", -0.9, 3.0, "relative change at axle 4", _SOURCE),
        "k5": Parameter("1", -0.9, 3.0, "relative change at axle 5", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k1", "k2", "k3", "k4", "k5")
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("axle",)
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
        strengths = jnp.stack([jnp.zeros(()), self.k1, self.k2, self.k3, self.k4, self.k5])
        axle = jnp.clip(jnp.asarray(conditions["axle"]), 0, 5).astype(int)
        return adhesion * (1 + strengths[axle])

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k1=0.03, k2=0.03, k3=0.03, k4=0.03, k5=0.03)]
