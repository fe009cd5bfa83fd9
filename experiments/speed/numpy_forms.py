"""Identifiers in plain NumPy, one step for all the runs: arrays [samples, runs].

Each returns its state, element by element, and the sum of squared errors; each [runs]. Slip is
positive and every sample is taken, so that nothing is spent on signs and missing samples. What few
runs need is computed for these alone: the edges of the box, and the second and third element of a
statistic. With an array of its own for every intermediate result NumPy takes 1.1 to 1.3 times as
long as where it writes in place, in twice the lines.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

Array = np.ndarray
Pair = tuple[Array, Array]
Found = tuple[Array, ...]

#: Where the recursions start, and the weight of that start in the quadratic programs.
_START, _RIDGE = (100.0, 50.0), 1e-10

#: The initial slope of Kiencke's curve.
_A0 = 40.0

#: The critical interval of the statistic.
_LOW, _HIGH = -0.8, -0.7


def rls_kiencke(slip: Array, adhesion: Array) -> Found:
    """The estimate, P and G."""
    return _recursive_least_squares(slip, adhesion, lambda size, *_: np.full_like(size, 0.99))


def rls_kiencke_variable(slip: Array, adhesion: Array) -> Found:
    """The same with a forgetting factor that follows the error."""
    return _recursive_least_squares(slip, adhesion, partial(forgetting, 0.9))


def _recursive_least_squares(
    slip: Array, adhesion: Array, factor: Callable[[Array, Array, Pair], Array]
) -> Found:
    """`factor` gives the forgetting factor of a sample, from its slip, its adhesion and x."""
    x1, x2 = start(slip)
    p11, p12, p22, *g = zeros(6, slip)
    p11 += 1e10
    p22 += 1e10
    for size, measured in zip(slip, adhesion, strict=True):
        u1, u2, target = regressors(size, measured)
        eta = factor(size, measured, (x1, x2))
        pu1, pu2 = p11 * u1 + p12 * u2, p12 * u1 + p22 * u2
        share = 1 / (u1 * pu1 + u2 * pu2 + eta)
        error = share * (target - x1 * u1 - x2 * u2)
        x1 += pu1 * error
        x2 += pu2 * error
        gain1, gain2 = pu1 * share, pu2 * share
        p11 -= pu1 * gain1
        p12 -= pu1 * gain2
        p22 -= pu2 * gain2
        for element in (p11, p12, p22):
            element /= eta
        error *= eta
        discount(g, eta * eta, products(u1 * error, u2 * error))
    return x1, x2, p11, p12, p22, *g, objective(slip, adhesion, (x1, x2))


def qp_qian2024_1(slip: Array, adhesion: Array, box: Pair) -> Found:
    """The estimate, H, f and G."""
    x, f, g = start(slip), zeros(2, slip), zeros(3, slip)
    history = 5 * [zeros(3, slip)]  # H after each of the last samples, the latest first
    for sample, (size, measured) in enumerate(zip(slip, adhesion, strict=True)):
        u1, u2, target = regressors(size, measured)
        eta, now = forgetting(0.251, size, measured, x), products(u1, u2)
        if sample >= 5:
            first, *others = zip(now, *history, strict=True)
            calm = np.flatnonzero(_is_inside(first))
            for matrices in others:
                calm = calm[_is_inside([matrix[calm] for matrix in matrices])]
            eta[calm] = 1.0
        weight = 1 - 0.5 * eta
        h = [old * eta + weight * product for old, product in zip(history[0], now, strict=True)]
        history = [h, *history[:4]]
        discount(f, eta, (u1 * target * weight, u2 * target * weight))
        x = solved_in_box((*h, *f), box)
        error = weight * (target - x[0] * u1 - x[1] * u2)
        discount(g, eta * eta, products(u1 * error, u2 * error))
    return *x, *history[0], *f, *g, objective(slip, adhesion, x)


def qp_qian2024_2(slip: Array, adhesion: Array, box: Pair) -> Found:
    """The estimate, H, f and G."""
    x, sums, g = start(slip), zeros(5, slip), zeros(3, slip)
    for size, measured in zip(slip, adhesion, strict=True):
        u1, u2, target = regressors(size, measured)
        eta = forgetting(0.971, size, measured, x)
        discount(sums, eta, (*products(u1, u2), u1 * target, u2 * target))
        x = solved_in_box(sums, box)
        error = target - x[0] * u1 - x[1] * u2
        discount(g, eta * eta, products(u1 * error, u2 * error))
    return *x, *sums, *g, objective(slip, adhesion, x)


def qp_bias_compensated(slip: Array, adhesion: Array, box: Pair) -> Found:
    """The estimate, H, f, G and the sums of the noise."""
    x, sums, g, noise = start(slip), zeros(5, slip), zeros(3, slip), zeros(6, slip)
    for size, measured in zip(slip, adhesion, strict=True):
        u1, u2, target = regressors(size, measured)
        eta, square = forgetting(0.971, size, measured, x), size * size
        discount(sums, eta, (*products(u1, u2), u1 * target, u2 * target))
        discount(noise, eta, (square, size * square, square * square, size, 0.0, 1.0))
        (h11, h12, h22, f1, f2), (m11, m12, m22, n1, squares, weights) = sums, noise
        s2 = _variance((h11, h12, h22), (m11, m12, m22), squares / weights)
        bias = m11 * s2
        clear = (h11 - bias, h12 - m12 * s2, h22 - m22 * s2, f1 + n1 * s2, f2 + bias)
        x = solved_in_box(clear, box)
        error, under = target - x[0] * u1 - x[1] * u2, denominator(size, x)
        squares += (error / under) ** 2
        # U e + s^2 D [l, l^2], whose second element is the first one times l.
        score = u1 * error + s2 * under * size
        discount(g, eta * eta, products(score, size * score))
    return *x, *sums, *g, *noise, objective(slip, adhesion, x)


def _is_inside(matrices: Sequence[Array]) -> Array:
    """Whether S = (mean X1 - mean X2)/(S1 + S2) lies in the critical interval.

    X1 are the first three arrays and X2 the last three. Both sides carry a factor of 3: with
    p = a - b and q = b - c, the variance of a, b and c is 2/9 (p (p + q) + q^2).
    """
    a, b, c, d, e, f = matrices
    difference = a + b + c - d - e - f
    pairs = ((a - b, b - c), (d - e, e - f))
    spread = sum(np.sqrt(p * (p + q) + q * q) for p, q in pairs) * np.sqrt(2)
    return (difference > _LOW * spread) & (difference < _HIGH * spread)


def _variance(h: Sequence[Array], m: Sequence[Array], seen: Array) -> Array:
    """The variance of the noise, at most half of the least s^2 with det(H - s^2 M) = 0."""
    (h11, h12, h22), (m11, m12, m22) = h, m
    curvature = np.maximum(h11 * h22 - h12 * h12, 0.0)
    mixed = h11 * m22 + h22 * m11 - 2 * h12 * m12
    root = np.maximum(mixed * mixed - 4 * curvature * (m11 * m22 - m12 * m12), 0.0)
    mixed += np.sqrt(root)
    return np.minimum(seen, curvature / np.where(mixed <= 0, 1.0, mixed))


# ---------------------------------------------------------------------------------- their steps


def zeros(count: int, slip: Array) -> list[Array]:
    return [np.zeros(slip.shape[1]) for _ in range(count)]


def start(slip: Array) -> Pair:
    return np.full(slip.shape[1], _START[0]), np.full(slip.shape[1], _START[1])


def regressors(size: Array, measured: Array) -> tuple[Array, Array, Array]:
    """U and what it is to give."""
    u1 = size * measured
    return u1, size * u1, _A0 * size - measured


def products(one: Array, other: Array) -> tuple[Array, Array, Array]:
    return one * one, one * other, other * other


def denominator(size: Array, x: Pair) -> Array:
    """Of Kiencke's curve."""
    return (x[1] * size + x[0]) * size + 1.0


