from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Scaling
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula

_SOURCE = "Iwnicki 2006, Handbook of Railway Vehicle Dynamics"


class LoadTransfer(Scaling):
    """The adhesion is taken for the load at rest. Source: Iwnicki 2006, chapter 7."""

    k: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("s^2/m", -1.0, 1.0, "relative change with acceleration", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("acceleration_mps2",)
    SENTENCE: ClassVar[str] = "Acceleration shifts load between axles."
    FORMULA: ClassVar[str] = "mu (1 + k a), a the acceleration of the vehicle in m/s^2"
    PHRASE: ClassVar[str] = "load transfer"
    FAMILY: ClassVar[str] = "load_transfer"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("acceleration_mps2",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:acceleration_mps2",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("acceleration",)

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        return jnp.maximum(1 + self.k * conditions["acceleration_mps2"], 0.0)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=0.02)]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        return by_its_formula(lambda k: cls(k=k), 0.9, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 + a tanh(dV/dt/.5)."""
        change = np.tanh(runs.rate(runs.speed) / 0.5)
        return by_factor(lambda a: 1 + a * change, 0.9)
