"""What causes share that modulate adhesion periodically: a wave and its second harmonic."""

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.cause import Scaling

_SOURCE = "first two terms of a Fourier series"

AMPLITUDES: Mapping[str, Parameter] = {
    "sine": Parameter("1", -0.9, 0.9, "amplitude of the sine", _SOURCE),
    "cosine": Parameter("1", -0.9, 0.9, "amplitude of the cosine", _SOURCE),
    "sine2": Parameter("1", -0.9, 0.9, "amplitude of the second sine", _SOURCE),
    "cosine2": Parameter("1", -0.9, 0.9, "amplitude of the second cosine", _SOURCE),
}


class Wave(Scaling):
    """mu (1 + a sin(p) + b cos(p) + a2 sin(2 p) + b2 cos(2 p)), p the phase.

    A wave may have any length: a spectrum of the residual along the column AXIS gives the starts.
    """

    sine: Scalar
    cosine: Scalar
    sine2: Scalar
    cosine2: Scalar

    STRENGTHS: ClassVar[tuple[str, ...]] = ("sine", "cosine")
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    AXIS: eqx.AbstractClassVar[str]

    @abstractmethod
    def phase(self, conditions: Conditions) -> Float[Array, "..."]:
        """Phase of the wave, rad."""

    @classmethod
    @abstractmethod
    def of_frequency(cls, frequency: float) -> "Wave":
        """A small wave; `frequency` in periods a unit of AXIS."""

    def factor(self, slip: Float[Array, "*shape"], conditions: Conditions) -> Float[Array, "..."]:
        phase = self.phase(conditions)
        first = self.sine * jnp.sin(phase) + self.cosine * jnp.cos(phase)
        second = self.sine2 * jnp.sin(2 * phase) + self.cosine2 * jnp.cos(2 * phase)
        return 1 + first + second
