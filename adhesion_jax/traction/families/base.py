"""The contract of a family of rails, and what the families draw alike."""

from abc import abstractmethod
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from adhesion_jax.curves import Scalar
from adhesion_jax.traction.loop import Loop
from adhesion_jax.traction.rails import Rails
from adhesion_jax.traction.surface import RailSurface, with_peak

#: Length of a segment in s, and how much earlier or later than its time one may begin.
LENGTH, JITTER = 5.0, 0.5

#: Number of segments.
SEGMENTS = 3

#: Bounds of the slip of the largest adhesion in m/s, which is log-uniform, and of that adhesion.
SLIPS, ADHESIONS = (0.05, 0.25), (0.06, 0.36)

#: b/a of the exponential surfaces, that of the published ones.
RATIO = 2.2222

#: The speed in m/s at which the drawn peaks are those of rails that depend on the speed.
SPEED = 5.0


class Family(eqx.Module):
    """Rails of one kind, drawn at random; all rails of a family are pytrees of one form."""

    TITLE: eqx.AbstractClassVar[str]  # of what kind they are, within a sentence
    SEGMENTS: ClassVar[int] = SEGMENTS

    @abstractmethod
    def draw(self, key: PRNGKeyArray, step: float) -> Rails:
        """Rails from a key alone, for a plant with steps in s; pure, and may be compiled."""

    def met(self, loop: Loop) -> Loop:
        """A loop as it is on these rails; by default as it is."""
        return loop

    @property
    def doubt(self) -> str:
        """A sentence on why there may be no such rail; empty for all that are made up."""
        return ""

    @property
    def drawn_as(self) -> str | None:
        """The family with whose keys these rails are drawn; by default it has keys of its own."""
        return None


def starts(key: PRNGKeyArray, step: float) -> Int[Array, " segments"]:
    """The steps at which segments begin: the first at 0, the others with jitter."""
    late = jax.random.uniform(key, (SEGMENTS - 1,), minval=-JITTER, maxval=JITTER)
    later = jnp.round((LENGTH * jnp.arange(1, SEGMENTS) + late) / step)
    return jnp.concatenate([jnp.zeros(1), later]).astype(int)


def between(
    key: PRNGKeyArray, ends: tuple[float, float], count: int = SEGMENTS
) -> Float[Array, " count"]:
    """Numbers that are uniform between two ends."""
    return jax.random.uniform(key, (count,), minval=ends[0], maxval=ends[1])


def log_between(
    key: PRNGKeyArray, ends: tuple[float, float], count: int = SEGMENTS
) -> Float[Array, " count"]:
    """Numbers whose logarithm is uniform between those of two ends."""
    low, high = ends
    return low * (high / low) ** jax.random.uniform(key, (count,))


def peaks(
    key: PRNGKeyArray, count: int = SEGMENTS
) -> tuple[Float[Array, " count"], Float[Array, " count"]]:
    """Slips in m/s and sizes of the largest adhesion."""
    of_slip, of_adhesion = jax.random.split(key)
    return log_between(of_slip, SLIPS, count), between(of_adhesion, ADHESIONS, count)


def exponentials(key: PRNGKeyArray, count: int = SEGMENTS) -> RailSurface:
    """Surfaces c (exp(-a v) - exp(-b v)) with drawn peaks."""
    return jax.vmap(exponential)(*peaks(key, count))


def exponential(slip: Scalar, adhesion: Scalar) -> RailSurface:
    """The surface with this peak."""
    return with_peak(adhesion, slip, RATIO)
