"""Many iterations side by side, in which none waits for the slowest."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool


class Turns(NamedTuple):
    """How iterations take turns."""

    side_by_side: int  # iterations that advance together, so that what they compute stays in cache
    steps: int  # steps after which those that have ended give their places to others
    axis: int  # axis of the iterations, 0 or -1


def compacted_while_loop(
    unfinished: Callable[[Any], Bool[Array, " states"]],
    advance: Callable[..., Any],
    states: Any,
    given: Any,
    axes: Any,
    turns: Turns,
) -> Any:
    """Many states, each advanced by `advance(*given, states)` while it is `unfinished`.

    `axes` says which leaves of `given` have the axis of the states: None for one shared by all. In
    each turn the first `turns.side_by_side` unfinished states advance a few steps: if all of them
    advanced until the last has ended, most steps would be of states that have ended before.
    """
    axis = turns.axis
    count = jax.tree.leaves(states)[0].shape[axis]
    width = min(turns.side_by_side, count)

    def where(which: Array, a: Array, b: Array) -> Array:
        shape = [1] * a.ndim
        shape[axis] = -1
        return jnp.where(which.reshape(shape), a, b)

    def one_turn(carry: tuple[Any, Array]) -> tuple[Any, Array]:
        states, waiting = carry
        place = jnp.cumsum(waiting) - 1
        chosen = jnp.argmax((place == jnp.arange(width)[:, None]) & waiting, axis=1)
        own = jax.tree.map(
            lambda has, x: x if has is None else jnp.take(x, chosen, axis, mode="clip"),
            axes,
            given,
            is_leaf=lambda has: has is None,
        )

        def step(_: Array, states: Any) -> Any:
            ahead, going = advance(*own, states), unfinished(states)
            return jax.tree.map(lambda a, b: where(going, a, b), ahead, states)

        some = jax.tree.map(lambda x: jnp.take(x, chosen, axis, mode="clip"), states)
        some = jax.lax.fori_loop(0, turns.steps, step, some)
        taken = waiting & (place < width)
        back = jnp.clip(place, 0, width - 1)
        states = jax.tree.map(
            lambda a, b: where(taken, jnp.take(a, back, axis, mode="clip"), b), some, states
        )
        return states, unfinished(states)

    def any_waits(carry: tuple[Any, Array]) -> Array:
        return jnp.any(carry[1])

    return jax.lax.while_loop(any_waits, one_turn, (states, unfinished(states)))[0]


def in_groups(function: Callable[..., Any], side_by_side: int) -> Callable[..., Any]:
    """The function, which vmap then evaluates in chunks of `side_by_side`.

    What a group computes stays in cache, and its loops wait for the slowest of the group alone.
    All arrays that differ from one to another must be arguments.
    """

    @jax.custom_batching.custom_vmap
    def grouped(*given: Any) -> Any:
        return function(*given)

    @grouped.def_vmap
    def one_group_after_the_other(_: int, batched: list, *given: Any) -> tuple[Any, Any]:
        leaves, form = jax.tree.flatten(given)
        differs = jax.tree.leaves(batched)

        def one(own: list[Array]) -> Any:
            each = iter(own)
            whole = [next(each) if has else x for has, x in zip(differs, leaves, strict=True)]
            return function(*jax.tree.unflatten(form, whole))

        own = [x for has, x in zip(differs, leaves, strict=True) if has]
        found = jax.lax.map(one, own, batch_size=side_by_side)
        return found, jax.tree.map(lambda _: True, found)

    return grouped
