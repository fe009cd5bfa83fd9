"""`online`: a method for a controller in plain Python, numbers in and numbers out."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.experimental.xla_metadata import set_xla_metadata
from jaxtyping import Array, Float

from adhesion_jax.campaign.tiles import COMPILER
from adhesion_jax.curves import SLIP_LIMIT
from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import Identifier, Status
from adhesion_jax.identifiers.of_numpy import OfNumpy, complain
from adhesion_jax.library.reading import Methods, methods_named
from adhesion_jax.measured.following import known_of
from adhesion_jax.programs import kept
from adhesion_jax.records import Known, Record
from adhesion_jax.runtime import as_in_commands, calling_thread, require_double_precision


def sample(
    slip: float | Float[Array, "..."],
    adhesion: float | Float[Array, "..."],
    **conditions: float | Float[Array, "..."],
) -> Record:
    """One fresh sample, or arrays [points] of a block, as `update` of an identifier takes it.

    May be used within `jax.jit` and `jax.vmap`.

    Args:
        slip: a ratio, or ratios [points].
        adhesion: force over load, of the same shape.
        **conditions: columns in SI units, such as time_s or vehicle_speed_mps.

    Returns:
        The record, all of whose points are new.

    Raises:
        InputError: jax computes in single precision.
    """
    require_double_precision()
    slips = jnp.atleast_1d(jnp.asarray(slip, float))

    def like_slips(values: float | Float[Array, "..."]) -> Float[Array, " points"]:
        return jnp.broadcast_to(jnp.asarray(values, float), slips.shape)

    every = jnp.ones(slips.shape, dtype=bool)
    columns = {name: like_slips(values) for name, values in conditions.items()}
    return Record(slips, like_slips(adhesion), every, every, columns)


class OnlineEstimate(NamedTuple):
    """What a method knows after a sample.

    Attributes:
        mu_max: the largest adhesion.
        slip_opt: its slip.
        mu_max_se: standard error of mu_max; NaN where the method has none.
        slip_opt_se: the same of slip_opt.
        status: a Status, whose `sentence` says why the estimate may not be trusted.
        reset: whether the past was given up at this sample.
    """

    mu_max: float
    slip_opt: float
    mu_max_se: float
    slip_opt_se: float
    status: Status
    reset: bool


class Online:
    """A method and its state, made by `online`."""

    def __init__(self, step: Callable[[list[Any]], tuple[Array, Array]], state: Array) -> None:
        self._step, self._state = step, state

    def update(self, slip: float, adhesion: float) -> OnlineEstimate:
        """What is known after one more sample: a slip, and force over load.

        A sample that is not finite, or whose adhesion no contact has, is left out. InputError where
        one of them is no number.
        """
        try:
            measured = np.array((float(slip), float(adhesion)))
        except (TypeError, ValueError):
            raise InputError(
                f"A sample is two numbers, slip and adhesion, and not {slip!r} and {adhesion!r}."
            ) from None
        with jax.enable_x64(True):
            self._state, told = self._step([self._state, measured])
        complain()
        mu_max, slip_opt, mu_max_se, slip_opt_se, status, reset = np.asarray(told).tolist()
        peak = mu_max, slip_opt, mu_max_se, slip_opt_se
        return OnlineEstimate(*peak, Status(int(status)), reset > 0)


@as_in_commands
def online(identifier: Methods, a0: float | None = None, known: Known | None = None) -> Online:
    """A method that a loop in Python gives one sample after the other.

    It is compiled once, in double precision and for the CPU, whatever jax is set to.

    Args:
        identifier: the name of a method of IDENTIFIERS that takes samples one by one, or one of
            your own by name, {"mine": Mine()}.
        a0: slope of Kiencke's curve at slip 0, a ratio; start and box are then those of `track`.
        known: instead of a0: the curve with its start, the box, and the largest slip.

    Returns:
        What has `update(slip, adhesion)`.

    Raises:
        InputError: there is no such method, it does not take samples, or a0 is not positive.
    """
    (name, method), *others = methods_named(identifier).items()
    if others:
        raise InputError("A loop has one method; name one.")
    if (a0 is None) == (known is None):
        raise InputError("Give either a0, the slope of the curve at slip 0, or all that is known.")
    if a0 is not None:
        if not (math.isfinite(a0) and a0 > 0):
            raise InputError(f"a0 is {a0}; the slope of a curve at slip 0 is a positive number.")
        known = known_of(float(a0), SLIP_LIMIT)
    assert known is not None
    told = dataclasses.replace(known, by_sample=True)
    reason = method.accepts(told)
    if reason is not None:
        raise InputError(f"{name} cannot follow samples: {reason}.")

    def begun() -> Any:
        return method.init(told, jax.random.key(0))

    leaves, tree = jax.tree.flatten(jax.eval_shape(begun))
    with jax.default_device(calling_thread()):
        state = jax.jit(lambda: _packed(begun()))()
        return Online(_ready(method, tree, tuple(leaves), state, np.zeros(2)), state)


def _ready(method: Identifier, *given: Any) -> Callable[[list[Any]], tuple[Array, Array]]:
    """The program of a step, as one function where it can be one."""
    if not isinstance(method, OfNumpy):
        try:
            return _step_as_one.ready(method, *given)
        except jax.errors.JaxRuntimeError:  # a sort, or a call of LAPACK, is no part of a function
            pass
    return _step.ready(method, *given)


@kept(compiler=COMPILER, static=(0, 1, 2))
def _step_as_one(method: Identifier, *given: Any) -> Any:
    """`_step`, compiled as one function of the processor.

    By itself the compiler makes a function of each operation. riv has some hundred and fifty, and
    their calls take longer than the work (microseconds a sample: 67 as they are, 25 as one).
    """
    with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
        return jax.jit(_step.function, static_argnums=(0, 1, 2))(method, *given)


@kept(compiler=COMPILER, static=(0, 1, 2))
def _step(
    method: Identifier,
    tree: jax.tree_util.PyTreeDef,
    leaves: tuple[jax.ShapeDtypeStruct, ...],
    state: Float[Array, " numbers"],
    measured: Float[Array, "2"],
) -> tuple[Float[Array, " numbers"], Float[Array, "6"]]:
    """The state after a sample, and the fields of `OnlineEstimate`.

    The state is one array, whatever `leaves` it has: each array that a program takes or gives costs
    a microsecond or two.
    """
    before, place = [], 0
    for leaf in leaves:
        kind = jax.eval_shape(_plain, leaf)
        part = state[place : place + kind.size].reshape(kind.shape).astype(kind.dtype)
        before.append(part if kind.dtype == leaf.dtype else jax.random.wrap_key_data(part))
        place += kind.size
    after = method.update(jax.tree.unflatten(tree, before), sample(measured[0], measured[1]))
    now = method.estimate(after)
    errors = dict(zip(now.values, jnp.sqrt(jnp.diagonal(now.covariance)), strict=True))
    numbers = [of[name] for of in (now.values, errors) for name in ("mu_max", "slip_opt")]
    told = [jnp.asarray(number, float) for number in (*numbers, now.status, now.reset)]
    return _packed(after), jnp.stack(told)


def _packed(state: Any) -> Float[Array, " numbers"]:
    """All numbers of a state, one after the other: whole ones of 32 bits are exact as floats."""
    return jnp.concatenate([_plain(x).ravel().astype(float) for x in jax.tree.leaves(state)])


def _plain(leaf: Array) -> Array:
    is_key = jnp.issubdtype(leaf.dtype, jax.dtypes.prng_key)
    return jax.random.key_data(leaf) if is_key else leaf
