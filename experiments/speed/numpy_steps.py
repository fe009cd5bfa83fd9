"""Steps of the identifiers as NumPy computes them: in place, for all the runs at once.

Slip is positive and every sample is taken, so that nothing is spent on signs and missing samples.
The arrays are each [runs] and stay in the cache: an array for every intermediate result takes 1.3
times as long for recursive least squares, and three times for a quadratic program with all the
edges of the box for every run. Stacked arrays, one call for several, would not fit into the cache.
"""

from collections.abc import Sequence

import numpy as np

Pair = tuple[np.ndarray, np.ndarray]

#: Where the recursions start, and the weight of that start in the quadratic programs.
_START, _RIDGE = (100.0, 50.0), 1e-10

#: The initial slope of Kiencke's curve.
_A0 = 40.0


def zeros(count: int, runs: int) -> list[np.ndarray]:
    """Arrays of their own: to take rows of one would cost time at every step."""
    return [np.zeros(runs) for _ in range(count)]


def start(runs: int) -> Pair:
    return np.full(runs, _START[0]), np.full(runs, _START[1])


def regressors(
    size: np.ndarray, measured: np.ndarray, u1: np.ndarray, u2: np.ndarray, z: np.ndarray
) -> None:
    np.multiply(size, measured, out=u1)
    np.multiply(size, u1, out=u2)
    np.multiply(size, _A0, out=z)
    z -= measured


def denominate(size: np.ndarray, x: Pair, out: np.ndarray) -> None:
    """The denominator of Kiencke's curve."""
    np.multiply(x[1], size, out=out)
    out += x[0]
    out *= size
    out += 1.0


def misfit(
    size: np.ndarray, measured: np.ndarray, x: Pair, out: np.ndarray, work: np.ndarray
) -> None:
    """The adhesion at this slip and x less the measured one."""
    denominate(size, x, work)
    np.multiply(size, _A0, out=out)
    out /= work
    out -= measured


def forgetting(
    size: np.ndarray,
    measured: np.ndarray,
    x: Pair,
    settings: tuple[np.ndarray, float, float],
    eta: np.ndarray,
    work: np.ndarray,
) -> None:
    """The forgetting factor max(least, most - gain |error|).

    `least` is an array, with which the maximum takes a third of the time.
    """
    least, most, gain = settings
    misfit(size, measured, x, eta, work)
    np.abs(eta, out=eta)
    eta *= -gain
    eta += most
    np.maximum(eta, least, out=eta)


def discount(
    sums: Sequence[np.ndarray],
    factor: float | np.ndarray,
    products: Sequence[Pair],
    work: np.ndarray,
) -> None:
    """The sums times the factor, each plus a product."""
    for total, (one, other) in zip(sums, products, strict=True):
        total *= factor
        total += np.multiply(one, other, out=work)


def subtract(error: np.ndarray, x: Pair, u: Pair, work: np.ndarray) -> None:
    """Leave of the target what the regression does not give at this x."""
    for value, regressor in zip(x, u, strict=True):
        error -= np.multiply(value, regressor, out=work)


def solve_in_box(
    sums: Sequence[np.ndarray], x: Pair, box: Pair, spare: Sequence[np.ndarray], work: np.ndarray
) -> None:
    """Put the best x in the box for H and f into x."""
    (h11, h12, h22, f1, f2), (x1, x2), (lower, upper) = sums, x, box
    y1, y2, a11, a22, determinant = spare
    pull = np.add(h11, h22, out=work)
    pull *= _RIDGE
    np.add(h11, pull, out=a11)
    np.add(h22, pull, out=a22)
    np.multiply(pull, _START[0], out=y1)
    y1 += f1
    np.multiply(pull, _START[1], out=y2)
    y2 += f2
    np.multiply(a11, a22, out=determinant)
    determinant -= np.multiply(h12, h12, out=work)
    np.multiply(y1, a22, out=x1)
    x1 -= np.multiply(y2, h12, out=work)
    np.multiply(y2, a11, out=x2)
    x2 -= np.multiply(y1, h12, out=work)
    inside = determinant > 0
    with np.errstate(divide="ignore", invalid="ignore"):
        x1 /= determinant
        x2 /= determinant
    for value, least, most in zip(x, lower, upper, strict=True):
        inside &= value >= least
        inside &= value <= most
    if not inside.all():
        outside = np.flatnonzero(~inside)
        program = (y1[outside], y2[outside], a11[outside], a22[outside], h12[outside])
        x1[outside], x2[outside] = _on_edge(program, box)


def _on_edge(program: tuple[np.ndarray, ...], box: Pair) -> Pair:
    y1, y2, a11, a22, a12 = program
    (low1, low2), (high1, high2) = box
    ones = np.ones_like(y1)
    edges = [(np.clip((y1 - e * a12) / a11, low1, high1), e * ones) for e in (low2, high2)]
    edges += [(e * ones, np.clip((y2 - e * a12) / a22, low2, high2)) for e in (low1, high1)]
    x1, x2 = np.array(edges).swapaxes(0, 1)
    values = x1 * (x1 * a11 + 2 * x2 * a12 - 2 * y1) + x2 * (x2 * a22 - 2 * y2)
    best = np.argmin(values, axis=0), np.arange(y1.size)
    return x1[best], x2[best]


def objective(slip: np.ndarray, adhesion: np.ndarray, x: Pair) -> np.ndarray:
    """The sum of squared errors of this estimate over the record."""
    total, left, work = zeros(3, slip.shape[1])
    for size, measured in zip(slip, adhesion, strict=True):
        misfit(size, measured, x, left, work)
        left *= left
        total += left
    return total
