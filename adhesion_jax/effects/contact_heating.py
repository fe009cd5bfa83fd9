from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Changing
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "Ertz and Knothe 2002, Wear 253, 498-508"


class ContactHeating(Changing):
    """The flash temperature is mu p0 v_s sqrt(a/V); pressure p0 and half axis a are in k.

    Source: Ertz and Knothe 2002, Wear 253, 498-508.
    """

    k: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("sqrt(s/m)", -2.0, 20.0, "relative fall with heating", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps",)
    ORDER: ClassVar[int] = 1
    SENTENCE: ClassVar[str] = "The contact heats and softens: adhesion falls with friction power."
    FORMULA: ClassVar[str] = (
        "mu (1 - k |mu| v_s/sqrt(V)), v_s = |l| V the slip velocity and V the vehicle speed in m/s"
    )
    ONE_SIDED: ClassVar[bool] = True
    PHRASE: ClassVar[str] = "contact heating"
    FAMILY: ClassVar[str] = "slip velocity"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("slip_ratio", "vehicle_speed_mps")
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:slip_velocity_mps",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps", "slip_velocity_mps")

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        speed = jnp.maximum(conditions["vehicle_speed_mps"], 1e-3)
        heating = jnp.abs(adhesion) * jnp.abs(slip) * jnp.sqrt(speed)
        return adhesion * jnp.maximum(1 - self.k * heating, 0.0)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=0.1)]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        return by_its_formula(lambda k: cls(k=k), 15.0, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1/(1 + a |l| sqrt(V))."""
        flash = np.abs(runs.slip) * np.sqrt(runs.speed)
        return by_factor(lambda a: 1 / (1 + a * flash), 20.0)
