"""Burckhardt's curve, in three parameters and with speed and load."""

from collections.abc import Mapping
from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from adhesion_jax.curves.base import SLIP_LIMIT, Conditions, Curve, Parameter, Peak, Scalar
from adhesion_jax.curves.peak import find_peak

_SOURCE = "Burckhardt 1993; He et al. 2018, Eq. 5"
_FULL_SOURCE = "Burckhardt 1993; He et al. 2018, Eq. 4"

_PARAMETERS = {
    "c1": Parameter("1", 0.001, 2.0, "level of the plateau", _SOURCE),
    "c2": Parameter("1", 0.5, 5000.0, "steepness of the rise", _SOURCE),
    "c3": Parameter("1", 0.0, 5.0, "fall behind the peak", _SOURCE),
}


class Burckhardt(Curve):
    """mu(l) = c1 (1 - exp(-c2 l)) - c3 l, l the slip ratio, odd in l.

    Peak at l_m = ln(c1 c2 / c3) / c2, mu_m = c1 - (c3/c2)(1 + ln(c1 c2 / c3)); there is none
    where the curve falls from the start (c1 c2 <= c3) or rises beyond the largest slip.
    Source: He et al. 2018, Eq. 5 and 6.
    """

    c1: Scalar
    c2: Scalar
    c3: Scalar
    free: tuple[str, ...] = eqx.field(default=("c1", "c2", "c3"), static=True)

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = _PARAMETERS
    NEEDS: ClassVar[tuple[str, ...]] = ()

    def __call__(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        rise = 1 - jnp.exp(-self.c2 * jnp.abs(slip))
        return self.c1 * jnp.sign(slip) * rise - self.c3 * slip

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        # Kept from zero, so that value and derivative stay finite; the clip below then answers.
        rise, fall = jnp.maximum(self.c1 * self.c2, 1e-300), jnp.maximum(self.c3, 1e-300)
        stationary = (jnp.log(rise) - jnp.log(fall)) / self.c2
        slip = jnp.clip(stationary, 0.0, slip_limit)
        found = (stationary > 0) & (stationary <= slip_limit)
        return Peak(slip, self(slip, conditions), found)


class BurckhardtFull(Curve):
    """mu(l, V, Fz) = (c1 (1 - exp(-c2 l)) - c3 l) exp(-c4 l V) (1 - c5 Fz^2), odd in l.

    V is the vehicle speed in m/s, Fz the normal load in N. The peak is found numerically.
    Source: He et al. 2018, Eq. 4.
    """

    c1: Scalar
    c2: Scalar
    c3: Scalar
    c4: Scalar
    c5: Scalar
    free: tuple[str, ...] = eqx.field(default=("c1", "c2", "c3", "c4", "c5"), static=True)

    PARAMETERS: ClassVar[Mapping[str, Parameter]] = {
        **_PARAMETERS,
        "c4": Parameter("s/m", 0.0, 1.0, "fall with slip velocity", _FULL_SOURCE),
        "c5": Parameter("1/N^2", 0.0, 1e-8, "fall with normal load", _FULL_SOURCE),
    }
    NEEDS: ClassVar[tuple[str, ...]] = ("vehicle_speed_mps", "normal_load_N")

    def __call__(
        self, slip: Float[Array, "*shape"], conditions: Conditions
    ) -> Float[Array, "*shape"]:
        speed, load = conditions["vehicle_speed_mps"], conditions["normal_load_N"]
        curve = Burckhardt(c1=self.c1, c2=self.c2, c3=self.c3)(slip, conditions)
        return curve * jnp.exp(-self.c4 * jnp.abs(slip) * speed) * (1 - self.c5 * load**2)

    def peak(self, conditions: Conditions, slip_limit: Scalar = SLIP_LIMIT) -> Peak:
        return find_peak(lambda slip: self(slip, conditions), slip_limit)
