"""Methods of NumPy: a function of a block, or a class that takes samples. They need no jax."""

import inspect
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from traceback import walk_tb
from typing import Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray
from numpy.typing import NDArray

from adhesion_jax.errors import InputError
from adhesion_jax.identifiers.base import Estimate, Identifier, Status, as_arrays, needs_blocks
from adhesion_jax.identifiers.online import LARGEST
from adhesion_jax.metrics.information import quantities, quantity_names
from adhesion_jax.records import Known, Record
from adhesion_jax.wording import listed

_Floats = NDArray[np.float64]

#: What a method of a user's own gives: numbers by name, if it is right.
_Told = Any

#: The memory after a record, and what tells then.
_After = tuple[_Floats, Callable[[], _Told]]

#: What a solver raises where it finds nothing (`scipy.optimize.curve_fit`, `numpy.linalg`).
_FAILURES = (RuntimeError, ArithmeticError, ValueError)

#: What a class of NumPy has.
PARTS = ("init", "update", "estimate")

#: What methods did wrong within a program, which an error would end with a page of its own.
_faults: list[InputError] = []


def blame(words: str) -> None:
    """Keep what a method did wrong, unless another did before it, for `complain`."""
    _faults[:] = _faults or [InputError(words)]


def complain() -> None:
    """InputError where a method of NumPy did wrong since the last call: for after a program."""
    if _faults:
        first = _faults[0]
        _faults.clear()
        raise first


def for_every_run(
    of_run: Callable[..., tuple[_Floats, ...]], sizes: tuple[int, ...], *given: Array
) -> list[Array]:
    """Rows of numbers of these sizes, by a function of NumPy that is called for a run at a time."""

    def called(*bits: Array) -> list[NDArray[np.uint32]]:
        arrays = [np.ascontiguousarray(x).view(np.float64)[..., 0] for x in bits]
        runs = arrays[0].shape[: arrays[0].ndim - given[0].ndim]
        of_runs = (x.reshape(-1, *one.shape) for x, one in zip(arrays, given, strict=True))
        found = [of_run(*each) for each in zip(*of_runs, strict=True)]
        rows = (np.stack(part).reshape(*runs, -1) for part in zip(*found, strict=True))
        return [row[..., None].view(np.uint32) for row in rows]

    # As pairs of 32 bits: the thread that calls Python may be set to single precision.
    bits = [jax.lax.bitcast_convert_type(x, jnp.uint32) for x in given]
    shapes = [jax.ShapeDtypeStruct((size, 2), jnp.uint32) for size in sizes]
    told = jax.pure_callback(called, shapes, *bits, vmap_method="broadcast_all")
    return [jax.lax.bitcast_convert_type(x, float) for x in told]


@dataclass(frozen=True, eq=False)
class Packing:
    """States of one form, of numbers and of arrays, as numbers behind a zero."""

    first: Any

    @cached_property
    def _form(self) -> tuple[list[Any], Any]:
        return jax.tree.flatten(self.first)

    def packed(self, state: Any) -> _Floats:
        (leaves, tree), before = jax.tree.flatten(state), self._form
        if tree != before[1] or [*map(np.shape, leaves)] != [*map(np.shape, before[0])]:
            raise TypeError("update gives a state of another form than init")
        return np.concatenate([np.zeros(1), *(np.ravel(leaf).astype(float) for leaf in leaves)])

    def unpacked(self, numbers: _Floats) -> Any:
        state, place = [], 1
        for leaf in self._form[0]:
            kind = np.asarray(leaf)
            part = numbers[place : place + kind.size].reshape(kind.shape)
            with np.errstate(invalid="ignore"):
                typed = part.astype(kind.dtype)
            # A sum that begins with a whole 0 need not stay whole.
            part = typed if np.array_equal(typed, part) else part
            state.append(part if isinstance(leaf, np.ndarray) else part.item())
            place += kind.size
        return jax.tree.unflatten(self._form[1], state)


@dataclass(frozen=True, eq=False)
class _OfBlocks:
    """A function of the slips and the adhesions of the points of a block."""

    found: Callable[[_Floats, _Floats], _Told]
    first: ClassVar[_Floats] = np.zeros(1)

    def after(self, memory: _Floats, block: _Floats, _: _Floats) -> _After:
        return memory, partial(self.found, *block)


@dataclass(frozen=True, eq=False)
class _OfSamples:
    """An object with `init`, `update` and `estimate`, its state kept as numbers behind a zero."""

    found: Any

    @cached_property
    def _packing(self) -> Packing:
        return Packing(self.found.init())

    @cached_property
    def first(self) -> _Floats:
        return self._packing.packed(self._packing.first)

    def after(self, memory: _Floats, _: _Floats, fresh: _Floats) -> _After:
        now = self._packing.unpacked(memory)
        for sample in fresh.T.tolist():
            now = self.found.update(now, *sample)
        return self._packing.packed(now), partial(self.found.estimate, now)


class _Found(NamedTuple):
    """The memory of a method, the last values that were found, or the start, and their errors."""

    known: Known
    memory: Float[Array, " memory"]
    values: Float[Array, " values"]
    errors: Float[Array, " values"]
    status: Int[Array, ""]
    skipped: Int[Array, ""]


