"""Least squares that forget, of curves that are linear given one number, for many values of it."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import NO_CONDITIONS, Curve, Scalar, free_values
from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.curves.similar import Similar
from adhesion_jax.identifiers.online import Found, Sample, SelectiveMethod
from adhesion_jax.metrics.information import inverse_information
from adhesion_jax.optim.arrays import Count, Value
from adhesion_jax.optim.quadratic_program import Products, bounded_pair
from adhesion_jax.records import Known

#: Number of values of d, by equal factors over its range.
_DEGREES = 48

#: Weight of mu(0) = offset = 0 in samples where there is an offset: slips that lie close to each
#: other tell curve and offset apart no more, and then the smaller offset is the right one.
_ORIGIN = 0.01

#: The columns of the sums: phi, its derivative by d, psi, the adhesion, and 1.
_PHI, _SLOPE, _PSI, _Y, _ONE = range(5)


class Columns(NamedTuple):
    """mu(l) = a phi(l; d) + b psi(l) for l >= 0: a, d and b are the free parameters, in this order.

    A curve that has no b has a psi of 0.
    """

    free: tuple[str, ...]
    phi: Callable[[Any, Value, Value], Value]  # of the curve, d and |l|
    psi: Callable[[Value], Value]  # of |l|


#: The curves that have this form.
COLUMNS: Mapping[type[Curve], Columns] = {
    Burckhardt: Columns(
        ("c1", "c2", "c3"), lambda _, c2, size: 1 - jnp.exp(-c2 * size), lambda size: -size
    ),
    Similar: Columns(
        ("level", "stretch"),
        lambda curve, stretch, size: curve.shape(size / stretch, NO_CONDITIONS),
        jnp.zeros_like,
    ),
}


class ForgettingSums(NamedTuple):
    """Sums over the samples, each a factor less for each sample after it."""

    products: Float[Array, "degrees columns columns"]
    weights: Value
    squares: Value  # of the weights
    samples: Count


class ForgettingProjection(SelectiveMethod):
    """The least sum w (mu - a phi - b psi - offset)^2 over a, b and 48 values of d (`Columns`).

    w = factor^(number of samples since). For each d the best a and b in the box are closed (Golub
    and Pereyra 1973); from the best of these one step of Gauss and Newton leads to the d between
    them. The lower bound of d is above 0. Where the sensor of adhesion may have an `offset`, that
    unknown constant, with a hundredth of a sample at 0, is eliminated first. The covariance is that
    of noise without memory at slips that come again and again.
    """

    RESETS = False

    factor: Scalar
    offset: bool = eqx.field(static=True)

    def accepts(self, known: Known) -> str | None:
        columns = COLUMNS.get(type(known.curve))
        if columns and known.curve.free == columns.free and "mu_max" in known.asked:
            return None
        return (
            "it looks for the peak of Burckhardt's curve with c1, c2 and c3 unknown, "
            "or of a curve of known shape with its level and its stretch unknown"
        )

    def initial(self, known: Known, key: PRNGKeyArray) -> ForgettingSums:
        zero, none = jnp.zeros(()), jnp.zeros((_DEGREES, _ONE + 1, _ONE + 1))
        return ForgettingSums(none, zero, zero, jnp.int32(0))

    def after(self, known: Known, sums: ForgettingSums, sample: Sample) -> ForgettingSums:
        _, size, adhesion, _ = sample
        one, d = jnp.ones(_DEGREES), _grid(known)
        _, of_d, of_slip = COLUMNS[type(known.curve)]
        phi, slope = jax.jvp(lambda d: of_d(known.curve, d, size), (d,), (one,))
        psi, y = of_slip(size), jnp.where(size > 0, adhesion, 0.0)
        row = jnp.stack([phi, slope, psi * one, y * one, one], axis=1)
        return ForgettingSums(
            self.factor * sums.products + row[:, :, None] * row[:, None, :],
            self.factor * sums.weights + 1,
            jnp.square(self.factor) * sums.squares + 1,
            sums.samples + 1,
        )

    def found(self, known: Known, sums: ForgettingSums) -> Found:
        count = len(known.curve.free)
        products, columns = sums.products, slice(0, _ONE)
        if self.offset:
            total = products[:, columns, _ONE]
            mean = total / (sums.weights + _ORIGIN)
            products = products[:, columns, columns] - total[:, :, None] * mean[:, None, :]
        of = lambda i, j: products[:, i, j]  # noqa: E731
        inner = Products(of(_PHI, _Y), of(_PSI, _Y), of(_PHI, _PHI), of(_PSI, _PSI), of(_PHI, _PSI))
        lower, upper = (jnp.append(jnp.asarray(bound), 0.0) for bound in (known.lower, known.upper))
        a, b = bounded_pair(inner, (lower[0], upper[0]), (lower[2], upper[2]))
        gain = a * (2 * inner.y_phi - a * inner.phi_phi - 2 * b * inner.phi_psi)
        gain = gain + b * (2 * inner.y_psi - b * inner.psi_psi)
        best = jnp.argmax(gain)
        start = jnp.stack([a[best], _grid(known)[best], b[best]])[:count]

        # To the first order in d the model is a (phi + slope (d - d')) + b psi.
        scale = jnp.array([1.0, 0.0, 1.0]).at[1].set(a[best])[:count]
        own = jnp.array([_PHI, _SLOPE, _PSI])[:count]
        information = products[best][jnp.ix_(own, own)] * jnp.outer(scale, scale)
        model = start.at[1].set(0.0)
        pull = scale * (products[best][own, _Y] - products[best][jnp.ix_(own, own)] @ model)
        inverse = inverse_information(information)
        move = inverse @ pull
        known_enough = jnp.all(jnp.isfinite(move))
        x = jnp.clip(start + jnp.where(known_enough, move, 0.0), known.lower, known.upper)
        x = jnp.where(sums.samples > 0, x, free_values(known.curve))

        left = products[best, _Y, _Y] - gain[best]
        # Weights that differ are worth as many equal ones as their sum squared over their squares.
        worth = sums.squares / jnp.maximum(sums.weights, 1.0)
        freedom = jnp.maximum(sums.weights - (count + self.offset) * worth, worth)
        variance = jnp.maximum(left, 0.0) / jnp.maximum(freedom, 1e-3)
        covariance = jnp.where(known_enough, variance * worth, 0.0) * jnp.where(
            known_enough, inverse, jnp.diag(jnp.square(known.upper - known.lower))
        )
        enough = sums.samples > count + self.offset
        return Found(x, covariance, enough, jnp.asarray(self.factor, float))


def _grid(known: Known) -> Float[Array, " degrees"]:
    """The values of d."""
    share = jnp.linspace(0.0, 1.0, _DEGREES)
    return known.lower[1] * (known.upper[1] / known.lower[1]) ** share


#: Some three hundred samples are remembered.
varpro_forgetting = ForgettingProjection(0.997, False)
varpro_forgetting_offset = ForgettingProjection(0.997, True)
