"""Exponential surfaces under a film that slip cleans."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from adhesion_jax.traction.families.base import (
    Family,
    between,
    exponential,
    log_between,
    peaks,
    starts,
)
from adhesion_jax.traction.rails import Passed, Timed
from adhesion_jax.traction.signals import Number, PerAxle
from adhesion_jax.traction.surface import RailSurface, Scaled

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
