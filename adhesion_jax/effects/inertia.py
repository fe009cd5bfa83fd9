"""The torque that accelerates the wheel was taken for adhesion."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.history import has_history, rate

_SOURCE = "Voltr and Lata 2015, Veh. Syst. Dyn. 53:605-618"


class Inertia(Effect):
    """mu + k d(V (1 + l))/dt, the circumferential acceleration of the wheel in m/s^2.

    k = J/(r^2 F), J the moment of inertia of what turns. Source: Newton; Voltr and Lata 2015.
    """

    k: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("s^2/m", -1.0, 1.0, "rotating mass over load", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps", "acceleration_mps2", "time_s")
    ORDER: ClassVar[int] = 2

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
        if not has_history(conditions):
            return adhesion
        # The speed is noisy, the slip is not: their rates are taken over different times.
        slipping = conditions["vehicle_speed_mps"] * rate(slip, conditions)
        rolling = conditions["acceleration_mps2"] * (1 + slip)
        return adhesion + self.k * (slipping + rolling)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=0.003)]
