"""Differential evolution, rand/1/bin, for one problem; a batch of problems is its vmap.

Storn and Price 1997, J. Global Optimization 11:341-359. The whole population is advanced at
once (deferred updating). Runs of a batch stop one by one: a run that has stopped keeps its
state, so its result does not depend on its neighbours.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray, UInt32

from adhesion_jax.optim.counter_random import as_integer, as_uniform, counter_bits

Objective = Callable[[Float[Array, "p members"]], Float[Array, " members"]]


class Settings(NamedTuple):
    """The settings of the search. All but the two sizes may differ from run to run."""

    scale: Float[Array, ""]  # F, the weight of the difference vector
    crossover: Float[Array, ""]  # CR
    reflect: Bool[Array, ""]  # a trial outside the box is mirrored at the bound, else clipped
    tolerance: Float[Array, ""]  # spread of the objective at which to stop, as a share of its best


class State(NamedTuple):
    generation: Int[Array, ""]
    population: Float[Array, "p members"]
    objective: Float[Array, " members"]


class Result(NamedTuple):
    x: Float[Array, " p"]
    objective: Float[Array, ""]
    generations: Int[Array, ""]
    evaluations: Int[Array, ""]
    converged: Bool[Array, ""]


def local_plus_uniform(
    key: PRNGKeyArray,
    centre: Float[Array, " p"],
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
    local_share: float | Float[Array, ""],
    radius: float | Float[Array, ""],
    reflect: bool | Bool[Array, ""],
    members: int,
) -> Float[Array, "p members"]:
    """An initial population: the first `local_share` of it around `centre`, the rest uniform.

    Local members are x_j = centre_j + radius (upper_j - lower_j) N(0, 1), brought into the box
    like a trial (He et al. 2018, Eq. 16, with the scale for each parameter that it lacks).
    """
    local_key, uniform_key = jax.random.split(key)
    shape = (len(lower), members)
    width = (upper - lower)[:, None]
    local = centre[:, None] + radius * width * jax.random.normal(local_key, shape)
    local = _into_box(local, lower[:, None], upper[:, None], reflect)
    uniform = lower[:, None] + width * jax.random.uniform(uniform_key, shape)
    return jnp.where(jnp.arange(members) < local_share * members, local, uniform)


def init(objective: Objective, population: Float[Array, "p members"]) -> State:
    return State(jnp.int32(0), population, objective(population))


def update(
    state: State,
    objective: Objective,
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
    seed: UInt32[Array, "2"],
    settings: Settings,
) -> State:
    """One generation: v = x_r1 + F (x_r2 - x_r3), binomial crossover, the better one stays."""
    dimension, members = state.population.shape
    first, second, third = jax.lax.optimization_barrier(
        _three_others(seed, state.generation, members)
    )
    forced = as_integer(counter_bits(seed, state.generation, 4, members), dimension)

    def trial(axis: int) -> Float[Array, " members"]:
        x = state.population[axis]
        mutant = x[first] + settings.scale * (x[second] - x[third])
        mutant = _into_box(mutant, lower[axis], upper[axis], settings.reflect)
        lot = as_uniform(counter_bits(seed, state.generation, 5 + axis, members))
        return jnp.where((lot < settings.crossover) | (forced == axis), mutant, x)

    trials = jax.lax.optimization_barrier(jnp.stack([trial(axis) for axis in range(dimension)]))
    trial_objective = objective(trials)
    better = trial_objective <= state.objective
    return State(
        state.generation + 1,
        jnp.where(better, trials, state.population),
        jnp.where(better, trial_objective, state.objective),
    )


def minimise(
    objective: Objective,
    population: Float[Array, "p members"],
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
    key: PRNGKeyArray,
    settings: Settings,
    generations: int,
) -> Result:
    """Smallest objective in the box, found from an initial population.

    Stops when the objective's spread over the population is within the tolerance, at the
    latest after `generations`; `converged` tells which.
    """
    seed = jax.random.bits(key, (2,), jnp.uint32)

    def spread_is_small(state: State) -> Bool[Array, ""]:
        best = jnp.min(state.objective)
        return jnp.max(state.objective) - best <= settings.tolerance * jnp.abs(best)

    final = jax.lax.while_loop(
        lambda state: (state.generation < generations) & ~spread_is_small(state),
        lambda state: update(state, objective, lower, upper, seed, settings),
        init(objective, population),
    )
    best = jnp.argmin(final.objective)
    return Result(
        final.population[:, best],
        final.objective[best],
        final.generation,
        (final.generation + 1) * population.shape[1],
        spread_is_small(final),
    )


def _into_box(x: Array, lower: Array, upper: Array, reflect: bool | Bool[Array, ""]) -> Array:
    """Trials brought into the box: clipped, or mirrored at the bounds and then clipped."""
    mirrored = jnp.where(x < lower, 2 * lower - x, x)
    mirrored = jnp.where(mirrored > upper, 2 * upper - mirrored, mirrored)
    return jnp.clip(jnp.where(reflect, mirrored, x), lower, upper)


def _three_others(
    seed: UInt32[Array, "2"], generation: Int[Array, ""], members: int
) -> tuple[Array, Array, Array]:
    """For every member three other members, all different, each triple equally likely.

    The k-th is drawn from those that are left and moved past the ones already taken.
    """
    own = jnp.arange(members)
    draws = [as_integer(counter_bits(seed, generation, k, members), members - k) for k in (1, 2, 3)]
    first = draws[0] + (draws[0] >= own)
    low, high = jnp.minimum(first, own), jnp.maximum(first, own)
    second = draws[1] + (draws[1] >= low)
    second = second + (second >= high)
    lowest, highest = jnp.minimum(low, second), jnp.maximum(high, second)
    middle = low + high + second - lowest - highest
    third = draws[2] + (draws[2] >= lowest)
    third = third + (third >= middle)
    return first, second, third + (third >= highest)
