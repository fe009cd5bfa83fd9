"""The noise of a slip signal by the likelihood of the signal alone: how rough it is, how noisy."""

from itertools import product
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from adhesion_jax.curves import Conditions
from adhesion_jax.effects.slip_noise import SlipNoise, log_density, of_means
from adhesion_jax.programs import kept
from adhesion_jax.records import Record

#: Columns that the noise of a slip ratio may be divided by, "" for none: that of a wheel speed is
#: divided by the speed of the vehicle.
FALLS_WITH = ("vehicle_speed_mps", "")

#: Number of choices of each logarithm on the grid on which the likeliest noise is searched.
_CHOICES = 9

#: Half the width of the first grid, in units of the logarithm.
_REACH = 6.0

#: Each finer grid reaches this many cells of the one before to either side of its best choice.
_NEARER = 1.5

#: The search ends when half the width of the grid is at most this.
_PRECISE = 0.02

#: The step of log sigma for second differences of the likelihood.
_STEP = 0.02


class SlipSignal(NamedTuple):
    """The noise of greatest likelihood, and the 95 % interval of its standard deviation."""

    effect: SlipNoise
    low: float
    high: float
    loss: float  # minus the log density of the slip


def likeliest(
    record: Record, worth: np.ndarray, falls_with: str, given: float | None
) -> SlipSignal:
    """The noise of one kind, for the slip of runs in time, [runs, points].

    Each slip is the mean of `worth` independent samples, [runs, points]. If its standard deviation
    is `given`, only the roughness of the true slip is estimated.
    """
    slip = np.asarray(record.slip)[np.asarray(record.mask)]
    scale = float(np.median(record.conditions[falls_with])) if falls_with else 1.0
    spread = max(float(np.std(slip)), 1e-9)
    # Logarithms of roughness and sigma.
    best = np.log([spread, 0.02 * spread * scale if given is None else given])
    reach = np.array([_REACH, _REACH if given is None else 0.0])
    steps = np.linspace(-1.0, 1.0, _CHOICES)
    while reach.max() > _PRECISE:
        roughs, sizes = best[0] + reach[0] * steps, best[1] + reach[1] * steps
        sizes = sizes if reach[1] else best[1:]
        choices = np.array(list(product(roughs, sizes)))
        losses = _losses(record, worth, falls_with, choices)
        best = choices[losses.argmin()]
        reach = 2 * _NEARER * reach / (_CHOICES - 1)
    rough, sigma = np.exp(best).tolist()
    ahead, least, behind = _losses(
        record, worth, falls_with, best + np.array([[0.0, _STEP], [0.0, 0.0], [0.0, -_STEP]])
    ).tolist()
    spread = 0.0
    if given is None:
        curvature = max((ahead - 2 * least + behind) / _STEP**2, 1e-300)
        # A nearly flat likelihood determines only the order of magnitude.
        spread = min(1.96 / float(np.sqrt(curvature)), 5.0)
    # For a vanishing noise the curvature gives no upper bound, and the exponential overflows.
    with np.errstate(over="ignore"):
        ends = sigma * np.exp([-spread, spread])
    plain = SlipNoise(sigma=sigma, roughness=rough, falls_with=falls_with)
    return SlipSignal(plain, float(ends[0]), float(ends[1]), least)


def _losses(record: Record, worth: np.ndarray, falls_with: str, choices: np.ndarray) -> np.ndarray:
    """Minus the log density of the slip for logarithms of roughness and sigma, [choices]."""
    names = ("time_s", falls_with) if falls_with else ("time_s",)
    conditions = {name: jnp.asarray(record.conditions[name]) for name in names}
    slip, mask = jnp.asarray(record.slip), jnp.asarray(record.mask)
    arrays = slip, mask, conditions, jnp.asarray(worth)
    return -np.asarray(_log_densities(np.exp(choices), falls_with, *arrays))


@kept(static=(1,))
def _log_densities(
    choices: Float[Any, "choices two"],
    falls_with: str,
    slip: Float[Array, "runs points"],
    mask: Bool[Array, "runs points"],
    conditions: Conditions,
    worth: Float[Array, "runs points"],
) -> Float[Array, " choices"]:
    """The log density of the slips of all runs, for each choice of roughness and sigma."""

    def whole(choice: Float[Array, " two"]) -> Float[Array, ""]:
        kind = SlipNoise(sigma=choice[1], roughness=choice[0], falls_with=falls_with)

        def of_run(slip: Array, conditions: Conditions, worth: Array) -> Array:
            return log_density(of_means(kind, worth), slip, conditions)

        densities = jax.vmap(of_run)(slip, conditions, worth)
        return jnp.where(mask, densities, 0.0).sum()

    return jax.vmap(whole)(choices)
