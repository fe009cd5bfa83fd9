"""The NIST StRD problems of nonlinear regression: models here, data from the refnx package.

National Institute of Standards and Technology, Statistical Reference Datasets, Nonlinear
Regression (https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml). Each problem has two starts,
parameters certified to 11 digits and the residual sum of squares at them.
"""

import re
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import Array


class Problem(NamedTuple):
    name: str
    starts: np.ndarray  # [2, p]
    certified: np.ndarray  # [p]
    sum_of_squares: float
    x: np.ndarray  # [points], Nelson: [2, points]
    y: np.ndarray  # [points]

    def residual(self, b: Array) -> Array:
        return MODELS[self.name](jnp.asarray(self.x), b) - jnp.asarray(self.y)


def _saturating_exponential(x, b):
    return b[0] * (1 - jnp.exp(-b[1] * x))


def _chwirut(x, b):
    return jnp.exp(-b[0] * x) / (b[1] + b[2] * x)


def _lanczos(x, b):
    return b[0] * jnp.exp(-b[1] * x) + b[2] * jnp.exp(-b[3] * x) + b[4] * jnp.exp(-b[5] * x)


def _two_gaussians(x, b):
    first = b[2] * jnp.exp(-((x - b[3]) ** 2) / b[4] ** 2)
    second = b[5] * jnp.exp(-((x - b[6]) ** 2) / b[7] ** 2)
    return b[0] * jnp.exp(-b[1] * x) + first + second


def _rational(degree):
    def model(x, b):
        above = sum(b[k] * x**k for k in range(degree + 1))
        below = 1 + sum(b[degree + k] * x**k for k in range(1, degree + 1))
        return above / below

    return model


def _nelson(x, b):
    return b[0] - b[1] * x[0] * jnp.exp(-b[2] * x[1])


def _enso(x, b):
    def wave(period, cosine, sine):
        angle = 2 * jnp.pi * x / period
        return cosine * jnp.cos(angle) + sine * jnp.sin(angle)

    return b[0] + wave(12, b[1], b[2]) + wave(b[3], b[4], b[5]) + wave(b[6], b[7], b[8])


def _eckerle4(x, b):
    return b[0] / b[1] * jnp.exp(-0.5 * ((x - b[2]) / b[1]) ** 2)


MODELS: Mapping[str, Callable[[Array, Array], Array]] = {
    "Bennett5": lambda x, b: b[0] * (b[1] + x) ** (-1 / b[2]),
    "BoxBOD": _saturating_exponential,
    "Chwirut1": _chwirut,
    "Chwirut2": _chwirut,
    "DanWood": lambda x, b: b[0] * x ** b[1],
    "ENSO": _enso,
    "Eckerle4": _eckerle4,
    "Gauss1": _two_gaussians,
    "Gauss2": _two_gaussians,
    "Gauss3": _two_gaussians,
    "Hahn1": _rational(3),
    "Kirby2": _rational(2),
    "Lanczos1": _lanczos,
    "Lanczos2": _lanczos,
    "Lanczos3": _lanczos,
    "MGH09": lambda x, b: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "MGH10": lambda x, b: b[0] * jnp.exp(b[1] / (x + b[2])),
    "MGH17": lambda x, b: b[0] + b[1] * jnp.exp(-x * b[3]) + b[2] * jnp.exp(-x * b[4]),
    "Misra1a": _saturating_exponential,
    "Misra1b": lambda x, b: b[0] * (1 - (1 + b[1] * x / 2) ** -2),
    "Misra1c": lambda x, b: b[0] * (1 - (1 + 2 * b[1] * x) ** -0.5),
    "Misra1d": lambda x, b: b[0] * b[1] * x / (1 + b[1] * x),
    "Nelson": _nelson,
    "Rat42": lambda x, b: b[0] / (1 + jnp.exp(b[1] - b[2] * x)),
    "Rat43": lambda x, b: b[0] / (1 + jnp.exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Roszman1": lambda x, b: b[0] - b[1] * x - jnp.arctan(b[2] / (x - b[3])) / jnp.pi,
    "Thurber": _rational(3),
}


def load(name: str) -> Problem:
    """One problem, from the file that NIST publishes."""
    # Found without importing refnx, which would import what it plots and samples with.
    package = find_spec("refnx")
    assert package is not None
    assert package.origin is not None
    folder = Path(package.origin).parent / "analysis" / "tests" / "NIST_STRD"
    text = (folder / f"{name}.dat").read_text()
    lines = text.splitlines()
    parameters = [
        [float(number) for number in line.split("=")[1].split()[:3]]
        for line in lines
        if re.match(r"\s*b\d+ =", line)
    ]
    table = np.array(parameters)
    sum_of_squares = re.search(r"Residual Sum of Squares:\s+(\S+)", text)
    first_last = re.search(r"Data\s+\(lines (\d+) to (\d+)\)", text)
    assert sum_of_squares is not None
    assert first_last is not None
    first, last = map(int, first_last.groups())
    data = np.array([line.split() for line in lines[first - 1 : last]], dtype=float).T
    y, x = data[0], data[1:]
    return Problem(
        name,
        table[:, :2].T,
        table[:, 2],
        float(sum_of_squares[1]),
        x if name == "Nelson" else x[0],
        np.log(y) if name == "Nelson" else y,
    )
