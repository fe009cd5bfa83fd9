"""Identifiers as NumPy computes them: in place, one step for all the runs, arrays [samples, runs].

Slip is positive and every sample is taken, so that nothing is spent on signs and missing samples.
The arrays of a step are each [runs] and stay in the cache: an array for every intermediate result
takes 1.3 times as long for recursive least squares, and three times for a quadratic program with
all the edges of the box for every run. Stacked arrays, one call for several, would not fit into the
cache. What few runs need is computed for these alone: the edges of the box, and the second and
third element of a statistic.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

_Found = tuple[np.ndarray, ...]
Pair = tuple[np.ndarray, np.ndarray]

#: The critical interval of the statistic.
_LOW, _HIGH = -0.8, -0.7


def rls_kiencke(slip: np.ndarray, adhesion: np.ndarray) -> _Found:
    """The estimate, P and G, element by element, and the sum of squared errors; each [runs]."""
    return _recursive_least_squares(slip, adhesion, lambda *_: 0.99)


def rls_kiencke_variable(slip: np.ndarray, adhesion: np.ndarray) -> _Found:
    """The same with a forgetting factor that follows the error."""
    least, (eta, work) = np.full(slip.shape[1], 0.9), zeros(2, slip.shape[1])

    def factor(size: np.ndarray, measured: np.ndarray, x: Pair) -> np.ndarray:
        forgetting(size, measured, x, (least, 1.0, 2.0), eta, work)
        return eta

    return _recursive_least_squares(slip, adhesion, factor)


def _recursive_least_squares(
    slip: np.ndarray, adhesion: np.ndarray, factor: Callable[..., Any]
) -> _Found:
    """`factor` gives the forgetting factor of a sample, from its slip, its adhesion and x."""
    runs = slip.shape[1]
    x1, x2 = start(runs)
    p11, p12, p22 = np.full(runs, 1e10), np.zeros(runs), np.full(runs, 1e10)
    g = zeros(3, runs)
    u1, u2, error, pu1, pu2, share, work = zeros(7, runs)
    for size, measured in zip(slip, adhesion, strict=True):
        regressors(size, measured, u1, u2, error)
        eta = factor(size, measured, (x1, x2))
        np.multiply(p11, u1, out=pu1)
        pu1 += np.multiply(p12, u2, out=work)
        np.multiply(p12, u1, out=pu2)
        pu2 += np.multiply(p22, u2, out=work)
        np.multiply(u1, pu1, out=share)
        share += np.multiply(u2, pu2, out=work)
        share += eta
        np.divide(1.0, share, out=share)
        subtract(error, (x1, x2), (u1, u2), work)
        error *= share
        x1 += np.multiply(pu1, error, out=work)
        x2 += np.multiply(pu2, error, out=work)
        error *= eta
        u1 *= error
        u2 *= error
        gain1 = np.multiply(pu1, share, out=error)
        gain2 = np.multiply(pu2, share, out=share)
        p11 -= np.multiply(pu1, gain1, out=work)
        p12 -= np.multiply(pu1, gain2, out=work)
        p22 -= np.multiply(pu2, gain2, out=work)
        for element in (p11, p12, p22):
            element /= eta
        discount(g, eta * eta, ((u1, u1), (u1, u2), (u2, u2)), work)
    return x1, x2, p11, p12, p22, *g, objective(slip, adhesion, (x1, x2))


def qp_qian2024_1(slip: np.ndarray, adhesion: np.ndarray, box: Pair) -> _Found:
    """The estimate, H, f and G, element by element, and the sum of squared errors; each [runs]."""
    runs = slip.shape[1]
    x = start(runs)
    # H after each of the last five samples, the latest first. The next one takes the array of the
    # earliest, so that none is copied.
    history = [zeros(3, runs) for _ in range(5)]
    f, g, now = zeros(2, runs), zeros(3, runs), zeros(3, runs)
    u1, u2, error, eta, weight, work = zeros(6, runs)
    least = np.full(runs, 0.251)
    spare = zeros(5, runs)
    for sample, (size, measured) in enumerate(zip(slip, adhesion, strict=True)):
        regressors(size, measured, u1, u2, error)
        forgetting(size, measured, x, (least, 1.0, 2.0), eta, work)
        products = (u1, u1), (u1, u2), (u2, u2)
        for product, (one, other) in zip(now, products, strict=True):
            np.multiply(one, other, out=product)
        if sample >= 5:
            calm = np.flatnonzero(_is_inside([now[0], *(h[0] for h in history)], spare))
            for element in (1, 2):
                matrices = [matrix[element][calm] for matrix in (now, *history)]
                calm = calm[_is_inside(matrices, [array[: calm.size] for array in spare])]
            eta[calm] = 1.0
        np.multiply(eta, -0.5, out=weight)
        weight += 1.0
        h = history.pop()
        for new, old, product in zip(h, history[0], now, strict=True):
            np.multiply(old, eta, out=new)
            product *= weight
            new += product
        history.insert(0, h)
        target = np.multiply(error, weight, out=now[0])
        discount(f, eta, ((u1, target), (u2, target)), work)
        solve_in_box((*h, *f), x, box, spare, work)
        subtract(error, x, (u1, u2), work)
        error *= weight
        u1 *= error
        u2 *= error
        eta *= eta
        discount(g, eta, products, work)
    return *x, *history[0], *f, *g, objective(slip, adhesion, x)


def qp_qian2024_2(slip: np.ndarray, adhesion: np.ndarray, box: Pair) -> _Found:
    """The estimate, H, f and G, element by element, and the sum of squared errors; each [runs]."""
    runs = slip.shape[1]
    x = start(runs)
    sums, g = zeros(5, runs), zeros(3, runs)
    u1, u2, error, eta, work = zeros(5, runs)
    least = np.full(runs, 0.971)
    spare = zeros(5, runs)
    squares = (u1, u1), (u1, u2), (u2, u2)
    for size, measured in zip(slip, adhesion, strict=True):
        regressors(size, measured, u1, u2, error)
        forgetting(size, measured, x, (least, 1.0, 2.0), eta, work)
        discount(sums, eta, (*squares, (u1, error), (u2, error)), work)
        solve_in_box(sums, x, box, spare, work)
        subtract(error, x, (u1, u2), work)
        u1 *= error
        u2 *= error
        eta *= eta
        discount(g, eta, squares, work)
    return *x, *sums, *g, objective(slip, adhesion, x)


def qp_bias_compensated(slip: np.ndarray, adhesion: np.ndarray, box: Pair) -> _Found:
    """The estimate, H, f, G and the sums of the noise, element by element, and the objective."""
    runs = slip.shape[1]
    x = start(runs)
    sums, g, noise = zeros(5, runs), zeros(3, runs), zeros(6, runs)
    h11, h12, h22, f1, f2 = sums
    m11, m12, m22, n1, squares, weights = noise
    u1, u2, error, eta, s2, squared, work = zeros(7, runs)
    # Both are arrays, with which a maximum takes a third of the time that it takes with a number.
    least, zero = np.full(runs, 0.971), np.zeros(runs)
    clear, spare = zeros(5, runs), zeros(5, runs)
    for size, measured in zip(slip, adhesion, strict=True):
        regressors(size, measured, u1, u2, error)
        forgetting(size, measured, x, (least, 1.0, 2.0), eta, work)
        discount(sums, eta, ((u1, u1), (u1, u2), (u2, u2), (u1, error), (u2, error)), work)
        np.multiply(size, size, out=squared)
        discount((m12, m22), eta, ((size, squared), (squared, squared)), work)
        for total, term in ((m11, squared), (n1, size), (weights, 1.0)):
            total *= eta
            total += term
        squares *= eta
        _variance((h11, h12, h22), noise, zero, s2, spare)
        bias = np.multiply(m11, s2, out=work)
        np.subtract(h11, bias, out=clear[0])
        np.add(f2, bias, out=clear[4])
        np.subtract(h12, np.multiply(m12, s2, out=work), out=clear[1])
        np.subtract(h22, np.multiply(m22, s2, out=work), out=clear[2])
        np.add(f1, np.multiply(n1, s2, out=work), out=clear[3])
        solve_in_box(clear, x, box, spare, work)
        subtract(error, x, (u1, u2), work)
        denominator, share, *_ = spare
        denominate(size, x, denominator)
        np.divide(error, denominator, out=share)
        share *= share
        squares += share
        # The score is U e + s^2 D [l, l^2], and its second element the first one times l.
        u1 *= error
        denominator *= s2
        u1 += np.multiply(denominator, size, out=work)
        np.multiply(u1, size, out=u2)
        eta *= eta
        discount(g, eta, ((u1, u1), (u1, u2), (u2, u2)), work)
    return *x, *sums, *g, *noise, objective(slip, adhesion, x)


def _is_inside(matrices: Sequence[np.ndarray], spare: Sequence[np.ndarray]) -> np.ndarray:
    """Whether S = (mean X1 - mean X2)/(S1 + S2) lies in the critical interval.

    X1 are the first three arrays and X2 the last three. Both sides carry a factor of 3: with
    p = a - b and q = b - c, the variance of a, b and c is 2/9 (p (p + q) + q^2).
    """
    difference, spread, p, q, work = spare
    np.add(matrices[0], matrices[1], out=difference)
    difference += matrices[2]
    for earlier in matrices[3:]:
        difference -= earlier
    for out, (a, b, c) in ((spread, matrices[:3]), (work, matrices[3:])):
        np.subtract(a, b, out=p)
        np.subtract(b, c, out=q)
        np.add(p, q, out=out)
        out *= p
        q *= q
        out += q
        np.sqrt(out, out=out)
    spread += work
    inside: np.ndarray = difference > np.multiply(spread, _LOW * np.sqrt(2), out=work)
    inside &= difference < np.multiply(spread, _HIGH * np.sqrt(2), out=work)
    return inside


def _variance(
    h: Sequence[np.ndarray],
    noise: Sequence[np.ndarray],
    zero: np.ndarray,
    out: np.ndarray,
    spare: Sequence[np.ndarray],
) -> None:
    """The variance of the noise, at most half of the least s^2 with det(H - s^2 M) = 0."""
    (h11, h12, h22), (m11, m12, m22, _, squares, weights) = h, noise
    mixed, spread, curvature, root, work = spare
    np.multiply(h11, h22, out=curvature)
    curvature -= np.multiply(h12, h12, out=work)
    np.maximum(curvature, zero, out=curvature)
    np.multiply(m11, m22, out=spread)
    spread -= np.multiply(m12, m12, out=work)
    np.multiply(h12, m12, out=mixed)
    mixed *= -2.0
    mixed += np.multiply(h11, m22, out=work)
    mixed += np.multiply(h22, m11, out=work)
    np.multiply(mixed, mixed, out=root)
    spread *= curvature
    spread *= 4.0
    root -= spread
    np.maximum(root, zero, out=root)
    mixed += np.sqrt(root, out=root)
    np.copyto(mixed, 1.0, where=mixed <= 0)
    curvature /= mixed
    np.divide(squares, weights, out=out)
    np.minimum(out, curvature, out=out)


# ---------------------------------------------------------------------------------- their steps

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
