"""Differential evolution, rand/1/bin, for one problem; a batch of problems is its vmap.

Storn and Price 1997, J. Global Optimization 11:341-359. The whole population is advanced at
once (deferred updating). Runs of a batch stop one by one: a run that has stopped keeps its
state, so its result does not depend on its neighbours.

The arrays of a batch have the runs last, [..., runs], so that one vector instruction serves
several of them: a trial and its objective take a third of the time that they take with the runs
first.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import ClosedJaxpr, jaxpr_as_fun
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray, UInt32

from adhesion_jax.optim.arrays import Count, Value, Vector, Whether
from adhesion_jax.optim.turns import Turns, compacted_while_loop


def _mix(word: UInt32[Array, "*shape"]) -> UInt32[Array, "*shape"]:
    word = (word ^ (word >> 16)) * jnp.uint32(0x7FEB352D)
    word = (word ^ (word >> 15)) * jnp.uint32(0x846CA68B)
    return word ^ (word >> 16)


def counter_bits(
    seed: UInt32[Array, "2 ..."],
    time: Int[Array, "..."],
    purpose: int | Int[np.ndarray, " purposes"],
    members: int,
) -> UInt32[Array, "..."]:
    """32 random bits, [purposes, members, runs]: a function of the arguments alone.

    A single purpose or run has no axis.
    """
    one_run = [1] * time.ndim
    step = np.asarray(purpose, np.uint64) * np.uint64(0x9E3779B9) % 2**32
    step = step.astype(np.uint32).reshape(*step.shape, 1, *one_run)
    member = np.arange(members, dtype=np.uint32).reshape(members, *one_run)
    stream = _mix(seed[0] ^ _mix(time.astype(jnp.uint32) + step))
    return _mix(_mix(stream + member) ^ seed[1])


def as_uniform(bits: UInt32[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Uniform numbers in [0, 1)."""
    return bits.astype(jnp.float64) * 2.0**-32


def as_integer(bits: UInt32[Array, "*shape"], bound: int) -> Int[Array, "*shape"]:
    """Uniform integers in [0, bound), bound < 2^16 (bias below bound/2^16)."""
    return ((bits >> 16) * jnp.uint32(bound) >> 16).astype(jnp.int32)


#: How the runs of a batch take turns. Where searches end after 120 generations on average, 250 at
#: most, 1.2 times the generations of all runs are computed, instead of 2 times if all went on to
#: the last. 32 side by side, or 8 or 32 generations to a turn, took up to a tenth longer.
_TURNS = Turns(side_by_side=16, steps=16, axis=-1)

#: Up to this number of members, parents are chosen by comparison with each of them, because loops
#: that look them up do not become vector instructions; with many it takes longer to compile.
_FEW_MEMBERS = 40

#: The objective of one member.
Objective = Callable[[Vector], Value]


class Settings(NamedTuple):
    """The settings of the search, which may differ from run to run."""

    scale: float | Float[Array, "..."]  # F, the weight of the difference vector
    crossover: float | Float[Array, "..."]  # CR
    reflect: bool | Bool[Array, "..."]  # mirror a trial outside the box at the bound, else clip it
    tolerance: float | Float[Array, "..."]  # spread of the objective to stop at, by its least value
    target: float | Float[Array, "..."] = -jnp.inf  # least value of the objective to stop at


class Search(NamedTuple):
    """What several runs search with beside the objective."""

    lower: Float[Array, "p runs"]
    upper: Float[Array, "p runs"]
    seed: UInt32[Array, "2 runs"]
    settings: Settings


class _Given(NamedTuple):
    """What several runs search with; an array that they share has one of it on the axis of runs."""

    data: list[Array]  # what the objective takes from around it
    search: Search


class State(NamedTuple):
    """How far several runs are."""

    generation: Int[Array, " runs"]
    population: Float[Array, "p members runs"]
    objective: Float[Array, "members runs"]


