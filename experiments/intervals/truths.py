"""Adhesion curves of other families than those that are fitted, each with a peak of one place."""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.special import erf

#: Peak that every true curve is scaled to.
MU_MAX, SLIP_OPT = 0.31, 0.06

Form = Callable[[np.ndarray], np.ndarray]


class Truth(NamedTuple):
    """A true curve, and its peak."""

    adhesion: Form
    slip_opt: float
    mu_max: float


def _tanh_and_fall(x: np.ndarray) -> np.ndarray:
    return np.tanh(2.2 * x) * (0.55 + 0.45 * np.exp(-0.35 * x))


def _three_exponentials(x: np.ndarray) -> np.ndarray:
    return 1.0 - 0.6 * np.exp(-2.5 * x) - 0.4 * np.exp(-9.0 * x) - 0.06 * x


def _generalised_hyperbola(x: np.ndarray) -> np.ndarray:
    return x / (1 + x**2.6) ** (1 / 2.6) * (1 - 0.18 * x**1.2 / (1 + 0.3 * x))


def _bump_on_a_plateau(x: np.ndarray) -> np.ndarray:
    return 0.75 * (1 - np.exp(-3.0 * x)) + 0.3 * x * np.exp(1 - x)


def _log_normal(x: np.ndarray) -> np.ndarray:
    return 0.6 * np.exp(-(np.log(np.maximum(x, 1e-9)) ** 2) / 1.6) + 0.4 * np.tanh(2 * x)


def _error_function(x: np.ndarray) -> np.ndarray:
    return erf(1.6 * x) * (1 - 0.16 * np.sqrt(x))


def _stribeck(x: np.ndarray) -> np.ndarray:
    friction = 0.6 + 0.4 * np.exp(-np.sqrt(0.5 * x))
    return friction * (1 - np.exp(-3.0 * x / friction))


def _brush(x: np.ndarray) -> np.ndarray:
    load = np.minimum(x / 1.1, 1.0)
    return (3 * load - 3 * load**2 + load**3) * (1 - 0.25 * x / (2 + x))


def _shifted_magic_formula(x: np.ndarray) -> np.ndarray:
    inner = 1.3 * x - 0.4 * (1.3 * x - np.arctan(1.3 * x))
    return 0.8 * np.sin(1.7 * np.arctan(inner)) + 0.25 * np.tanh(3.0 * x)


_SPLINE = PchipInterpolator(
    [0.0, 0.15, 0.35, 0.6, 0.85, 1.05, 1.4, 2.0, 3.0, 6.0, 50.0],
    [0.0, 0.34, 0.66, 0.88, 0.98, 1.0, 0.975, 0.915, 0.83, 0.72, 0.3],
)

_FORMS: Mapping[str, Form] = {
    "tanh with a fall": _tanh_and_fall,
    "three exponentials": _three_exponentials,
    "generalised hyperbola": _generalised_hyperbola,
    "bump on a plateau": _bump_on_a_plateau,
    "log-normal bump": _log_normal,
    "error function": _error_function,
    "Stribeck friction": _stribeck,
    "brush with a fall": _brush,
    "shifted Magic Formula": _shifted_magic_formula,
    "spline": _SPLINE,
}


def _scaled(form: Form) -> Truth:
    """The form with its peak at SLIP_OPT and MU_MAX."""
    x = np.linspace(0.0, 6.0, 600_001)
    heights = form(x)
    place, height = float(x[heights.argmax()]), float(heights.max())
    return Truth(
        lambda slip: MU_MAX / height * np.asarray(form(slip * place / SLIP_OPT)), SLIP_OPT, MU_MAX
    )


def _burckhardt() -> Truth:
    """One of the curves that are fitted, with about this peak."""
    c1, c2, c3 = 0.35, 60.0, 0.5
    peak = math.log(c1 * c2 / c3) / c2  # where the slope c1 c2 exp(-c2 slip) - c3 is 0

    def adhesion(slip: np.ndarray) -> np.ndarray:
        return c1 * (1 - np.exp(-c2 * slip)) - c3 * slip

    return Truth(adhesion, peak, float(adhesion(np.array([peak]))[0]))


#: The curve that is among those fitted, and those that are not.
KNOWN = _burckhardt()
UNKNOWN: Mapping[str, Truth] = {name: _scaled(form) for name, form in _FORMS.items()}
