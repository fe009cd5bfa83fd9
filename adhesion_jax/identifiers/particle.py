"""Bootstrap particle filter of parameters that walk at random."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.identifiers.filters import RandomWalkFilter
from adhesion_jax.optim.arrays import Matrix, Value, Vector
from adhesion_jax.optim.kalman import Gaussian, Model, lower_root
from adhesion_jax.records import Known


class Particles(NamedTuple):
    """A belief as particles: coordinates and the logarithms of their weights."""

    x: Float[Array, "particles free"]
    log_weight: Float[Array, " particles"]
    due: Matrix  # covariance by which they are to be spread before the next sample
    key: PRNGKeyArray

    def weight(self) -> Float[Array, " particles"]:
        return jax.nn.softmax(self.log_weight)


class ParticleFilter(RandomWalkFilter):
    """Particles walk, and each is weighed by what it makes of the sample.

    When the effective number of particles falls below half of them they are drawn anew by
    systematic resampling. As parameters that hardly walk would then be a few points only, each copy
    is spread by a kernel of covariance h^2 C, C that of the particles, and shrunk towards their
    mean, which keeps mean and covariance: h is that of Silverman for normal distributions.
    Source: Gordon, Salmond and Smith 1993, IEE Proc. F 140:107-113; Liu and West 2001, in
    Sequential Monte Carlo Methods in Practice, chapter 10.
    """

    particles: int = eqx.field(default=200, static=True)

    def start(self, known: Known, mean: Vector, key: PRNGKeyArray) -> Particles:
        x = jnp.broadcast_to(mean, (self.particles, mean.size))
        wide = self.spread**2 * jnp.eye(mean.size)
        return Particles(x, jnp.zeros(self.particles), wide, key)

    def again(self, known: Known, belief: Particles, mean: Vector) -> Particles:
        return self.start(known, mean, belief.key)

    def walked(self, belief: Particles, walk: Value) -> Particles:
        return spread_anew(belief, walk)

    def predicted(self, belief: Particles, model: Model) -> tuple[Value, Value]:
        values, weight = jax.vmap(model)(belief.x), belief.weight()
        mean = jnp.sum(weight * values)
        return mean, jnp.sum(weight * (values - mean) ** 2)

    def learned(self, belief: Particles, model: Model, measured: Value, noise: Value) -> Particles:
        misfit = measured - jax.vmap(model)(belief.x)
        log_weight = belief.log_weight - misfit**2 / (2 * noise)
        return belief._replace(log_weight=log_weight - jnp.max(log_weight))

    def summary(self, belief: Particles) -> Gaussian:
        return moments(belief)


def moments(belief: Particles) -> Gaussian:
    """Mean and covariance."""
    weight = belief.weight()[:, None]
    mean = jnp.sum(weight * belief.x, axis=0)
    apart = belief.x - mean
    return Gaussian(mean, jnp.sum((weight * apart)[:, :, None] * apart[:, None], axis=0))


def spread_anew(belief: Particles, walk: Value) -> Particles:
    """The particles after a step of the walk, drawn anew before it if too few have weight."""
    count, size = belief.x.shape
    key, own, place = jax.random.split(belief.key, 3)
    weight = belief.weight()
    few = 1 / jnp.sum(weight**2) < count / 2
    mean, covariance = moments(belief)
    width = (4 / (count * (size + 2))) ** (2 / (size + 4))  # h^2
    at = (jax.random.uniform(place) + jnp.arange(count)) / count
    chosen = jnp.minimum(jnp.searchsorted(jnp.cumsum(weight), at), count - 1)
    drawn = mean + jnp.sqrt(1 - width) * (belief.x[chosen] - mean)
    x = jnp.where(few, drawn, belief.x)
    log_weight = jnp.where(few, 0.0, belief.log_weight)
    root = lower_root(
        belief.due + walk**2 * jnp.eye(size) + jnp.where(few, width, 0.0) * covariance
    )
    # Not as a product of matrices, for which the compiler leaves its own code.
    x = x + jnp.sum(jax.random.normal(own, x.shape)[:, None] * root, axis=-1)
    return Particles(x, log_weight, jnp.zeros_like(belief.due), key)


particle = ParticleFilter()
