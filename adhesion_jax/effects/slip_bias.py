from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Bending
from adhesion_jax.effects.planting import CleanRuns, Plan, by_its_formula, planted

_SOURCE = "odometry"


class SlipBias(Bending):
    """Source: any odometry; Burckhardt's curve changes as by a torque offset."""

    bias: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "bias": Parameter("1", -0.05, 0.05, "slip ratio that is missing", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("bias",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ()
    SENTENCE: ClassVar[str] = (
        "The wheel radius differs from the one that the slip was calculated with."
    )
    FORMULA: ClassVar[str] = "mu(l + e sign(l)), e the bias of the slip ratio"
    PHRASE: ClassVar[str] = "a bias of the slip"
    FAMILY: ClassVar[str] = "offset"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("slip_ratio",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("torque_offset",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("slip_ratio",)
    OF_SLIP_ALONE: ClassVar[bool] = True

    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        return slip + self.bias * jnp.sign(slip)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(bias=5e-4)]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        return by_its_formula(lambda bias: cls(bias=bias), 0.045, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """A wrong radius stretches the slip a little as well: l + a sign(l) (1 + |l|)."""

        def biased(slip: np.ndarray, amount: float) -> np.ndarray:
            return slip + amount * np.sign(slip) * (1 + np.abs(slip))

        return Plan(lambda a: planted(a, 0, before=lambda slip: biased(slip, a)), 0.04)
