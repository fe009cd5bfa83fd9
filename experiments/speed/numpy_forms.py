"""Identifiers as NumPy computes them: one step for all the runs, with arrays [samples, runs].

Slip is positive and every sample is taken. What few runs need is computed for these alone: the
edges of the box, and the second and third element of a statistic.
"""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from experiments.speed import numpy_steps as steps
from experiments.speed.numpy_steps import Pair, zeros

_Found = tuple[np.ndarray, ...]

#: The critical interval of the statistic.
_LOW, _HIGH = -0.8, -0.7


def rls_kiencke(slip: np.ndarray, adhesion: np.ndarray) -> _Found:
    """The estimate, P and G, element by element, and the sum of squared errors; each [runs]."""
    return _recursive_least_squares(slip, adhesion, lambda *_: 0.99)


def rls_kiencke_variable(slip: np.ndarray, adhesion: np.ndarray) -> _Found:
    """The same with a forgetting factor that follows the error."""
    least, (eta, work) = np.full(slip.shape[1], 0.9), zeros(2, slip.shape[1])

    def factor(size: np.ndarray, measured: np.ndarray, x: Pair) -> np.ndarray:
        steps.forgetting(size, measured, x, (least, 1.0, 2.0), eta, work)
        return eta

    return _recursive_least_squares(slip, adhesion, factor)


def _recursive_least_squares(
    slip: np.ndarray, adhesion: np.ndarray, factor: Callable[..., Any]
) -> _Found:
    """`factor` gives the forgetting factor of a sample, from its slip, its adhesion and x."""
    runs = slip.shape[1]
    x1, x2 = steps.start(runs)
    p11, p12, p22 = np.full(runs, 1e10), np.zeros(runs), np.full(runs, 1e10)
    g = zeros(3, runs)
    u1, u2, error, pu1, pu2, share, work = zeros(7, runs)
    for size, measured in zip(slip, adhesion, strict=True):
        steps.regressors(size, measured, u1, u2, error)
        eta = factor(size, measured, (x1, x2))
        np.multiply(p11, u1, out=pu1)
        pu1 += np.multiply(p12, u2, out=work)
        np.multiply(p12, u1, out=pu2)
        pu2 += np.multiply(p22, u2, out=work)
        np.multiply(u1, pu1, out=share)
        share += np.multiply(u2, pu2, out=work)
        share += eta
        np.divide(1.0, share, out=share)
        steps.subtract(error, (x1, x2), (u1, u2), work)
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
        steps.discount(g, eta * eta, ((u1, u1), (u1, u2), (u2, u2)), work)
    return x1, x2, p11, p12, p22, *g, steps.objective(slip, adhesion, (x1, x2))


def qp_qian2024_1(slip: np.ndarray, adhesion: np.ndarray, box: Pair) -> _Found:
    """The estimate, H, f and G, element by element, and the sum of squared errors; each [runs]."""
    runs = slip.shape[1]
    x = steps.start(runs)
    # H after each of the last five samples, the latest first. The next one takes the array of the
    # earliest, so that none is copied.
    history = [zeros(3, runs) for _ in range(5)]
    f, g, now = zeros(2, runs), zeros(3, runs), zeros(3, runs)
    u1, u2, error, eta, weight, work = zeros(6, runs)
    least = np.full(runs, 0.251)
    spare = zeros(5, runs)
    for sample, (size, measured) in enumerate(zip(slip, adhesion, strict=True)):
        steps.regressors(size, measured, u1, u2, error)
        steps.forgetting(size, measured, x, (least, 1.0, 2.0), eta, work)
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
        steps.discount(f, eta, ((u1, target), (u2, target)), work)
        steps.solve_in_box((*h, *f), x, box, spare, work)
        steps.subtract(error, x, (u1, u2), work)
        error *= weight
        u1 *= error
        u2 *= error
        eta *= eta
        steps.discount(g, eta, products, work)
    return *x, *history[0], *f, *g, steps.objective(slip, adhesion, x)


def qp_qian2024_2(slip: np.ndarray, adhesion: np.ndarray, box: Pair) -> _Found:
    """The estimate, H, f and G, element by element, and the sum of squared errors; each [runs]."""
    runs = slip.shape[1]
    x = steps.start(runs)
    sums, g = zeros(5, runs), zeros(3, runs)
    u1, u2, error, eta, work = zeros(5, runs)
    least = np.full(runs, 0.971)
    spare = zeros(5, runs)
    squares = (u1, u1), (u1, u2), (u2, u2)
    for size, measured in zip(slip, adhesion, strict=True):
        steps.regressors(size, measured, u1, u2, error)
        steps.forgetting(size, measured, x, (least, 1.0, 2.0), eta, work)
        steps.discount(sums, eta, (*squares, (u1, error), (u2, error)), work)
        steps.solve_in_box(sums, x, box, spare, work)
        steps.subtract(error, x, (u1, u2), work)
        u1 *= error
        u2 *= error
        eta *= eta
        steps.discount(g, eta, squares, work)
    return *x, *sums, *g, steps.objective(slip, adhesion, x)


def qp_bias_compensated(slip: np.ndarray, adhesion: np.ndarray, box: Pair) -> _Found:
    """The estimate, H, f, G and the sums of the noise, element by element, and the objective."""
    runs = slip.shape[1]
    x = steps.start(runs)
    sums, g, noise = zeros(5, runs), zeros(3, runs), zeros(6, runs)
    h11, h12, h22, f1, f2 = sums
    m11, m12, m22, n1, squares, weights = noise
    u1, u2, error, eta, s2, squared, work = zeros(7, runs)
    # Both are arrays, with which a maximum takes a third of the time that it takes with a number.
    least, zero = np.full(runs, 0.971), np.zeros(runs)
    clear, spare = zeros(5, runs), zeros(5, runs)
    for size, measured in zip(slip, adhesion, strict=True):
        steps.regressors(size, measured, u1, u2, error)
        steps.forgetting(size, measured, x, (least, 1.0, 2.0), eta, work)
        steps.discount(sums, eta, ((u1, u1), (u1, u2), (u2, u2), (u1, error), (u2, error)), work)
        np.multiply(size, size, out=squared)
        steps.discount((m12, m22), eta, ((size, squared), (squared, squared)), work)
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
        steps.solve_in_box(clear, x, box, spare, work)
        steps.subtract(error, x, (u1, u2), work)
        denominator, share, *_ = spare
        steps.denominate(size, x, denominator)
        np.divide(error, denominator, out=share)
        share *= share
        squares += share
        # The score is U e + s^2 D [l, l^2], and its second element the first one times l.
        u1 *= error
        denominator *= s2
        u1 += np.multiply(denominator, size, out=work)
        np.multiply(u1, size, out=u2)
        eta *= eta
        steps.discount(g, eta, ((u1, u1), (u1, u2), (u2, u2)), work)
    return *x, *sums, *g, *noise, steps.objective(slip, adhesion, x)


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
