from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula
from adhesion_jax.effects.wave import AMPLITUDES, Wave

_SOURCE = "Iwnicki 2006, Handbook of Railway Vehicle Dynamics"


class WheelOrder(Wave):
    """Without an angle theta is the rolled distance over a nominal radius of .46 m.

    Then n is no whole number. Source: Iwnicki 2006, chapter 4.
    """

    order: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        **AMPLITUDES,
        "order": Parameter("1", 0.2, 40.0, "waves per turn", _SOURCE),
    }
    NEEDS: ClassVar[tuple[str, ...]] = ("wheel_angle_rad",)
    AXIS: ClassVar[str] = "wheel_angle_rad"
    SENTENCE: ClassVar[str] = "A wheel out of round modulates the adhesion with its angle."
    FORMULA: ClassVar[str] = (
        "mu (1 + wave(n theta)), a wave and its second harmonic, theta the wheel's angle in rad"
    )
    PHRASE: ClassVar[str] = "a wave of the wheel's turns"
    FAMILY: ClassVar[str] = "wheel_order"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("wheel_angle_rad",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("periodic:wheel_angle_rad",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("wheel_angle_rad",)

    def phase(self, conditions: Conditions) -> Float[Array, "..."]:
        return jnp.asarray(self.order * conditions["wheel_angle_rad"])

    @classmethod
    def of_frequency(cls, frequency: float) -> Wave:
        return cls(0.01, 0.01, 0.0, 0.0, order=2 * np.pi * frequency)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(0.03, 0.03, 0.0, 0.0, order=float(n)) for n in (1, 2, 3, 4, 5, 6)]

    @classmethod
    def extra_columns(
        cls, columns: Mapping[str, np.ndarray], generator: np.random.Generator
    ) -> Mapping[str, np.ndarray]:
        return {"wheel_angle_rad": columns["wheel_angle_rad"]}

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        order, sine, cosine = float(generator.integers(1, 4)), np.sin(phase), np.cos(phase)
        return by_its_formula(lambda a: cls(a * sine, a * cosine, 0.0, 0.0, order), 0.9, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 + a (sin(n theta + b) + .3 sin(2 (n theta + b) + 1))."""
        turn = runs.columns["wheel_angle_rad"] * int(generator.integers(1, 4))
        turn = turn + generator.uniform(0, 2 * np.pi)
        return by_factor(lambda a: 1 + a * (np.sin(turn) + 0.3 * np.sin(2 * turn + 1)), 0.7)
