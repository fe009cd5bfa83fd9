"""Interacting multiple models: the rails that have a name, and one that has none."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import Scalar, free_values, with_free_values
from adhesion_jax.identifiers.filters import RandomWalkFilter, coordinates_of
from adhesion_jax.optim.arrays import Value, Vector
from adhesion_jax.optim.kalman import Gaussian, Model, Predicted, corrected, extended
from adhesion_jax.optim.levenberg_marquardt import fit
from adhesion_jax.records import Known
from adhesion_jax.scenarios.rail_process import of_many
from adhesion_jax.scenarios.rails import RAILS, peak_of

#: Slips, over that of the peak, at which a curve of another form is fitted to a named rail: further
#: down He's curves of the lesser rails are not as steep as the initial slope that may be known.
_SLIPS = np.linspace(0.5, 2.0, 40)

#: Largest number of steps of that fit.
_STEPS = 50


class Modes(NamedTuple):
    """A belief for each mode, the named rails first, and where a mode begins."""

    beliefs: Gaussian  # means [modes, free], covariances [modes, free, free]
    weight: Float[Array, " modes"]
    rails: Float[Array, "rails free"]  # coordinates of the named rails


class InteractingModels(RandomWalkFilter):
    """One extended Kalman filter for each rail of He et al. 2018 and one for any other rail.

    The mode of a sample is that of the sample before with probability 1 - switching, else each of
    the others is as likely. Where a named rail begins, its coordinates are its own, known to
    `nearness`; where the other one begins, they are those before, known to `spread`. Within a mode
    they walk. Each sample the beliefs of a mode that come from different modes are merged into one
    of their mean and covariance, then each mode is weighed by what it predicted, its innovation
    clipped.

    On a curve of another form a named rail is the least-squares fit to He's curve about its peak.
    Source: Blom and Bar-Shalom 1988, IEEE Trans. Autom. Control 33:780-783.
    """

    switching: Scalar = 1e-4
    nearness: Scalar = 0.6
    clip: Scalar = 3.0  # in standard deviations: no single sample may outweigh a rare switch

    def start(self, known: Known, mean: Vector, key: PRNGKeyArray) -> Modes:
        return self._around(named_rails(known), mean)

    def again(self, known: Known, belief: Modes, mean: Vector) -> Modes:
        return self._around(belief.rails, mean)

    def _around(self, rails: Float[Array, "rails free"], mean: Vector) -> Modes:
        means, modes = jnp.vstack([rails, mean]), len(rails) + 1
        beliefs = Gaussian(means, self._fresh(modes, mean.size))
        return Modes(beliefs, jnp.full(modes, 1 / modes), rails)

    def _fresh(self, modes: int, size: int) -> Float[Array, "modes free free"]:
        """The covariance of each mode where it begins."""
        deviation = jnp.full(modes, self.nearness).at[-1].set(self.spread)
        return deviation[:, None, None] ** 2 * jnp.eye(size)

    def walked(self, belief: Modes, walk: Value) -> Modes:
        modes = mixed(belief, self.switching, self._fresh(*belief.beliefs.mean.shape))
        means, covariances = modes.beliefs
        step = walk**2 * jnp.eye(means.shape[-1])
        return modes._replace(beliefs=Gaussian(means, covariances + step))

    def predicted(self, belief: Modes, model: Model) -> tuple[Value, Value]:
        """That of the likeliest mode: a mode that just begins is too vague to tell the noise."""
        each, likeliest = _samples_of(belief, model), jnp.argmax(belief.weight)
        return each.mean[likeliest], each.variance[likeliest]

    def learned(self, belief: Modes, model: Model, measured: Value, noise: Value) -> Modes:
        each = _samples_of(belief, model)
        beliefs = jax.vmap(corrected, (0, 0, None, None))(belief.beliefs, each, measured, noise)
        variance = each.variance + noise
        squared = jnp.minimum((measured - each.mean) ** 2 / variance, self.clip**2)
        gain = -0.5 * (squared + jnp.log(variance))
        weight = jax.nn.softmax(jnp.log(belief.weight) + gain)
        return belief._replace(beliefs=beliefs, weight=weight)

    def summary(self, belief: Modes) -> Gaussian:
        return merged(belief.weight, belief.beliefs)


def _samples_of(belief: Modes, model: Model) -> Predicted:
    """The next sample as each mode has it."""
    return jax.vmap(lambda one: extended(one, model))(belief.beliefs)


def mixed(belief: Modes, switching: Scalar, fresh: Float[Array, "modes free free"]) -> Modes:
    """The beliefs and weights of the modes one sample later, before it is seen.

    `fresh` is the covariance of a mode where it begins, of the last one besides that of the belief
    it begins from.
    """
    (means, covariances), weight, rails = belief
    others = switching / (len(weight) - 1) * (1 - weight)
    ahead = (1 - switching) * weight + others
    named = merged(weight[:-1], Gaussian(means[:-1], covariances[:-1]))
    begun = Gaussian(jnp.vstack([rails, named.mean]), fresh.at[-1].add(named.covariance))
    share = others / ahead
    pairs = jax.tree.map(lambda old, new: jnp.stack([old, new], axis=1), belief.beliefs, begun)
    beliefs = jax.vmap(merged)(jnp.stack([1 - share, share], axis=1), pairs)
    return Modes(beliefs, ahead, rails)


def merged(weight: Float[Array, " parts"], parts: Gaussian) -> Gaussian:
    """One belief with the mean and the covariance of a mixture."""
    weight = weight / jnp.sum(weight)
    mean = jnp.sum(weight[:, None] * parts.mean, axis=0)
    apart = parts.mean - mean
    spread = parts.covariance + apart[:, :, None] * apart[:, None]
    return Gaussian(mean, jnp.sum(weight[:, None, None] * spread, axis=0))


def named_rails(known: Known) -> Float[Array, "rails free"]:
    """The coordinates of the named rails on the curve that is known."""
    curves = of_many(list(RAILS.values()), (-1,))
    slips = jnp.array([peak_of(rail)[0] for rail in RAILS.values()])[:, None] * _SLIPS
    adhesions = jax.vmap(lambda curve, slip: curve(slip, {}))(curves, slips)
    lower, upper = jnp.asarray(known.lower), jnp.asarray(known.upper)

    def fitted(slip: Float[Array, " slips"], adhesion: Float[Array, " slips"]) -> Vector:
        def residual(values: Vector) -> Float[Array, " slips"]:
            return with_free_values(known.curve, values)(slip, known.conditions) - adhesion

        found = fit(residual, free_values(known.curve), lower, upper, _STEPS).x
        return coordinates_of(known).from_box(found)

    return jax.vmap(fitted)(slips, adhesions)


imm_rails = InteractingModels()