class OfNumpy(Identifier):
    """A method of NumPy, called by `jax.pure_callback` for all runs of a batch in turn.

    It gives numbers by name: mu_max and slip_opt, and if it likes parameters of the curve that is
    asked for; NAME_se is the standard error of one. What it does not give is NaN. Where it raises
    what solvers raise, or gives no finite mu_max, the record counts as a failure, and the values
    before stay; where `update` raises, the memory does, too.
    """

    told: str = eqx.field(static=True)
    own: _OfBlocks | _OfSamples = eqx.field(static=True)

    FITS_LAST_RECORD = False
    RESETS = False

    def accepts(self, known: Known) -> str | None:
        if "mu_max" not in known.asked:
            return "it tells of the peak, and the slope is asked for"
        return needs_blocks(known) if isinstance(self.own, _OfBlocks) else None

    def init(self, known: Known, key: PRNGKeyArray) -> _Found:
        values, none = quantities(known.curve, known), jnp.int32(0)
        errors = jnp.full_like(values, jnp.nan)
        return as_arrays(_Found(known, jnp.asarray(self.own.first), values, errors, none, none))

    def update(self, state: _Found, record: Record) -> _Found:
        names = quantity_names(state.known.curve)

        possible = jnp.isfinite(record.slip) & (jnp.abs(record.adhesion) <= LARGEST)
        fresh = record.fresh & possible
        points = jnp.stack([record.slip, record.adhesion, 1.0 * record.mask, 1.0 * fresh])
        memory, told = for_every_run(
            partial(self._of_run, names), (state.memory.size, 2 * len(names)), state.memory, points
        )
        values, errors = told.reshape(2, -1)
        mu_max = values[names.index("mu_max")]
        finite = jnp.isfinite(mu_max)
        status = jnp.select(
            [~finite, mu_max <= 0],
            [jnp.int32(Status.NOT_FINITE), jnp.int32(Status.INADMISSIBLE)],
            jnp.int32(Status.TRUSTED),
        )
        values, errors = (
            jnp.where(finite, new, old)
            for new, old in ((values, state.values), (errors, state.errors))
        )
        skipped = jnp.sum(record.fresh & ~possible, dtype=jnp.int32)
        return _Found(state.known, memory, values, errors, status, skipped)

    def estimate(self, state: _Found) -> Estimate:
        nothing, none = jnp.asarray(jnp.nan), jnp.zeros((), dtype=bool)
        return Estimate(
            OrderedDict(zip(quantity_names(state.known.curve), state.values, strict=True)),
            jnp.diag(state.errors**2),
            state.status,
            nothing,
            none,
            nothing,
            jnp.int32(1),
            state.skipped,
        )

    def _of_run(
        self,
        names: tuple[str, ...],
        memory: _Floats,
        points: _Floats,
    ) -> tuple[_Floats, _Floats]:
        """The memory after a record; values and standard errors by these names, or NaN."""
        *measured, mask, fresh = points
        block, new = (np.stack(measured)[:, chosen > 0] for chosen in (mask, fresh))
        try:
            memory, tell = self.own.after(memory, block, new)
            found = tell()
            numbers = [[found.get(f"{n}{end}", np.nan) for n in names] for end in ("", "_se")]
            return memory, np.array(numbers, float)
        except _FAILURES:
            pass
        except Exception as error:  # of whatever the method does
            blame(_words(self.told, self.own.found, error))
        return memory, np.full((2, len(names)), np.nan)


def raised(told: str, found: Any, error: Exception) -> str:
    """What a method did wrong, and in which line of its file."""
    code = getattr(getattr(found, "update", found), "__code__", None)
    file = getattr(code, "co_filename", None)
    own = [line for frame, line in walk_tb(error.__traceback__) if frame.f_code.co_filename == file]
    place = f" in line {own[-1]} of {file}" if own else ""
    words = " ".join(str(error).split()).rstrip(".")
    kind = type(error).__name__
    return f"{told} cannot be used as a method: it raises {kind}{place} ({words})."


def _words(told: str, found: Any, error: Exception) -> str:
    """What a method did wrong, and what one must have."""
    return (
        f"{raised(told, found, error)} A function takes the slips and the adhesions of a block as "
        "arrays of NumPy and gives numbers by name, such as mu_max and slip_opt. A class has "
        "init(), update(state, slip, adhesion), which gives the next state, and estimate(state), "
        "which gives such numbers; a state is made of numbers and of arrays that keep their shapes."
    )


def of_numpy(told: str, found: Any) -> OfNumpy:
    """The method that a function, a class or an object is, after a trial on a curve without noise.

    InputError, which names it as `told`, where it does not give what it must.
    """
    try:
        if inspect.isfunction(found):
            own: _OfBlocks | _OfSamples = _OfBlocks(found)
        else:
            lacking = [name for name in PARTS if not callable(getattr(found, name, None))]
            if lacking:
                raise TypeError(f"it lacks {listed(lacking)}")
            own = _OfSamples(found() if inspect.isclass(found) else found)
        slip = np.linspace(0.001, 0.15, 200)
        points = np.stack([slip, 0.4 * (1 - np.exp(-60 * slip)) - 0.5 * slip])
        right = np.isfinite(float(own.after(own.first, points, points)[1]()["mu_max"]))
    except Exception as error:  # of whatever the method does
        raise InputError(_words(told, found, error)) from error
    if not right:
        raise InputError(f"{told} finds no finite mu_max on 200 points of a curve without noise.")
    return OfNumpy(told, own)
