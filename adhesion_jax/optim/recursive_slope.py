"""One coefficient by recursive least squares whose forgetting follows its regressor."""

from typing import NamedTuple

from jaxtyping import Array, Float


class SlopeStep(NamedTuple):
    """The coefficient and P after a sample, with its forgetting factor, gain and innovation."""

    theta: Float[Array, "..."]
    p: Float[Array, "..."]
    kappa: Float[Array, "..."]  # forgetting factor
    gain: Float[Array, "..."]
    scale: Float[Array, "..."]  # 1 + phi^2 P
    innovation: Float[Array, "..."]


def slope_step(
    theta: Float[Array, "..."],
    p: Float[Array, "..."],
    y: Float[Array, "..."],
    phi: Float[Array, "..."],
    gamma: Float[Array, "..."],
) -> SlopeStep:
    """The model y = theta phi, after Fang et al. 2018, Eq. 11.

    theta <- theta + P phi (y - theta phi)/(1 + phi^2 P),
    P <- P/(kappa (1 + phi^2 P)), kappa = 1/(1 + gamma phi^2).
    """
    scale = 1 + phi**2 * p
    gain = p * phi / scale
    innovation = y - theta * phi
    kappa = 1 / (1 + gamma * phi**2)
    return SlopeStep(theta + gain * innovation, p / (scale * kappa), kappa, gain, scale, innovation)
