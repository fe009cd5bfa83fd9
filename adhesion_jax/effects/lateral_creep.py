from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Cause
from adhesion_jax.effects.planting import CleanRuns, Plan, Planted, by_its_formula, planted

_SOURCE = "Polach 2005, Wear 258, 992-1000"

#: Keeps the square root differentiable where there is neither slip nor lateral creepage.
_SMALL = 1e-16


class LateralCreep(Cause):
    """The column y is the lateral creepage where it is measured (g near one), else the curvature.

    An axle meets a curve at an angle of about its distance from the middle times the curvature,
    so that g is then in m.
    Source: Polach 2005; Kalker 1967.
    """

    gain: Scalar
    offset: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "gain": Parameter("1 or m", 0.0, 50.0, "lateral creepage per unit of the column", _SOURCE),
        "offset": Parameter(
            "1 or 1/m", -0.2, 0.2, "column value without lateral creepage", _SOURCE
        ),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("gain",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("lateral_measure",)
    ORDER: ClassVar[int] = 0
    SENTENCE: ClassVar[str] = "Lateral creep uses a part of the friction."
    FORMULA: ClassVar[str] = "mu(l_t) l/l_t, l_t^2 = l^2 + l_y^2, l_y = g (y - y0)"
    PHRASE: ClassVar[str] = "lateral creep"
    FAMILY: ClassVar[str] = "curvature"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("lateral_measure",)
    SAME_AS: ClassVar[tuple[str, ...]] = (
        "covariate:angle_of_attack_deg",
        "covariate:lateral_creepage",
    )
    SEEN_IN: ClassVar[tuple[str, ...]] = (
        "curvature_per_m",
        "angle_of_attack_deg",
        "lateral_creepage",
    )

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

    @classmethod
    def extra_columns(
        cls, columns: Mapping[str, np.ndarray], generator: np.random.Generator
    ) -> Mapping[str, np.ndarray]:
        return {"angle_of_attack_deg": columns["angle_of_attack_deg"]}

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        return by_its_formula(lambda gain: cls(gain=gain, offset=0.0), 45.0, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """The powers of 1.6 add up instead of the squares."""
        lateral = np.abs(np.tan(np.deg2rad(runs.columns["angle_of_attack_deg"])))

        def total(slip: np.ndarray, amount: float) -> np.ndarray:
            return (np.abs(slip) ** 1.6 + (amount * lateral) ** 1.6) ** (1 / 1.6)

        def make(amount: float) -> Planted:
            share = np.abs(runs.slip) / total(runs.slip, amount)
            return planted(
                amount,
                0,
                before=lambda slip: np.sign(slip) * total(slip, amount),
                after=lambda adhesion: adhesion * share,
            )

        return Plan(make, 30.0)
