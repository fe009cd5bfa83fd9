from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.planting import CleanRuns, Plan, by_factor, by_its_formula
from adhesion_jax.effects.wave import AMPLITUDES, Wave

_SOURCE = "Grassie 2009, Proc. IMechE F 223:581-596"


class RailJoint(Wave):
    """Source: Grassie 2009, Proc. IMechE F 223:581-596."""

    length: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        **AMPLITUDES,
        "length": Parameter("m", 0.5, 200.0, "distance from joint to joint", _SOURCE),
    }
    NEEDS: ClassVar[tuple[str, ...]] = ("position_m",)
    AXIS: ClassVar[str] = "position_m"
    SENTENCE: ClassVar[str] = "Joints and corrugation modulate the adhesion along the track."
    FORMULA: ClassVar[str] = (
        "mu (1 + wave(2 pi x/L)), a wave and its second harmonic, x in m, L the length of a rail"
    )
    PHRASE: ClassVar[str] = "rail joints or corrugation"
    FAMILY: ClassVar[str] = "place"
    RESTS_ON: ClassVar[tuple[str, ...]] = ("position_m",)
    SAME_AS: ClassVar[tuple[str, ...]] = ("periodic:position_m",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("position_m",)

    def phase(self, conditions: Conditions) -> Float[Array, "..."]:
        return jnp.asarray(2 * jnp.pi * conditions["position_m"] / self.length)

    @classmethod
    def of_frequency(cls, frequency: float) -> Wave:
        return cls(0.01, 0.01, 0.0, 0.0, length=1 / frequency)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [
            cls(sine=0.03, cosine=0.03, sine2=0.0, cosine2=0.0, length=length)
            for length in (10.0, 12.5, 15.0, 18.0, 20.0, 25.0, 30.0, 36.0)
        ]

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        length, sine, cosine = generator.uniform(9.0, 33.0), np.sin(phase), np.cos(phase)
        return by_its_formula(lambda a: cls(a * sine, a * cosine, 0.0, 0.0, length), 0.9, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """Narrow dips at the joints: 1 - a exp(-(u/.15)^2), u the rail lengths from the joint."""
        length = generator.uniform(9.0, 33.0)
        places = runs.columns["position_m"] / length + generator.uniform(0, 1)
        dip = np.exp(-((np.abs(places % 1 - 0.5) / 0.15) ** 2))
        return by_factor(lambda a: 1 - a * dip, 0.95)
