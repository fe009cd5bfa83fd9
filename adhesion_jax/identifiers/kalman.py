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
    def predicted(self, belief: Gaussian, model: Model) -> Predicted:
        """The sample as the belief has it."""

    def start(self, known: Known, mean: Vector, key: PRNGKeyArray) -> Gaussian:
        return Gaussian(mean, self.spread**2 * jnp.eye(mean.size))

    def again(self, known: Known, belief: Gaussian, mean: Vector) -> Gaussian:
        return Gaussian(mean, self.spread**2 * jnp.eye(mean.size))

    def ahead(self, belief: Gaussian, walk: Value, model: Model) -> tuple[Gaussian, Predicted]:
        spread = belief.covariance + walk**2 * jnp.eye(belief.mean.size)
        belief = Gaussian(belief.mean, spread)
        return belief, self.predicted(belief, model)

    def learned(
        self, belief: Gaussian, predicted: Predicted, model: Model, measured: Value, noise: Value
    ) -> Gaussian:
        return corrected(belief, predicted, measured, noise)

    def summary(self, belief: Gaussian) -> Gaussian:
        return belief
