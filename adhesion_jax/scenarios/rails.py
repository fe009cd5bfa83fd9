"""The rails, and what the identifiers are told about them: curve, start and box."""

import math
from collections.abc import Mapping

from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.records import Known

#: He et al. 2018, Table 1.
RAILS: Mapping[str, Burckhardt] = {
    "dry": Burckhardt(c1=0.8287, c2=45.45, c3=0.4),
    "common": Burckhardt(c1=0.32, c2=25.0, c3=0.1),
    "wet": Burckhardt(c1=0.165, c2=15.0, c3=0.1),
}

#: Start of Experiment 2 and search range of Table 2.
HE2018 = Known(
    curve=Burckhardt(c1=0.5, c2=30.0, c3=0.08),
    lower=[0.1, 10.0, 0.05],
    upper=[1.0, 50.0, 0.5],
)


_INITIAL_SLOPE = 40.0


def peak_matched(slip: float, adhesion: float) -> Kiencke:
    """Kiencke's curve with that peak: p2 = 1/l_m^2 and p1 = a0/mu_m - 2/l_m."""
    return Kiencke(a0=_INITIAL_SLOPE, p1=_INITIAL_SLOPE / adhesion - 2 / slip, p2=slip**-2)


def peak_of(rail: Burckhardt) -> tuple[float, float]:
    """Slip and adhesion of the peak, in closed form and without jax, which would compile for it."""
    c1, c2, c3 = float(rail.c1), float(rail.c2), float(rail.c3)
    logarithm = math.log(c1 * c2 / c3)
    return logarithm / c2, c1 - c3 / c2 * (1 + logarithm)


#: The same rails by Kiencke's curve: Qian et al. 2024 draws its curves and prints no parameters.
KIENCKE_RAILS: Mapping[str, Kiencke] = {
    name: peak_matched(*peak_of(rail)) for name, rail in RAILS.items()
}

#: a0 known; p2 >= 1 and p1 >= -2 keep the peak below slip 1 and the curve above zero, the upper
#: bounds are twice those of a rail with a third of the wet one's adhesion.
QIAN2024 = Known(
    curve=Kiencke(a0=_INITIAL_SLOPE, p1=100.0, p2=50.0),
    lower=[-2.0, 1.0],
    upper=[2000.0, 2000.0],
)
