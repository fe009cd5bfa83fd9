"""The slip signal is noisy: its neighbours in time know the slip better than it does itself."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.discovery.effects.base import Columns, Effect
from adhesion_jax.discovery.effects.history import has_history, smoothed

_SOURCE = "Carroll et al. 2006, Measurement Error in Nonlinear Models"


class SlipNoise(Effect):
    """mu(l + k (smooth(l) - l)), smooth a local straight line, Gaussian weights of width w in s.

    k = 1 where the slip itself is smooth over w. Source: Carroll et al. 2006, Measurement Error.
    """

    k: Scalar
    width: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", 0.0, 1.2, "trust in the neighbours", _SOURCE),
        "width": Parameter("s", 0.01, 100.0, "standard deviation of the window", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("time_s",)
    ORDER: ClassVar[int] = 0

    def before(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        if not has_history(conditions):
            return slip
        time = jnp.asarray(conditions["time_s"])
        return slip + self.k * (smoothed(slip, time, self.width)[0] - slip)

    def after(
        self,
        adhesion: Float[Array, "*shape"],
        slip: Float[Array, "*shape"],
        conditions: Conditions,
    ) -> Float[Array, "*shape"]:
        return adhesion

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        step = float(np.median(np.diff(columns["time_s"])))
        return [cls(k=0.5, width=max(step, 0.01) * width) for width in (1.0, 2.0, 4.0, 8.0)]
