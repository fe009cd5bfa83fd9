from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Scaling
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "Voltr and Lata 2015, Veh. Syst. Dyn. 53:605-618"


class AxlePosition(Scaling):
    """Up to six axles; those beyond share the last. Source: Voltr and Lata 2015."""

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
    SENTENCE: ClassVar[str] = "Leading axles run on a dirtier rail than those behind."
    FORMULA: ClassVar[str] = (
        "mu (1 + k_j) at axle j; axle 0, the first label of the data, is the reference"
    )
    PHRASE: ClassVar[str] = "position of the axle"
    FAMILY: ClassVar[str] = "axle"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("axle",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:axle",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("axle",)

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        strengths = jnp.stack([jnp.zeros(()), self.k1, self.k2, self.k3, self.k4, self.k5])
        axle = jnp.clip(jnp.asarray(conditions["axle"]), 0, 5).astype(int)
        return 1 + strengths[axle]

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k1=0.03, k2=0.03, k3=0.03, k4=0.03, k5=0.03)]

    @classmethod
    def extra_columns(
        cls, columns: Mapping[str, np.ndarray], generator: np.random.Generator
    ) -> Mapping[str, np.ndarray]:
        return {"axle": columns["axle"]}

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        return by_its_formula(
            lambda a: cls(k1=0.4 * a, k2=0.7 * a, k3=1.0 * a, k4=1.0 * a, k5=1.0 * a), 2.5, runs
        )

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 + a (1 - 2^-(j - 1)) at axle j, counted from 1."""
        clean = 1 - 0.5 ** (runs.columns["axle"] - 1)
        return by_factor(lambda a: 1 + a * clean, 2.5)
