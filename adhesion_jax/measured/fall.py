"""Whether the samples that an online estimate rests on show adhesion to fall beyond the peak.

A force that the driver or the brake limits ends the rise of the samples as a peak does. Only a fall
of adhesion at larger slips tells the two apart.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

#: Cells of the size of the slip, four to each doubling, of which the last one ends at the largest
#: slip; as many of the adhesion held before a sample, eight to each doubling, up to 1.
_CELLS, _OF_SLIP, _OF_ADHESION = 48, 4, 8

#: What a sample leaves of the adhesion held before it.
_HOLDS = 0.9

#: Most that is remembered of earlier samples after one at the slip of the peak: a method that
#: forgets nothing does not know that a rail changes slowly.
_REMEMBERED = 1 - 1 / 2000

#: Samples around the peak have a slip down to 1/1.4 and up to 1.4 times its own; those beyond it
#: have more, by three standard deviations of the noise of their slip.
_AROUND, _NOISES = 1.4, 3.0

#: The variance of a sample is known if so many tell of it, not counting one for each cell; a mean
#: has half as many samples.
_FEWEST = 8.0

#: What was reached is sought among means less this number of their standard errors.
BELOW = 2.0

#: The standard deviation of white noise over the geometric mean of the size of its second
#: difference s(k) - 2 s(k-1) + s(k-2): that of a standard normal variable is exp(-.6352), and a
#: few large ones, as where the slip breaks down, hardly change it. The difference counts as at
#: least this share of the largest slip.
_OF_BENDS, _LEAST_BEND = np.exp(0.6352) / np.sqrt(6), 1e-5

#: Least standard error of a mean, finer than any sensor of adhesion.
_FINEST = 1e-6


class Window(NamedTuple):
    """Sums over the samples since the last reset, each weighed by what is remembered of it.

    The rows of `sums` [4, cells] are the sums of the weights w, of w mu, of w mu^2 and of
    w log |d|, where d is the second difference of the slip.
    """

    sums: Float[Array, "4 cells"]
    levels: Float[Array, "3 cells"]  # the first three of these, by the adhesion held before
    before: Float[Array, "2"]  # slips of the last sample and of the one before it
    held: Float[Array, ""]  # running mean of adhesion


class Fall(NamedTuple):
    """The fall of the mean adhesion from around the peak to beyond it, and the adhesion reached.

    `fall` is NaN where too few samples lie around the peak or beyond it, `reached` where too few
    lie in any cell. Both errors are those of independent noise.
    """

    fall: Float[Array, ""]
    fall_se: Float[Array, ""]
    reached: Float[Array, ""]  # mean of the level whose mean is surely the largest
    reached_se: Float[Array, ""]


def empty() -> Window:
    return Window(jnp.zeros((4, _CELLS)), jnp.zeros((3, _CELLS)), jnp.zeros(2), jnp.zeros(()))


def extended(
    window: Window,
    slip: Float[Array, ""],
    adhesion: Float[Array, ""],
    slip_opt: Float[Array, ""],
    forgetting: Float[Array, ""],
    reset: Bool[Array, ""],
    start: Bool[Array, ""],
    limit: Float[Array, ""],
) -> Window:
    """The window after one more sample; with a `reset` it holds this sample alone.

    A fall is forgotten at any slip as the method forgets it, by `forgetting` (NaN: not at all): an
    estimate that has outlived it is no peak that was seen. The adhesion reached, and a fall at the
    least, are discounted by 1 - (1 - forgetting) min(1, slip/slip_opt), as samples at small slip
    hardly tell of the peak; without a peak below `limit` the share is 1. After a `start` no earlier
    slip is used.
    """
    size, upward = jnp.abs(slip), jnp.sign(slip) * adhesion
    taken = jnp.isfinite(size) & jnp.isfinite(upward)
    last, earlier = jnp.where(start, slip, window.before)
    bend = jnp.maximum(jnp.abs(slip - 2 * last + earlier), _LEAST_BEND * limit)
    cell, level = _cell(size / limit, _OF_SLIP), _cell(window.held, _OF_ADHESION)
    share = jnp.where(slip_opt < limit, jnp.minimum(size / _positive(slip_opt), 1.0), 1.0)
    kept = 1 - (1 - jnp.fmin(forgetting, _REMEMBERED)) * share
    one = jnp.stack([jnp.ones(()), upward, upward**2, jnp.log(bend)])
    kept = jnp.where(reset, 0.0, kept)
    sums = (window.sums * jnp.fmin(forgetting, kept)).at[:, cell].add(one)
    levels = (window.levels * kept).at[:, level].add(one[:3])
    held = jnp.where(start, upward, _HOLDS * window.held + (1 - _HOLDS) * upward)
    after = Window(sums, levels, jnp.stack([slip, last]), held)
    return Window(*(jnp.where(taken, new, old) for new, old in zip(after, window, strict=True)))


def _cell(size: Float[Array, ""], per_doubling: int) -> Int[Array, ""]:
    place = _CELLS + jnp.floor(per_doubling * jnp.log2(jnp.maximum(size, _FINEST)))
    return jnp.clip(place, 0, _CELLS - 1).astype(int)


def fall_of(window: Window, slip_opt: Float[Array, ""], limit: Float[Array, ""]) -> Fall:
    """The fall beyond the slip of the peak, and the largest adhesion that was surely reached.

    The scatter of a mean is that within cells, for that between them is the curve itself. What was
    reached is the mean of the samples that follow others of about such adhesion: noise of the slip,
    which mixes large and small adhesions at one slip, does not lower it, nor does the noise of a
    sample choose its own cell.
    """
    weight, _, _, bends = window.sums
    peak = _positive(slip_opt)
    lower = limit * jnp.asarray(2.0 ** (np.arange(-_CELLS, 0) / _OF_SLIP))
    middle = 2 ** (0.5 / _OF_SLIP) * lower
    noise = _OF_BENDS * jnp.exp(bends / jnp.maximum(weight, _FINEST))
    around = (middle > peak / _AROUND) & (middle < peak * _AROUND)
    beyond = lower - _NOISES * noise > peak * _AROUND
    groups = _scattered(window.sums[:3]) @ jnp.stack([around, beyond], axis=1)
    (high, low), errors = _mean(groups, jnp.sum(groups, axis=1, keepdims=True))

    levels = _scattered(window.levels)
    means, those = _mean(levels, levels)
    best = jnp.argmax(jnp.where(jnp.isnan(means), -jnp.inf, means - BELOW * those))
    return Fall(high - low, jnp.hypot(errors[0], errors[1]), means[best], those[best])


def _scattered(sums: Float[Array, "3 cells"]) -> Float[Array, "4 cells"]:
    """Weight, sum of adhesion, degrees of freedom, and sum of squares about the mean of a cell."""
    weight, first, second = sums
    several = jnp.maximum(weight, 1.0)
    scatter = jnp.where(weight > 1, jnp.maximum(second - first**2 / several, 0.0), 0.0)
    return jnp.stack([weight, first, several - 1, scatter])


def _mean(
    sums: Float[Array, "4 groups"], more: Float[Array, "4 #groups"]
) -> tuple[Float[Array, " groups"], Float[Array, " groups"]]:
    """The mean adhesion of groups of samples, NaN where these are few, and its standard error.

    The variance of a sample is that of its group or, if larger, that of `more` samples.
    """
    weight, first, freedom, scatter = sums
    enough = (weight >= _FEWEST / 2) & (more[2] >= _FEWEST)
    variance = jnp.maximum(scatter / jnp.maximum(freedom, 1.0), more[3] / jnp.maximum(more[2], 1.0))
    weight = jnp.where(enough, weight, 1.0)
    return jnp.where(enough, first / weight, jnp.nan), jnp.sqrt(variance / weight + _FINEST**2)


def _positive(slip_opt: Float[Array, ""]) -> Float[Array, ""]:
    """The slip of the peak; infinite where an estimate has none."""
    return jnp.where(slip_opt > 0, slip_opt, jnp.inf)
