from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.cause import Changing
from adhesion_jax.effects.planting import CleanRuns, Plan, by_its_formula, planted

_SOURCE = "measuring chain"


class TorqueOffset(Changing):
    """Source: any measured driving torque."""

    offset: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "offset": Parameter("1", -0.5, 0.5, "adhesion that is added", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("offset",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ()
    ORDER: ClassVar[int] = 1
    SENTENCE: ClassVar[str] = "The force signal has an offset, such as the torque of losses."
    FORMULA: ClassVar[str] = "mu + b sign(l)"
    PHRASE: ClassVar[str] = "an offset of the force"
    FAMILY: ClassVar[str] = "offset"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("slip_ratio",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("slip_bias",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("slip_ratio",)
    OF_SLIP_ALONE: ClassVar[bool] = True

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        return adhesion + self.offset * jnp.sign(slip)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(offset=0.002)]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        return by_its_formula(lambda offset: cls(offset=offset), 0.4, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """Mu + a (1 + .3 V/15) sign(l): friction in the bearings grows with the speed."""
        loss = (1 + 0.3 * runs.speed / 15) * np.sign(runs.slip)
        return Plan(lambda a: planted(a, 1, after=lambda adhesion: adhesion + a * loss), 0.3)
