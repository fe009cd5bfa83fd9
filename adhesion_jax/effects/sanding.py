"""Sand raises adhesion; it takes time to arrive and stays for a while."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.history import has_history, recurrence, steps

_SOURCE = "Arias-Cuevas et al. 2010, Wear 268:543-551"


class Sanding(Effect):
    """mu (1 + k s), s following the sanding flag: build-up over t1, decay over t2, in s.

    Source: Arias-Cuevas et al. 2010, Wear 268, 543-551 (build-up about 1 s, decay 5 to 12 s).
    """

    k: Scalar
    build_up: Scalar
    decay: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -0.9, 3.0, "relative gain under sand", _SOURCE),
        "build_up": Parameter("s", 0.05, 10.0, "time constant of arrival", _SOURCE),
        "decay": Parameter("s", 0.05, 60.0, "time constant of loss", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("sanding", "time_s")
    ORDER: ClassVar[int] = 1

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
        flag = conditions["sanding"]
        if not has_history(conditions):
            return adhesion * (1 + self.k * flag)
        on = jnp.exp(-steps(conditions) / self.build_up)
        off = jnp.exp(-steps(conditions) / self.decay)
        kept = flag * on + (1 - flag) * off
        sand = recurrence(kept, (1 - kept) * flag)
        return adhesion * (1 + self.k * sand)

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [
            cls(k=0.05, build_up=up, decay=down) for up in (0.3, 1.0) for down in (0.3, 3.0, 8.0)
        ]
