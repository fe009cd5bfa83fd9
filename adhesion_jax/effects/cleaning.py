"""Slipping wheels clean the rail: adhesion recovers with the work done in the contact."""

from collections.abc import Mapping, Sequence
from typing import ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Parameter, Scalar
from adhesion_jax.effects.base import Columns, Effect
from adhesion_jax.effects.history import has_history, steps

#: N.
_LOAD = 1e5

_SOURCE = "Voltr and Lata 2015, Veh. Syst. Dyn. 53:605-618"


class Cleaning(Effect):
    """mu (1 + k (1 - exp(-W/W0))), W the integral of |mu| |l| V (F/F0)^q dt since the run began.

    W is in m; with q = 1 it is the slip energy over F0 = 100 kN, with q = 0 that over the load.
    Source: Voltr and Lata 2015, Veh. Syst. Dyn. 53:605-618 (there a dirty and a recovered curve
    are mixed by the same weight).
    """

    k: Scalar
    work: Scalar
    load_power: Scalar

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        "k": Parameter("1", -0.9, 5.0, "relative gain once clean", _SOURCE),
        "work": Parameter("m", 0.001, 1000.0, "slip work that cleans to 63 %", _SOURCE),
        "load_power": Parameter("1", 0.0, 1.0, "power of the load in the work", _SOURCE),
    }
    STRENGTHS: ClassVar[tuple[str, ...]] = ("k",)
    REFERENCES: ClassVar[Mapping[str, str]] = {}
    NEEDS: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps", "time_s")
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
        if not has_history(conditions):
            return adhesion
        slip_velocity = jnp.abs(slip) * conditions["vehicle_speed_mps"]
        load = jnp.asarray(conditions.get("normal_load_N", _LOAD)) / _LOAD
        power = jnp.abs(adhesion) * slip_velocity * load**self.load_power
        work = jnp.cumsum(power * steps(conditions))
        return adhesion * (1 - self.k * jnp.expm1(-work / self.work))

    @classmethod
    def starts(cls, columns: Columns) -> Sequence[Effect]:
        return [cls(k=0.05, work=work, load_power=0.5) for work in (0.1, 0.3, 1.0, 3.0, 10.0)]