def misfit(size: Array, measured: Array, x: Pair) -> Array:
    """The adhesion at this slip and x less the measured one."""
    return _A0 * size / denominator(size, x) - measured


def forgetting(least: float, size: Array, measured: Array, x: Pair) -> Array:
    """The forgetting factor, at least this."""
    return np.maximum(1 - 2 * np.abs(misfit(size, measured, x)), least)


def discount(sums: Sequence[Array], factor: Array, more: Sequence[Array | float]) -> None:
    """The sums times the factor, each plus one more."""
    for total, one in zip(sums, more, strict=True):
        total *= factor
        total += one


def solved_in_box(sums: Sequence[Array], box: Pair) -> Pair:
    """The best x in the box for H and f."""
    h11, h12, h22, f1, f2 = sums
    pull = _RIDGE * (h11 + h22)
    a11, a22 = h11 + pull, h22 + pull
    y1, y2 = f1 + pull * _START[0], f2 + pull * _START[1]
    determinant = a11 * a22 - h12 * h12
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (y1 * a22 - y2 * h12) / determinant, (y2 * a11 - y1 * h12) / determinant
    inside = determinant > 0
    for value, least, most in zip(x, *box, strict=True):
        inside &= (value >= least) & (value <= most)
    outside = np.flatnonzero(~inside)
    if outside.size:
        program = [part[outside] for part in (y1, y2, a11, a22, h12)]
        x[0][outside], x[1][outside] = _on_edge(program, box)
    return x


def _on_edge(program: Sequence[Array], box: Pair) -> Pair:
    y1, y2, a11, a22, a12 = program
    (low1, low2), (high1, high2) = box
    ones = np.ones_like(y1)
    edges = [(np.clip((y1 - e * a12) / a11, low1, high1), e * ones) for e in (low2, high2)]
    edges += [(e * ones, np.clip((y2 - e * a12) / a22, low2, high2)) for e in (low1, high1)]
    x1, x2 = np.array(edges).swapaxes(0, 1)
    values = x1 * (x1 * a11 + 2 * x2 * a12 - 2 * y1) + x2 * (x2 * a22 - 2 * y2)
    best = np.argmin(values, axis=0), np.arange(y1.size)
    return x1[best], x2[best]


def objective(slip: Array, adhesion: Array, x: Pair) -> Array:
    """The sum of squared errors of this estimate over the record."""
    total = np.zeros(slip.shape[1])
    for size, measured in zip(slip, adhesion, strict=True):
        total += misfit(size, measured, x) ** 2
    return total
