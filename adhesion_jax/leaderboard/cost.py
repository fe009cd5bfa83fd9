"""What a method costs the computer that it runs on: time of an update, and memory."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from adhesion_jax.programs import kept
from adhesion_jax.traction.entrants import Entrant
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import Reference, Signals

#: Runs side by side, updates of each, and times that they are timed: the shortest counts.
_RUNS, _UPDATES, _TIMES = 128, 500, 4

_PERIOD = 1e-3


class Cost(NamedTuple):
    """Of an update of seeker and controller."""

    microseconds: float  # CPU time of one of many runs side by side
    state_bytes: int  # of the states


def cost(entrant: Entrant, plant: Plant) -> Cost:
    """The time of an update on this machine, and the bytes from one to the next."""
    given = jax.tree.map(jnp.asarray, (entrant, plant))
    times = [_updated.timed(*given) for _ in range(_TIMES)]
    *state, _ = times[0].result
    state_bytes = sum(leaf.nbytes for leaf in state) // _RUNS
    return Cost(1e6 * min(one.seconds for one in times) / (_RUNS * _UPDATES), state_bytes)


@kept()
def _updated(entrant: Entrant, plant: Plant) -> list[Array]:
    """The states after some updates, and the sum of the torques, which depends on all of them."""

    def update(phase: Float[Array, ""], state: Any, number: Int[Array, ""]) -> tuple[Any, Array]:
        signals = _signals(entrant, plant, phase, number)
        sought, controlled = state
        reference: Reference | None = None
        if entrant.seeker is not None:
            sought, reference = entrant.seeker.update(sought, plant, signals, _PERIOD)
        signals = signals._replace(reference=reference)
        controlled, torque = entrant.controller.update(controlled, plant, signals, _PERIOD)
        return (sought, controlled), torque

    def of_run(phase: Float[Array, ""]) -> list[Array]:
        first = _signals(entrant, plant, phase, jnp.asarray(0))
        seeker = None if entrant.seeker is None else entrant.seeker.init(plant, first)
        state = seeker, entrant.controller.init(plant, first)
        state, torques = jax.lax.scan(partial(update, phase), state, jnp.arange(_UPDATES))
        return [*jax.tree.leaves(state), torques.sum()]

    return jax.vmap(of_run)(jnp.linspace(0, 1, _RUNS))


def _signals(
    entrant: Entrant, plant: Plant, phase: Float[Array, ""], number: Int[Array, ""]
) -> Signals:
    """The signals of a slip that goes up and down over a curve: they are ordinary numbers."""
    told = entrant.seeker is not None and entrant.seeker.told_price is not None
    none = jnp.zeros_like(plant.radius)
    speed = jnp.asarray(5.0)
    slip = none + 0.1 + 0.05 * jnp.sin(0.02 * number + 6 * phase)
    adhesion = 0.3 * (1 - jnp.exp(-20 * slip)) - 0.3 * slip
    load = plant.load_of(adhesion)
    return Signals(
        time=number * _PERIOD,
        demand=none + plant.torque_limit,
        motor_speed=plant.gear_ratio * (speed + slip) / plant.radius,
        train_speed=speed,
        slip=slip,
        torque=load,
        load=load,
        adhesion=adhesion,
        slip_beside=slip,
        optimum=slip if told else None,
    )
