"""The rails, what becomes of them in a run, and what identifiers are told: curve, start and box."""

import dataclasses
import math
from collections.abc import Mapping
from typing import NamedTuple, TypeVar

from scipy.optimize import brentq

from adhesion_jax.curves import Curve
from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.curves.exponential import Exponential
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.curves.polach import PolachFalling
from adhesion_jax.errors import InputError
from adhesion_jax.records import Known

C = TypeVar("C", bound=Curve)

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


def initial_slope(curve: Curve) -> float:
    """The derivative of the adhesion by the slip at slip 0, in closed form."""
    match curve:
        case Burckhardt(c1=c1, c2=c2, c3=c3):
            return float(c1 * c2 - c3)
        case Kiencke(a0=a0):
            return float(a0)
        case Exponential(a=a, b=b, c=c):
            return float(c * (b - a))
        case PolachFalling(stiffness=stiffness, k_a=k_a, k_s=k_s):
            return float(stiffness * (k_a + k_s) / 2)
    raise TypeError(f"no initial slope is known of {type(curve).__name__}")


def _exponential_of(rail: Burckhardt) -> Exponential:
    """The exponential curve with the initial slope and the peak of Burckhardt's.

    With x = ln(b/a) the slope s at slip 0 and the slip l of the peak give b - a = x/l and
    c = s l/x; its height, which falls with x, is c exp(-x/(exp(x) - 1)) (1 - exp(-x)).
    """
    slip, adhesion = peak_of(rail)
    rise = initial_slope(rail) * slip

    def excess(x: float) -> float:
        return rise / x * math.exp(-x / math.expm1(x)) * -math.expm1(-x) - adhesion

    x = float(brentq(excess, 1e-6, 50.0, xtol=1e-14, rtol=1e-14))
    a = x / slip / math.expm1(x)
    return Exponential(a=a, b=a + x / slip, c=rise / x)


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

#: C = G a b c11/Q of Kalker's linear theory (1967, thesis, Delft): G = 8.1e10 Pa, Hertzian half
#: axes a b = 43 mm^2 (wheel of 0.6 m on a rail head of 0.3 m), c11 = 4.3, Q = 100 kN.
_STIFFNESS = 150.0

#: Friction and reduction factors: Polach 2005 (Wear 258, 992-1000), typical dry and wet rail.
_POLACH_RAILS: Mapping[str, PolachFalling] = {
    "dry": PolachFalling(mu0=0.55, a=0.4, b=0.6, stiffness=_STIFFNESS, k_s=0.4, k_a=1.0),
    "wet": PolachFalling(mu0=0.3, a=0.4, b=0.2, stiffness=_STIFFNESS, k_s=0.1, k_a=0.3),
}


#: m/s. Our choice: fast enough that friction falls by a third to a half within a block, so that
#: both curves of Polach's have their peak in it (dry at slip 0.026, wet at 0.071).
_VEHICLE_SPEED = 20.0


class Form(NamedTuple):
    """A form of curve: the rails that have it, and what their law needs, the same in all runs."""

    rails: Mapping[str, Curve]
    conditions: Mapping[str, float] = {}


FORMS: Mapping[str, Form] = {
    "burckhardt": Form(RAILS),
    "kiencke": Form(KIENCKE_RAILS),
    "exponential": Form({name: _exponential_of(rail) for name, rail in RAILS.items()}),
    "polach": Form(_POLACH_RAILS, {"vehicle_speed_mps": _VEHICLE_SPEED}),
}

#: The same with an unknown initial slope, from a tenth to ten times that of these rails.
KIENCKE_FREE = Known(
    curve=Kiencke(a0=100.0, p1=300.0, p2=50.0, free=("a0", "p1", "p2")),
    lower=[4.0, -2.0, 1.0],
    upper=[400.0, 5000.0, 2000.0],
)

#: What identifiers are told who assume a form.
_TOLD: Mapping[str, Known] = {
    "burckhardt": HE2018,
    "kiencke": QIAN2024,
    "kiencke-free": KIENCKE_FREE,
}

#: The same where the rail has another one whose nearest curve would not lie well inside: the form
#: is judged, not the box. (The box of He et al. 2018 has no c2 above 50, which these rails exceed
#: up to 275; p2 of up to 10,000 keeps the peak above slip 0.01.)
_WIDE_BURCKHARDT = Known(
    curve=Burckhardt(c1=0.5, c2=100.0, c3=0.5),
    lower=[0.1, 20.0, 0.02],
    upper=[1.0, 500.0, 3.0],
)
_TOLD_OF: Mapping[tuple[str, str], Known] = {
    ("burckhardt", "kiencke"): _WIDE_BURCKHARDT,
    ("burckhardt", "polach"): _WIDE_BURCKHARDT,
    ("kiencke", "polach"): Known(
        curve=Kiencke(a0=_INITIAL_SLOPE, p1=100.0, p2=500.0),
        lower=[-2.0, 1.0],
        upper=[2000.0, 10_000.0],
    ),
}


def form_of(truth: str) -> Form:
    """The form of this name; InputError where there is none."""
    if truth not in FORMS:
        raise InputError(f"--truth {truth} is unknown; the forms are {', '.join(FORMS)}.")
    return FORMS[truth]


def told_of(form: str, truth: str, rail: str) -> Known:
    """What identifiers are told who assume a form; Kiencke's known slope is the true one."""
    known = _TOLD_OF.get((form, truth), _TOLD.get(form))
    if known is None:
        raise InputError(f"--told {form} is unknown; the forms are {', '.join(_TOLD)}.")
    curve = known.curve
    if form == truth or not isinstance(curve, Kiencke) or "a0" in curve.free:
        return known
    slope = initial_slope(FORMS[truth].rails[rail])
    return dataclasses.replace(known, curve=dataclasses.replace(curve, a0=slope))


def as_unknown(curve: C, known: Known) -> C:
    """The curve of a rail; if it has the form that is told, what is unknown of it is the same."""
    if type(curve) is not type(known.curve) or curve.free == known.curve.free:
        return curve
    return dataclasses.replace(curve, free=known.curve.free)


def changed(truth: str, rail: str, level: float, stretch: float) -> Curve:
    """The curve of a rail whose peak is `level` times as high, at `stretch` times the slip.

    Kiencke's curve keeps its initial slope, which is elastic, and which identifiers are told; the
    others are drawn to that size as a whole.
    """
    match curve := FORMS[truth].rails[rail]:
        case Kiencke():
            slip, adhesion = peak_of(RAILS[rail])
            return peak_matched(stretch * slip, level * adhesion)
        case Burckhardt(c1=c1, c2=c2, c3=c3):
            return Burckhardt(c1=level * c1, c2=c2 / stretch, c3=level * c3 / stretch)
        case Exponential(a=a, b=b, c=c):
            return Exponential(a=a / stretch, b=b / stretch, c=level * c)
        case PolachFalling(mu0=mu0, b=b, stiffness=stiffness):
            slope = level * stiffness / stretch
            return dataclasses.replace(curve, mu0=level * mu0, b=b / stretch, stiffness=slope)
    raise TypeError(f"it is not said how {type(curve).__name__} changes")
