"""One block whose truth is of another form than the curve that is assumed."""

from collections.abc import Mapping

from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.curves.polach import PolachFalling
from adhesion_jax.options import Rail
from adhesion_jax.records import Known
from adhesion_jax.scenarios.base import Scenario
from adhesion_jax.scenarios.course import Apart
from adhesion_jax.scenarios.excitation import Sweep
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rail_process import RailProcess, steady

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


def _mismatch(rail: RailProcess, sweep: Sweep, noise: Noise, known: Known) -> Scenario:
    """Polach's law with falling friction at one vehicle speed, known as some other curve.

    The parameters of the assumed curve have no true values; the quantities of the peak have. Their
    bound is that of a method that assumes the true curve with its free parameters unknown, and
    holds for estimates without bias. The assumed curve has fewer parameters, and its estimate may
    come below the bound if its bias happens to be small.
    """
    return Scenario(rail, sweep, noise, Apart(sweep.points), known)


def _polach(rail: str) -> RailProcess:
    names = steady(POLACH_RAILS, rail).names
    return RailProcess(names, POLACH_RAILS[rail], {"vehicle_speed_mps": _VEHICLE_SPEED})


def mismatch(rail: Rail = "dry", sweep: Sweep = Sweep(), noise: Noise = Noise()) -> Scenario:
    """As single, but the rail follows Polach's law while Burckhardt's curve is assumed."""
    return _mismatch(_polach(rail), sweep, noise, _BURCKHARDT)


def mismatch_kiencke(
    rail: Rail = "dry", sweep: Sweep = Sweep(), noise: Noise = Noise()
) -> Scenario:
    """As mismatch, but Kiencke's curve is assumed, its initial slope known to be the true one.

    The slope is C (kA + kS)/2; p2 of up to 10,000 keeps the peak above slip 0.01.
    """
    process = _polach(rail)
    truth = POLACH_RAILS[rail]
    known = Known(
        curve=Kiencke(a0=truth.stiffness * (truth.k_a + truth.k_s) / 2, p1=100.0, p2=500.0),
        lower=[-2.0, 1.0],
        upper=[2000.0, 10_000.0],
    )
    return _mismatch(process, sweep, noise, known)
