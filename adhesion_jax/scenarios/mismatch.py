"""One block whose truth is of another form than the curve that is assumed."""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import Conditions, Curve, free_values, with_free_values
from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.curves.polach import PolachFalling
from adhesion_jax.errors import InputError
from adhesion_jax.metrics.information import adhesion_and_information, inverse_information
from adhesion_jax.options import Outliers, Points, Rail, Sigma, SlipMax
from adhesion_jax.records import SHARED_SLIP, Known, Record
from adhesion_jax.scenarios.base import Group, Scenario
from adhesion_jax.scenarios.noise import draw_noise

#: C = G a b c11/Q of Kalker's linear theory (1967, thesis, Delft): G = 8.1e10 Pa, Hertzian half
#: axes a b = 43 mm^2 (wheel of 0.6 m on a rail head of 0.3 m), c11 = 4.3, Q = 100 kN.
_STIFFNESS = 150.0

#: Friction and reduction factors: Polach 2005 (Wear 258, 992-1000), typical dry and wet rail.
POLACH_RAILS: Mapping[str, PolachFalling] = {
    "dry": PolachFalling(mu0=0.55, a=0.4, b=0.6, stiffness=_STIFFNESS, k_s=0.4, k_a=1.0),
    "wet": PolachFalling(mu0=0.3, a=0.4, b=0.2, stiffness=_STIFFNESS, k_s=0.1, k_a=0.3),
}

#: Vehicle speed, m/s. Our choice: fast enough that friction falls by a third to a half within the
#: block, so that both curves have their peak in it (dry at slip 0.026, wet at 0.071).
_VEHICLE_SPEED = 20.0

#: Wide enough that the nearest curve to either rail lies well inside: the form is judged, not
#: the box. (The box of He et al. 2018 has no c2 above 50, these rails rise like 115 and 275.)
_BURCKHARDT = Known(
    curve=Burckhardt(c1=0.5, c2=100.0, c3=0.5),
    lower=[0.1, 20.0, 0.02],
    upper=[1.0, 500.0, 3.0],
)


class Mismatch(Scenario):
    """Polach's law with falling friction at one vehicle speed, known as some other curve.

    The parameters of the assumed curve have no true values; the quantities of the peak have.
    """

    rails: tuple[str, ...] = eqx.field(static=True)
    sigma: float = eqx.field(static=True)
    outliers: float = eqx.field(static=True)
    slip: Float[Array, " points"]
    truth: tuple[PolachFalling, ...]
    known: Known
    run_axes: Any = eqx.field(default=SHARED_SLIP, static=True)

    @property
    def conditions(self) -> Conditions:
        """The conditions of the true curve; the curves that are assumed here need none."""
        return {"vehicle_speed_mps": _VEHICLE_SPEED}

    def draw(self, key: PRNGKeyArray) -> Record:
        clean = self.truth[0](self.slip, self.conditions)[None]
        noise = draw_noise(key, clean.shape, self.sigma, self.outliers)
        every = jnp.ones(clean.shape, dtype=bool)
        return Record(self.slip[None], clean + noise, every, every, {})

    def quantities(self) -> Mapping[str, np.ndarray]:
        peak = np.asarray(_peak(self.truth[0], self.conditions))
        return {"mu_max": peak[:1], "slip_opt": peak[1:]}

    def bound(self, record: Record) -> Float[Array, "blocks values"]:
        """The bound of a method that assumes the true curve with its free parameters unknown.

        It holds for estimates without bias. The assumed curve has fewer parameters, and its
        estimate may come below the bound if its bias happens to be small.
        """
        curve, every = self.truth[0], jnp.ones(self.slip.shape, dtype=bool)
        _, information = adhesion_and_information(curve, self.slip, every, self.conditions)
        gradient = jax.jacfwd(
            lambda values: _peak(with_free_values(curve, values), self.conditions)
        )(free_values(curve))
        covariance = gradient @ inverse_information(information) @ gradient.T
        return self.sigma * jnp.sqrt(jnp.diagonal(covariance))[None]

    def support(self) -> np.ndarray:
        return np.array([self.slip.size])

    def tables(self) -> Mapping[str, Sequence[Group]]:
        return {"summary": [Group(self.rails[0], (0,))]}


def _peak(curve: Curve, conditions: Conditions) -> Float[Array, "2"]:
    peak = curve.peak(conditions)
    return jnp.stack([peak.adhesion, peak.slip])


def _mismatch(
    rail: str, known: Known, sigma: float, points: int, slip_max: float, outliers: float
) -> Mismatch:
    return Mismatch(
        rails=(rail,),
        sigma=sigma,
        outliers=outliers,
        slip=jnp.linspace(0.0, slip_max, points),
        truth=(POLACH_RAILS[rail],),
        known=known,
    )


def _check_rail(name: str, rail: str) -> None:
    """InputError where Polach's law has no parameters for a rail."""
    if rail not in POLACH_RAILS:
        raise InputError(
            f"--rail {rail} does not go with --scenario {name}; "
            f"the rails of Polach's law are {', '.join(POLACH_RAILS)}."
        )


def mismatch(
    rail: Rail = "dry",
    sigma: Sigma = 0.01,
    points: Points = 500,
    slip_max: SlipMax = 0.2,
    outliers: Outliers = 0.0,
) -> Mismatch:
    """As single, but the rail follows Polach's law while Burckhardt's curve is assumed."""
    _check_rail("mismatch", rail)
    return _mismatch(rail, _BURCKHARDT, sigma, points, slip_max, outliers)


def mismatch_kiencke(
    rail: Rail = "dry",
    sigma: Sigma = 0.01,
    points: Points = 500,
    slip_max: SlipMax = 0.2,
    outliers: Outliers = 0.0,
) -> Mismatch:
    """As mismatch, but Kiencke's curve is assumed, its initial slope known to be the true one.

    The slope is C (kA + kS)/2; p2 of up to 10,000 keeps the peak above slip 0.01.
    """
    _check_rail("mismatch-kiencke", rail)
    truth = POLACH_RAILS[rail]
    known = Known(
        curve=Kiencke(a0=truth.stiffness * (truth.k_a + truth.k_s) / 2, p1=100.0, p2=500.0),
        lower=[-2.0, 1.0],
        upper=[2000.0, 10_000.0],
    )
    return _mismatch(rail, known, sigma, points, slip_max, outliers)
