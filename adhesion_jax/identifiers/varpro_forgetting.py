"""Burckhardt's curve by least squares that forget: linear in c1 and c3 for each of many c2."""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import Scalar, free_values
from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.identifiers.base import Estimate, Identifier
from adhesion_jax.identifiers.curve_fit import Fit, residual, to_estimate
from adhesion_jax.identifiers.online import OnlineState, Sample, begin, over_fresh_samples
from adhesion_jax.metrics.information import inverse_information
from adhesion_jax.optim.arrays import Count, Value
from adhesion_jax.optim.quadratic_program import Products, bounded_pair
from adhesion_jax.records import Known, Record

#: Number of values of c2, by equal factors over its range.
_DEGREES = 48

#: The columns of the sums: 1 - exp(-c2 l), its derivative by c2, -l, the adhesion, and 1.
_PHI, _SLOPE, _PSI, _Y, _ONE = range(5)


class ForgettingSums(NamedTuple):
    """Sums over the samples, each a factor less for each sample after it."""

    products: Float[Array, "steep columns columns"]
    weights: Value
    squares: Value  # of the weights
    samples: Count


class ForgettingProjection(Identifier):
    """The least sum w (mu - c1 phi - c3 psi - offset)^2 over c1, c3 and 48 values of c2.

    phi = 1 - exp(-c2 |l|), psi = -|l|, w = factor^(number of samples since). For each c2 the best
    c1 and c3 in the box are closed (Golub and Pereyra 1973); from the best of these one step of
    Gauss and Newton leads to the c2 between them. Where the sensor of adhesion may have an
    `offset`, that unknown constant is eliminated first. The covariance is that of noise without
    memory at slips that come again and again.
    """

    FITS_LAST_RECORD = False
    RESETS = False

    factor: Scalar
    offset: bool = eqx.field(static=True)

    def accepts(self, known: Known) -> str | None:
        curve = known.curve
        if type(curve) is Burckhardt and curve.free == ("c1", "c2", "c3"):
            return None
        return "it is written for Burckhardt's curve with c1, c2 and c3 unknown"

    def init(self, known: Known, key: PRNGKeyArray) -> OnlineState:
        zero, none = jnp.zeros(()), jnp.zeros((_DEGREES, _ONE + 1, _ONE + 1))
        return begin(known, ForgettingSums(none, zero, zero, jnp.int32(0)))

    def update(self, state: OnlineState, record: Record) -> OnlineState:
        state = over_fresh_samples(partial(self.step, state.known), state, record)
        x, _ = self._found(state.known, state.recursion)
        misfit = residual(state.known, record, x)
        return state._replace(objective=jnp.sum(jnp.where(jnp.isfinite(misfit), misfit, 0.0) ** 2))

    def step(self, known: Known, sums: ForgettingSums, sample: Sample) -> ForgettingSums:
        taken, slip, adhesion, _ = sample
        size, one = jnp.abs(slip), jnp.ones(_DEGREES)
        c2 = _steep(known)
        left = jnp.exp(-c2 * size)
        row = jnp.stack(
            [1 - left, size * left, -size * one, jnp.sign(slip) * adhesion * one, one], axis=1
        )
        after = ForgettingSums(
            self.factor * sums.products + row[:, :, None] * row[:, None, :],
            self.factor * sums.weights + 1,
            jnp.square(self.factor) * sums.squares + 1,
            sums.samples + 1,
        )
        return jax.tree.map(lambda new, old: jnp.where(taken, new, old), after, sums)

    def estimate(self, state: OnlineState) -> Estimate:
        x, covariance = self._found(state.known, state.recursion)
        fit = Fit(
            x,
            covariance,
            state.objective,
            state.samples,
            state.recursion.samples > len(x) + self.offset,
            jnp.all(jnp.isfinite(x)),
            state.skipped,
        )
        return to_estimate(
            state.known, fit, jnp.asarray(self.factor, float), jnp.zeros((), dtype=bool)
        )

    def _found(
        self, known: Known, sums: ForgettingSums
    ) -> tuple[Float[Array, " free"], Float[Array, "free free"]]:
        """c1, c2, c3 and their covariance."""
        products, columns = sums.products, slice(0, _ONE)
        if self.offset:
            total = products[:, columns, _ONE]
            mean = total / jnp.maximum(sums.weights, 1.0)
            products = products[:, columns, columns] - total[:, :, None] * mean[:, None, :]
        of = lambda i, j: products[:, i, j]  # noqa: E731
        ranges = ((known.lower[i], known.upper[i]) for i in (0, 2))
        inner = Products(of(_PHI, _Y), of(_PSI, _Y), of(_PHI, _PHI), of(_PSI, _PSI), of(_PHI, _PSI))
        c1, c3 = bounded_pair(inner, *ranges)
        gain = c1 * (2 * inner.y_phi - c1 * inner.phi_phi - 2 * c3 * inner.phi_psi)
        best = jnp.argmax(gain + c3 * (2 * inner.y_psi - c3 * inner.psi_psi))
        start = jnp.stack([c1[best], _steep(known)[best], c3[best]])

        # To the first order in c2 the model is start[0] (phi + slope (c2 - c2')) + c3 psi.
        scale = jnp.stack([jnp.ones(()), start[0], jnp.ones(())])
        own = jnp.array([_PHI, _SLOPE, _PSI])
        information = products[best][jnp.ix_(own, own)] * jnp.outer(scale, scale)
        model = jnp.stack([start[0], jnp.zeros(()), start[2]])
        pull = scale * (products[best][own, _Y] - products[best][jnp.ix_(own, own)] @ model)
        inverse = inverse_information(information)
        move = inverse @ pull
        known_enough = jnp.all(jnp.isfinite(move))
        x = jnp.clip(start + jnp.where(known_enough, move, 0.0), known.lower, known.upper)
        x = jnp.where(sums.samples > 0, x, free_values(known.curve))

        left = (
            products[best, _Y, _Y]
            - gain[best]
            - c3[best] * (2 * inner.y_psi[best] - c3[best] * inner.psi_psi[best])
        )
        # Weights that differ are worth as many equal ones as their sum squared over their squares.
        worth = sums.squares / jnp.maximum(sums.weights, 1.0)
        freedom = jnp.maximum(sums.weights - (len(x) + self.offset) * worth, worth)
        variance = jnp.maximum(left, 0.0) / jnp.maximum(freedom, 1e-3)
        return x, jnp.where(known_enough, variance * worth, 0.0) * jnp.where(
            known_enough, inverse, jnp.diag(jnp.square(known.upper - known.lower))
        )


def _steep(known: Known) -> Float[Array, " steep"]:
    """The values of c2."""
    share = jnp.linspace(0.0, 1.0, _DEGREES)
    return known.lower[1] * (known.upper[1] / known.lower[1]) ** share


#: Some three hundred samples are remembered.
varpro_forgetting = ForgettingProjection(0.997, False)
varpro_forgetting_offset = ForgettingProjection(0.997, True)
