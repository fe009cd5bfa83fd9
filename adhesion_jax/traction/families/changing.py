"""Families whose surface changes as the train runs: with time, speed, place and slip."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from adhesion_jax.traction.families.base import (
    SPEED,
    Family,
    between,
    exponential,
    exponentials,
    log_between,
    peaks,
    starts,
)
from adhesion_jax.traction.rails import Passed, Timed
from adhesion_jax.traction.signals import Number, PerAxle
from adhesion_jax.traction.surface import RailSurface, Scaled

#: Duration of a transition in s, from the start of a segment on.
TRANSITION = 1.0


class Passing(Timed):
    """Each parameter p passes from that of the segment before as p0^(1 - x) p1^x, x from 0 to 1.

    x grows in proportion to time over the steps of a transition.
    """

    surfaces: RailSurface
    starts: Int[Array, " segments"]
    steps: Float[Array, ""]

    def present(
        self, state: tuple[()], segment: Int[Array, ""], step: Int[Array, ""], train_speed: Number
    ) -> RailSurface:
        passed = jnp.clip((step - self.starts[segment]) / self.steps, 0.0, 1.0)
        return jax.tree.map(
            lambda old, new: old ** (1 - passed) * new**passed,
            self.surface(jnp.maximum(segment - 1, 0)),
            self.surface(segment),
        )


class SlowRails(Family):
    """The nominal rails, whose peak passes into the next one within a second."""

    TITLE = "exponential curves that pass into each other within 1 s"

    def draw(self, key: PRNGKeyArray, step: float) -> Passing:
        of_surfaces, of_starts = jax.random.split(key)
        steps = jnp.asarray(TRANSITION / step)
        return Passing(exponentials(of_surfaces), starts(of_starts, step), steps)


#: Bounds of the power of the speed with which adhesion falls.
POWERS = (0.0, 1.0)


class Falling(Timed):
    """mu(v_s, V) = (V/5 m/s)^-q mu(v_s/V): the best slip is a fixed share of the speed V.

    Below .5 m/s adhesion is that at .5 m/s.
    """

    surfaces: RailSurface  # in slip ratio
    starts: Int[Array, " segments"]
    powers: Float[Array, " segments"]

    def present(
        self, state: tuple[()], segment: Int[Array, ""], step: Int[Array, ""], train_speed: Number
    ) -> RailSurface:
        surface = self.surface(segment)
        left = (jnp.maximum(jnp.abs(train_speed), 0.5) / SPEED) ** -self.powers[segment]
        return RailSurface(Scaled(surface.law, left), in_ratio=True)


class SpeedRails(Family):
    """The peaks are drawn at 5 m/s; at each other speed of the train they are others."""

    TITLE = "exponential curves in slip ratio, lower at higher speed of the train"

    def draw(self, key: PRNGKeyArray, step: float) -> Falling:
        of_peaks, of_powers, of_starts = jax.random.split(key, 3)
        slip, adhesion = peaks(of_peaks)
        surfaces = RailSurface(jax.vmap(exponential)(slip / SPEED, adhesion).law, in_ratio=True)
        return Falling(surfaces, starts(of_starts, step), between(of_powers, POWERS))


#: Number of patches, after which the first one comes again, and bounds of their lengths in m.
PATCHES, LENGTHS = 32, (0.5, 20.0)


class ByPosition(Timed):
    """A surface up to each of some distances in m, the last of which is their period.

    The segments are by time, as those of other rails, and mean nothing for the surfaces. All axles
    are at one place.
    """

    surfaces: RailSurface
    starts: Int[Array, " segments"]
    ends: Float[Array, " patches"]

    def init(self, slip: PerAxle, train_speed: Number) -> Number:
        """The distance run in m."""
        return jnp.zeros(())

    def update(self, state: Number, passed: Passed, step: float) -> Number:
        return state + step * passed.train_speed

    def present(
        self, state: Number, segment: Int[Array, ""], step: Int[Array, ""], train_speed: Number
    ) -> RailSurface:
        return self.surface(jnp.sum(state % self.ends[-1] >= self.ends))


class PatchRails(Family):
    """Patches between .5 and 20 m, lengths log-uniform, each with a peak of its own."""

    TITLE = "patches of .5 to 20 m, each with an exponential curve of its own"

    def draw(self, key: PRNGKeyArray, step: float) -> ByPosition:
        of_surfaces, of_starts, of_lengths = jax.random.split(key, 3)
        ends = jnp.cumsum(log_between(of_lengths, LENGTHS, PATCHES))
        return ByPosition(exponentials(of_surfaces, PATCHES), starts(of_starts, step), ends)


#: Bounds of the relative gain k once the rail is clean, and of the work W0 in m that cleans it.
GAINS, WORKS = (0.1, 0.5), (0.01, 0.1)


class FilmState(NamedTuple):
    segment: Int[Array, ""]
    work: PerAxle  # slip energy over the load, m


class Filmed(Timed):
    """mu (1 + k (1 - exp(-W/W0))), dW_i = sum over j <= i of |mu_j v_s,j|; each segment is new.

    It is the effect `cleaning` in its step form, mu that of the film before it is cleaned. An axle
    runs on the rail that those before it have cleaned.
    """

    surfaces: RailSurface
    starts: Int[Array, " segments"]
    gains: Float[Array, " segments"]
    works: Float[Array, " segments"]

    def init(self, slip: PerAxle, train_speed: Number) -> FilmState:
        return FilmState(jnp.zeros((), dtype=int), jnp.zeros_like(slip))

    def update(self, state: FilmState, passed: Passed, step: float) -> FilmState:
        dirty = passed.adhesion / self._factor(state, passed.segment)
        work = self._work(state, passed.segment)
        power = jnp.cumsum(jnp.abs(dirty * passed.slip))
        return FilmState(passed.segment, work + step * power)

    def present(
        self, state: FilmState, segment: Int[Array, ""], step: Int[Array, ""], train_speed: Number
    ) -> RailSurface:
        return RailSurface(Scaled(self.surface(segment).law, self._factor(state, segment)))

    def _work(self, state: FilmState, segment: Int[Array, ""]) -> PerAxle:
        return jnp.where(state.segment == segment, state.work, 0.0)

    def _factor(self, state: FilmState, segment: Int[Array, ""]) -> PerAxle:
        work = self._work(state, segment)
        return 1 - self.gains[segment] * jnp.expm1(-work / self.works[segment])


class FilmRails(Family):
    """The nominal rails under a film; until it is cleaned adhesion is up to a third less.

    Slip of this moment raises the adhesion of later ones, which the true optimum of a moment does
    not count: on 40 rails that of price 0 has .1 % more utility at price 1 than that of price 1.
    """

    TITLE = "exponential curves under a film that slip energy cleans"

    def draw(self, key: PRNGKeyArray, step: float) -> Filmed:
        of_peaks, of_starts, of_gains, of_works = jax.random.split(key, 4)
        slip, adhesion = peaks(of_peaks)
        gains = between(of_gains, GAINS)
        surfaces = jax.vmap(exponential)(slip, adhesion / (1 + gains))
        return Filmed(surfaces, starts(of_starts, step), gains, log_between(of_works, WORKS))
