"""A wave along a column."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Effect, Form, Scalar, Signal


class Periodic(Effect):
    """mu (1 + a sin(2 pi f z) + b cos(2 pi f z)), f in waves a unit of the column z."""

    sine: Scalar
    cosine: Scalar
    frequency: Scalar
    column: str = eqx.field(static=True)

    FACTS = Form(
        source="Fourier",
        described={
            "sine": ("1", -0.9, 0.9, "amplitude of the sine"),
            "cosine": ("1", -0.9, 0.9, "amplitude of the cosine"),
            "frequency": ("1/column", 0.0, 1e12, "waves per unit of the column"),
        },
        strengths=("sine", "cosine"),
        formula="mu (1 + a sin(2 pi f z) + b cos(2 pi f z)), f in waves a unit of the column z",
        phrase="a wave along {}",
    )

    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        phase = 2 * jnp.pi * self.frequency * conditions[self.column]
        return adhesion * (1 + self.sine * jnp.sin(phase) + self.cosine * jnp.cos(phase))

    @classmethod
    def starts(cls, columns: Columns) -> list[Effect]:
        """One wave over the range; a spectrum of the residual gives better ones."""
        return [
            cls(sine=0.03, cosine=0.03, frequency=1 / float(np.ptp(z)), column=name)
            for name, z in columns.items()
            if np.ptp(z) > 0
        ]
