"""A seeker of NumPy: a class of a user's own that needs no jax."""

import inspect
from functools import partial
from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from adhesion_jax.errors import InputError
from adhesion_jax.identifiers.of_numpy import Packing, blame, for_every_run, raised
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.seekers.base import Seeker
from adhesion_jax.traction.signals import Reference, Signals
from adhesion_jax.wording import listed

#: What it has.
PARTS = ("init", "update")

#: What it is given of the signals beside `direction`: numbers of the train, and arrays with a
#: number for each axle.
_OF_TRAIN = ("time", "train_speed")
_PER_AXLE = ("demand", "motor_speed", "slip", "torque", "load", "adhesion", "slip_beside")


class SeekerOfNumpy(Seeker):
    """A seeker of NumPy, called by `jax.pure_callback` for all runs of a batch in turn: it is slow.

    It has `init()`, which gives the first state, and `update(state, signals, period)`, which gives
    the next state and the slip asked for in m/s, of the sign of `signals.direction`: one number, or
    one for each axle. A state is made of numbers and of arrays that keep their shapes. Whatever it
    raises makes the slip NaN, and is raised in words after the program.
    """

    told: str = eqx.field(static=True)
    own: Any = eqx.field(static=True)

    def init(self, nominal: Plant, signals: Signals) -> Float[Array, " memory"]:
        packing = Packing(self.own.init())
        return jnp.asarray(packing.packed(packing.first))

    def update(
        self, state: Float[Array, " memory"], nominal: Plant, signals: Signals, period: float
    ) -> tuple[Float[Array, " memory"], Reference]:
        fields = (*_OF_TRAIN, *_PER_AXLE, "direction")
        shape = signals.slip.shape
        given = jnp.stack([jnp.broadcast_to(getattr(signals, name), shape) for name in fields])
        memory, slip = for_every_run(
            partial(self._of_run, period), (state.size, signals.slip.size), state, given
        )
        return memory, Reference(slip, jnp.zeros_like(slip))

    def _of_run(
        self, period: float, memory: NDArray[np.float64], given: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        try:
            packing = Packing(self.own.init())
            after, slip = self.own.update(packing.unpacked(memory), _named(given), period)
            return packing.packed(after), np.broadcast_to(np.asarray(slip, float), given[0].shape)
        except Exception as error:  # of whatever it does
            blame(raised(self.told, self.own, error))
        return memory, np.full(given[0].shape, np.nan)


def _named(given: NDArray[np.float64]) -> SimpleNamespace:
    train, axles = np.split(given, [len(_OF_TRAIN)])
    of_train = dict(zip(_OF_TRAIN, train[:, 0].tolist(), strict=True))
    return SimpleNamespace(**of_train, **dict(zip((*_PER_AXLE, "direction"), axles, strict=True)))


def seeker_of_numpy(told: str, found: Any) -> SeekerOfNumpy:
    """The seeker that a class or an object of NumPy is; InputError where it is none."""
    lacking = [name for name in PARTS if not callable(getattr(found, name, None))]
    if lacking:
        raise InputError(
            f"{told} is no seeker: it lacks {listed(lacking)}. A class of NumPy has init(), which "
            "gives the first state, and update(state, signals, period), which gives the next state "
            "and the slip asked for in m/s."
        )
    try:
        return SeekerOfNumpy(told, found() if inspect.isclass(found) else found)
    except Exception as error:
        raise InputError(raised(told, found, error)) from error
