"""What changes the adhesion curve by a column: level, slip scale, fall, an offset or a shift."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions, Scalar
from adhesion_jax.effects.api import Columns, Effect, Signal, Values

#: What a term may act on, in the order in which programs number them.
ACTS_ON = ("level", "slip", "fall", "offset", "shift")

#: Slips among which the peak is looked for, so many that it does not jump as parameters of a law
#: that bends change, and the ratios between the three slips of the parabolas that close in on it.
_SLIPS = np.geomspace(2e-3, 5.0, 48)
_REACHES = (1.18, 1.03)

#: Prior standard deviation of g at any place, by what it acts on: exp(1.5) is a factor of 4.5; that
#: of an offset is of adhesion, that of a shift of slip. Where the data do not determine g (no slip
#: beyond the peak at some value of a column) it stays near zero.
_SPREADS = {"level": 1.5, "slip": 1.5, "fall": 1.5, "offset": 0.3, "shift": 0.05}


class ShapeTerm(Effect):
    """A function g of columns that changes the curve mu(l), in one of five ways.

    level: mu exp(g). slip: mu(l exp(g)), so that the initial slope and the place of the peak move
    and the maximum stays. fall: mu_max - (mu_max - mu) exp(g) beyond the peak, mu below it. offset:
    mu + g. shift: mu(l + g). The terms of a law that act on the same add up in g.
    """

    acts_on: str = eqx.field(static=True, default="level", kw_only=True)

    @classmethod
    @abstractmethod
    def at_places(cls) -> np.ndarray:
        """What each strength adds to all that the prior holds near zero, [places, strengths].

        That is g at places spread over the columns; of a form that may swing in a gap between them
        also the second differences of g, each over its prior standard deviation relative to g's.
        """

    @abstractmethod
    def log_factor(self, conditions: Conditions) -> Values:
        """The function g, of the shape of the columns."""

    @classmethod
    @abstractmethod
    def starts(cls, columns: Columns) -> Sequence["ShapeTerm"]:
        """Terms to try first, on the level."""


def share_below(column: Values | float, mean: Scalar, spread: Scalar) -> Values:
    """The logistic distribution of that mean and standard deviation at the column, from 0 to 1.

    Places on it lie about evenly among the data, however long the tails of the column are.
    """
    return jax.nn.sigmoid(jnp.pi / 3**0.5 * (jnp.asarray(column) - mean) / spread)


@cache
def prior_precision(kind: type[ShapeTerm], acts_on: str) -> np.ndarray:
    """Precision of the strengths [strengths, strengths] of a kind of term.

    All of `at_places` is N(0, s^2), s the one of `_SPREADS` of what the term acts on.
    """
    places = kind.at_places()
    return places.T @ places / _SPREADS[acts_on] ** 2


def shaped(
    curve: Callable[[Values], Values], slip: Signal, exponents: Mapping[str, Values]
) -> Signal:
    """The curve under the sums g of its terms, by what they act on; what is absent is zero."""
    bent = slip * jnp.exp(exponents["slip"]) if "slip" in exponents else slip
    bent = bent + exponents["shift"] if "shift" in exponents else bent
    adhesion = curve(bent)
    if "fall" in exponents:
        peak = peak_slips(lambda slip: curve(jnp.broadcast_to(slip, bent.shape)), bent)
        adhesion = fallen(curve, bent, adhesion, exponents["fall"], peak)
    adhesion = adhesion * jnp.exp(exponents["level"]) if "level" in exponents else adhesion
    return adhesion + exponents["offset"] if "offset" in exponents else adhesion


def peak_slips(curve: Callable[[Values], Values], like: Signal) -> Signal:
    """Where the curve has its peak, of the shape of `like`; infinity where it has none.

    `curve` is asked for one slip of all points, where functions of the slip alone are computed
    once, and for a slip of each. The derivative of mu_max by a parameter is that at the place of
    the peak, which is itself taken as given: there the curve is flat.
    """
    at_each = jax.vmap(curve)
    top = jnp.argmax(at_each(jnp.asarray(_SLIPS)), axis=0)
    place = jnp.asarray(_SLIPS)[top]
    for reach in _REACHES:
        left, middle, right = at_each(jnp.stack([place / reach, place, place * reach]))
        bend = left - 2 * middle + right
        offset = jnp.where(bend < 0, 0.5 * (left - right) / jnp.where(bend < 0, bend, -1.0), 0.0)
        place = place * reach ** jnp.clip(offset, -1.0, 1.0)
    inside = (top > 0) & (top < _SLIPS.size - 1)
    peak = jax.lax.stop_gradient(jnp.where(inside, place, jnp.inf))
    return jnp.broadcast_to(peak, like.shape)


def fallen(
    curve: Callable[[Values], Values],
    slip: Signal,
    adhesion: Signal,
    exponent: Values,
    peak: Signal,
) -> Signal:
    """Beyond the slip of the peak mu_max - (mu_max - mu) exp(g); without a peak as it is."""
    highest = jnp.sign(slip) * curve(jnp.minimum(peak, _SLIPS[-1]))
    deeper = highest - (highest - adhesion) * jnp.exp(exponent)
    return jnp.where(jnp.abs(slip) > peak, deeper, adhesion)


def exponents_of(effects: Sequence[Effect], conditions: Conditions) -> dict[str, Values]:
    """The sums of the terms among some effects, by what they act on."""
    sums: dict[str, Float[Array, ...]] = {}
    for effect in effects:
        if isinstance(effect, ShapeTerm):
            g = effect.log_factor(conditions)
            sums[effect.acts_on] = sums[effect.acts_on] + g if effect.acts_on in sums else g
    return sums
