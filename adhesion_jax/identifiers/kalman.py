"""What Kalman filters share: a belief that is a normal distribution."""

from abc import abstractmethod

import jax.numpy as jnp
from jaxtyping import PRNGKeyArray

from adhesion_jax.identifiers.filters import RandomWalkFilter
from adhesion_jax.optim.arrays import Value, Vector
from adhesion_jax.optim.kalman import Gaussian, Model, Predicted, corrected
from adhesion_jax.records import Known


class KalmanFilter(RandomWalkFilter):
    """A filter whose members differ in how they predict a sample from the belief."""

    @abstractmethod
    def sample_of(self, belief: Gaussian, model: Model) -> Predicted:
        """The next sample as the belief has it."""

    def start(self, known: Known, mean: Vector, key: PRNGKeyArray) -> Gaussian:
        return Gaussian(mean, self.spread**2 * jnp.eye(mean.size))

    def again(self, known: Known, belief: Gaussian, mean: Vector) -> Gaussian:
        return Gaussian(mean, self.spread**2 * jnp.eye(mean.size))

    def walked(self, belief: Gaussian, walk: Value) -> Gaussian:
        step = walk**2 * jnp.eye(belief.mean.size)
        return belief._replace(covariance=belief.covariance + step)

    def predicted(self, belief: Gaussian, model: Model) -> tuple[Value, Value]:
        sample = self.sample_of(belief, model)
        return sample.mean, sample.variance

    def learned(self, belief: Gaussian, model: Model, measured: Value, noise: Value) -> Gaussian:
        return corrected(belief, self.sample_of(belief, model), measured, noise)

    def summary(self, belief: Gaussian) -> Gaussian:
        return belief