_Going = tuple[State, Bool[Array, " runs"]]


class Result(NamedTuple):
    x: Vector
    objective: Value
    generations: Count
    evaluations: Count
    converged: Whether


def local_plus_uniform(
    key: PRNGKeyArray,
    centre: Vector,
    lower: Vector,
    upper: Vector,
    local_share: float | Value,
    radius: float | Value,
    reflect: bool | Whether,
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


def begin(population: Float[Array, "p members runs"]) -> State:
    """The state before the population is evaluated."""
    _, members, runs = population.shape
    return State(jnp.full(runs, -1, jnp.int32), population, jnp.full((members, runs), jnp.inf))


def generation(
    objective: Callable[[Float[Array, "p members runs"]], Float[Array, "members runs"]],
    search: Search,
    state: State,
    wanted: Whether,
) -> State:
    """One generation: v = x_r1 + F (x_r2 - x_r3), binomial crossover, the better one stays.

    The first one after `begin` evaluates the population as it is. `wanted` is true. As the compiler
    does not know, it keeps the trials and their objectives in memory; else it would compute them
    anew for each of their uses, which takes four times as long.
    """
    lower, upper, seed, settings = search
    population = state.population
    dimension, members, _ = population.shape

    def trials() -> Float[Array, "p members runs"]:
        chosen = _three_others(seed, state.generation, members)
        first, second, third = (_selected(population, each) for each in chosen)
        mutant = first + settings.scale * (second - third)
        mutant = _into_box(mutant, lower[:, None], upper[:, None], settings.reflect)
        forced = as_integer(counter_bits(seed, state.generation, 4, members), dimension)
        lots = counter_bits(seed, state.generation, 5 + np.arange(dimension), members)
        crossed = as_uniform(lots) < settings.crossover
        crossed |= forced == np.arange(dimension)[:, None, None]
        return jnp.where(crossed & (state.generation >= 0), mutant, population)

    tried = jax.lax.cond(wanted, trials, lambda: population)
    found = jax.lax.cond(wanted, lambda: objective(tried), lambda: state.objective)
    better = found <= state.objective
    return State(
        state.generation + 1,
        jnp.where(better, tried, population),
        jnp.where(better, found, state.objective),
    )


def minimise(
    objective: Objective,
    population: Float[Array, "p members"],
    lower: Vector,
    upper: Vector,
    key: PRNGKeyArray,
    settings: Settings,
    generations: int,
) -> Result:
    """Smallest objective in the box, found from an initial population.

    Stops when the objective's spread over the population is within the tolerance or its least value
    at the target, at the latest after `generations`; `converged` tells whether the spread is small.
    """
    seed = jax.random.bits(key, (2,), jnp.uint32)
    search = Search(lower, upper, seed, Settings(*map(jnp.asarray, settings)))
    # What the objective takes from around it becomes an argument: the batching rule is told which
    # parts of it differ from run to run.
    traced = jax.make_jaxpr(objective)(population[:, 0])
    given = _Given([jnp.asarray(x) for x in traced.consts], search)
    one_run = jax.tree.map(lambda x: x[..., None], (given, population))
    final = jax.tree.map(lambda x: x[..., 0], _ended(traced, generations)(*one_run))
    best = jnp.argmin(final.objective)
    return Result(
        final.population[:, best],
        final.objective[best],
        final.generation,
        (final.generation + 1) * population.shape[1],
        _spread_is_small(final.objective, settings.tolerance),
    )


def _ended(
    objective: ClosedJaxpr, generations: int
) -> Callable[[_Given, Float[Array, "p members runs"]], State]:
    """A function of several runs that gives the last state of each."""

    def of_members(data: list[Array], x: Float[Array, "p members runs"]) -> Array:
        axes = jax.tree.map(_axis_of_runs, data)
        data = [x[..., 0] if axis is None else x for axis, x in zip(axes, data, strict=True)]

        def of_run(data: list[Array], x: Vector) -> Value:
            return jaxpr_as_fun(ClosedJaxpr(objective.jaxpr, data))(x)[0]

        # The runs within the members: so their axis stays the last in all that is computed.
        of_runs = jax.vmap(of_run, in_axes=(axes, -1), out_axes=-1)
        return jax.vmap(of_runs, in_axes=(None, 1))(data, x)

    def advance(data: list[Array], search: Search, going: _Going) -> _Going:
        state, waits = going
        state = generation(partial(of_members, data), search, state, jnp.any(waits))
        arrived = jnp.min(state.objective, axis=0) <= search.settings.target
        arrived |= _spread_is_small(state.objective, search.settings.tolerance)
        return state, (state.generation < generations) & ~arrived

    @jax.custom_batching.custom_vmap
    def ended(given: _Given, population: Float[Array, "p members runs"]) -> State:
        going = begin(population), jnp.ones(population.shape[-1], dtype=bool)
        axes = jax.tree.map(_axis_of_runs, given)
        return compacted_while_loop(lambda going: going[1], advance, going, given, axes, _TURNS)[0]

    @ended.def_vmap
    def ended_in_batch(
        size: int, batched: list, given: Any, population: Any
    ) -> tuple[State, State]:
        """The runs of several batches lie side by side, as those of one."""
        runs = population.shape[-1]

        def joined(is_batched: bool, x: Array) -> Array:
            if not is_batched and x.shape[-1] == 1:
                return x
            x = jnp.moveaxis(x, 0, -2) if is_batched else x[..., None, :]
            return jnp.broadcast_to(x, (*x.shape[:-2], size, runs)).reshape(*x.shape[:-2], -1)

        if not batched[1]:
            population = jnp.stack([population] * size)
        last = ended(jax.tree.map(joined, batched[0], given), joined(True, population))
        parted = jax.tree.map(lambda x: x.reshape(*x.shape[:-1], size, runs), last)
        parted = jax.tree.map(lambda x: jnp.moveaxis(x, -2, 0), parted)
        return parted, jax.tree.map(lambda _: True, parted)

    return ended


def _axis_of_runs(x: Array) -> int | None:
    """None where the last axis is of one for all the runs."""
    return None if x.shape[-1] == 1 else -1


def _selected(
    population: Float[Array, "p members runs"], chosen: Int[Array, "members runs"]
) -> Float[Array, "p members runs"]:
    """population[:, chosen] run by run."""
    if population.shape[1] > _FEW_MEMBERS:
        return jnp.take_along_axis(population, chosen[None], 1, mode="promise_in_bounds")
    selected = jnp.broadcast_to(population[:, :1], population.shape)
    for k in range(1, population.shape[1]):
        selected = jnp.where(chosen == k, population[:, k : k + 1], selected)
    return selected


def _spread_is_small(
    objective: Float[Array, "members ..."], tolerance: float | Float[Array, "..."]
) -> Bool[Array, "..."]:
    best = jnp.min(objective, axis=0)
    return jnp.max(objective, axis=0) - best <= tolerance * jnp.abs(best)


def _into_box(x: Array, lower: Array, upper: Array, reflect: bool | Bool[Array, "..."]) -> Array:
    """Trials brought into the box: clipped, or mirrored at the bounds and then clipped."""
    mirrored = jnp.where(x < lower, 2 * lower - x, x)
    mirrored = jnp.where(mirrored > upper, 2 * upper - mirrored, mirrored)
    return jnp.clip(jnp.where(reflect, mirrored, x), lower, upper)


def _three_others(
    seed: UInt32[Array, "2 #runs"], generation: Int[Array, " runs"], members: int
) -> tuple[Int[Array, "members runs"], Int[Array, "members runs"], Int[Array, "members runs"]]:
    """For every member three other members, all different, each triple equally likely.

    The k-th is drawn from those that are left and moved past the ones already taken.
    """
    own = jnp.arange(members)[:, None]
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
