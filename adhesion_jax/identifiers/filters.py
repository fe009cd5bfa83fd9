"""What the filters share: parameters that walk at random, on any curve, one sample at a time."""

from abc import abstractmethod
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import Scalar, free_values, with_free_values
from adhesion_jax.identifiers.innovations import SLOW, followed_scale, huber_weight, votes
from adhesion_jax.identifiers.online import Found, Sample, SelectiveMethod
from adhesion_jax.optim.arrays import Count, Value, Vector, Whether
from adhesion_jax.optim.box import Logit
from adhesion_jax.optim.kalman import Gaussian, Model
from adhesion_jax.records import Known

#: After the start and after a reset this many samples have no vote: the belief about the parameters
#: is then far from normal, and many an innovation is larger than it should be.
_YOUNG = 40

#: Innovations are clipped here before their correlation is taken: no outlier may start a walk.
_CLIP = 3.0

#: The trail is the sum of past innovations, each next one worth this much less.
_TRAIL = 0.95

#: Number of latest innovations that may vote.
_VOTERS = SLOW[1]


class FilterRecursion(NamedTuple):
    """The belief about the parameters in their coordinates, and what the innovations have told."""

    belief: Any  # the method's own
    walk: Value  # standard deviation of a step of each coordinate, per sample
    trail: Value  # discounted sum of the past innovations
    scale: Value  # standard deviation of the noise
    samples: Count  # since the start or the reset
    surprise: Float[Array, " voters"]  # |nu| of the latest samples, or 0 where it is no vote
    size: Value  # |slip| of the latest sample
    adhesion: Value  # of the latest sample, as in traction
    reset: Whether  # whether there was one in the last record


class RandomWalkFilter(SelectiveMethod):
    """A Bayesian filter of parameters that walk at random, in coordinates without bounds.

    A parameter between its bounds is lower + (upper - lower)/(1 + exp(-x)): far from the upper one
    a step of x is a share of the parameter. x(k) = x(k-1) + walk w(k), mu(k) = curve(l; x) + e(k).

    The walk is adapted: where innovations nu go with the trail of those before them the filter
    lags, and where they go against it, it follows the noise: log walk <- log walk +
    adaptation nu trail, within the bounds of the walk. (Mehra 1970, IEEE Trans. Autom. Control
    15:175-184: those of the best filter are white.) So noise with a memory is taken for a walk.

    Huber's weight of a sample multiplies the precision of its noise. The scale of the noise follows
    the median of |nu|. When the votes of the last samples say that the rail has changed, the filter
    begins anew around the mean that it has. A sample at slip 0 or one that repeats the last to
    the digit is passed over.
    """

    RESETS = True

    spread: Scalar = 1.0  # standard deviation of the start, in coordinates
    noise: Scalar = 0.1  # scale of the noise at the start
    walk: Scalar = 5e-4  # at the start
    walk_least: Scalar = 2e-5
    walk_most: Scalar = 1.5e-2
    adaptation: Scalar = 0.04
    huber: Scalar = 2.0
    gain: Scalar = 0.02  # least gain of the scale

    def accepts(self, known: Known) -> str | None:
        if not known.by_sample:
            return "it forgets as it follows a stream, and here are whole blocks"
        if "mu_max" in known.asked:
            return None
        return "it gives the parameters of a curve, which are not asked for here"

    @abstractmethod
    def start(self, known: Known, mean: Vector, key: PRNGKeyArray) -> Any:
        """The belief before any data, around this mean."""

    @abstractmethod
    def again(self, known: Known, belief: Any, mean: Vector) -> Any:
        """The belief after a reset, around this mean."""

    @abstractmethod
    def walked(self, belief: Any, walk: Value) -> Any:
        """The belief after a step of the walk."""

    @abstractmethod
    def predicted(self, belief: Any, model: Model) -> tuple[Value, Value]:
        """Mean and variance of the next sample without its noise."""

    @abstractmethod
    def learned(self, belief: Any, model: Model, measured: Value, noise: Value) -> Any:
        """The belief after a sample whose noise has this variance."""

    @abstractmethod
    def summary(self, belief: Any) -> Gaussian:
        """Mean and covariance of the coordinates."""

    def initial(self, known: Known, key: PRNGKeyArray) -> FilterRecursion:
        mean = coordinates_of(known).from_box(free_values(known.curve))
        zero, none = jnp.zeros(()), jnp.zeros((), dtype=bool)
        return self._begun(self.start(known, mean, key), zero, zero, none)

    def _begun(self, belief: Any, size: Value, adhesion: Value, reset: Whether) -> FilterRecursion:
        walk, scale, zero = jnp.asarray(self.walk), jnp.asarray(self.noise), jnp.zeros(())
        nobody = jnp.zeros(_VOTERS)
        return FilterRecursion(
            belief, walk, zero, scale, jnp.int32(0), nobody, size, adhesion, reset
        )

    def tells(self, recursion: FilterRecursion, sample: Sample) -> Whether:
        repeats = (sample.slip == recursion.size) & (sample.adhesion == recursion.adhesion)
        return (sample.slip > 0) & ~repeats

    def after(self, known: Known, recursion: FilterRecursion, sample: Sample) -> FilterRecursion:
        _, size, adhesion, others = sample
        conditions = dict(zip(known.curve.NEEDS, others, strict=True))
        coordinates = coordinates_of(known)

        def model(x: Vector) -> Value:
            return with_free_values(known.curve, coordinates.to_box(x))(size, conditions)

        belief, noise = self.walked(recursion.belief, recursion.walk), recursion.scale**2
        mean, variance = self.predicted(belief, model)
        nu = (adhesion - mean) / jnp.sqrt(variance + noise)
        belief = self.learned(belief, model, adhesion, noise / huber_weight(nu, self.huber))

        samples = recursion.samples + 1
        vote = jnp.where(samples <= _YOUNG, 0.0, jnp.abs(nu))
        surprise = jnp.concatenate([vote[None], recursion.surprise[:-1]])
        _, reset = votes(surprise)

        clipped = jnp.clip(nu, -_CLIP, _CLIP)
        # Of variance 1 as long as innovations are white.
        agreement = clipped * recursion.trail * jnp.sqrt(1 - _TRAIL**2)
        walk = recursion.walk * jnp.exp(self.adaptation * jnp.clip(agreement, -4.0, 4.0))
        later = FilterRecursion(
            belief,
            jnp.clip(walk, self.walk_least, self.walk_most),
            _TRAIL * recursion.trail + clipped,
            followed_scale(recursion.scale, nu, samples, self.gain),
            samples,
            surprise,
            size,
            adhesion,
            recursion.reset,
        )
        centre = self.summary(belief).mean
        anew = self._begun(self.again(known, belief, centre), size, adhesion, reset)
        return jax.tree.map(lambda new, old: jnp.where(reset, new, old), anew, later)

    def found(self, known: Known, recursion: FilterRecursion) -> Found:
        coordinates = coordinates_of(known)
        mean, covariance = self.summary(recursion.belief)
        slope = coordinates.slope(mean)
        return Found(
            jnp.where(jnp.all(jnp.isfinite(mean)), coordinates.to_box(mean), jnp.nan),
            slope[:, None] * covariance * slope,
            recursion.samples >= mean.size,
            jnp.ones(()),
        )


def coordinates_of(known: Known) -> Logit:
    return Logit(jnp.asarray(known.lower), jnp.asarray(known.upper))
