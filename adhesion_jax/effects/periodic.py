"""A wave along a column."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect

_SOURCE = "Fourier"


class Periodic(Effect):
    """mu (1 + a sin(2 pi f z) + b cos(2 pi f z)), f in waves a unit of the column z."""

    sine: Scalar
    cosine: Scalar
    frequency: Scalar
    column: str = eqx.field(static=True)

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "sine": Parameter("1", -0.9, 0.9, "amplitude of the sine", _SOURCE),
        "cosine": Parameter("1", -0.9, 0.9, "amplitude of the cosine", _SOURCE),
        "frequency": Parameter("1/column", 0.0, 1e12, "waves per unit of the column", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("sine", "cosine")
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ()
    ORDER: ClassVar[int] = 1
    FORMULA: ClassVar[str] = (
        "mu (1 + a sin(2 pi f z) + b cos(2 pi f z)), f in waves a unit of the column z"
    )
    PHRASE: ClassVar[str] = "a wave along {}"

    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        return slip

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        phase = 2 * jnp.pi * self.frequency * conditions[self.column]
        return adhesion * (1 + self.sine * jnp.sin(phase) + self.cosine * jnp.cos(phase))

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        """One wave over the range; a spectrum of the residual gives better ones."""
        return [
            cls(sine=0.03, cosine=0.03, frequency=1 / float(np.ptp(z)), column=name)
            for name, z in columns.items()
            if np.ptp(z) > 0
        ]
