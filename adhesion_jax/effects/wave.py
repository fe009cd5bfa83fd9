"""What causes share that modulate adhesion periodically: a wave and its second harmonic."""

from abc import abstractmethod

import jax.numpy as jnp

from adhesion_jax.effects.api import Conditions, Multiplier, Scalar, Values

AMPLITUDES = {
    name: ("1", -0.9, 0.9, f"amplitude of the {words}")
    for name, words in (
        *(("sine", "sine"), ("cosine", "cosine")),
        *(("sine2", "second sine"), ("cosine2", "second cosine")),
    )
}

#: A small wave without a second harmonic.
SMALL = {"sine": 0.03, "cosine": 0.03, "sine2": 0.0, "cosine2": 0.0}


class Wave(Multiplier):
    """mu (1 + a sin(p) + b cos(p) + a2 sin(2 p) + b2 cos(2 p)), p the phase.

    A wave may have any length: a spectrum of the residual along the column that it needs gives the
    starts.
    """

    sine: Scalar
    cosine: Scalar
    sine2: Scalar
    cosine2: Scalar

    @abstractmethod
    def phase(self, conditions: Conditions) -> Values:
        """Phase of the wave, rad."""

    @classmethod
    @abstractmethod
    def of_frequency(cls, frequency: float) -> "Wave":
        """A small wave; `frequency` in periods a unit of the column that it needs."""

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        phase = self.phase(conditions)
        first = self.sine * jnp.sin(phase) + self.cosine * jnp.cos(phase)
        second = self.sine2 * jnp.sin(2 * phase) + self.cosine2 * jnp.cos(2 * phase)
        return 1 + first + second
