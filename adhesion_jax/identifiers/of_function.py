"""A method that is a function of NumPy: it need know nothing of jax."""

from collections import OrderedDict
from collections.abc import Callable, Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray
from numpy.typing import NDArray

from adhesion_jax.errors import InputError
from adhesion_jax.identifiers.base import Estimate, Identifier, Status, as_arrays, needs_blocks
from adhesion_jax.metrics.information import quantities, quantity_names
from adhesion_jax.records import Known, Record

#: Slips and adhesions of the points of a block to numbers by name.
Function = Callable[[NDArray[np.float64], NDArray[np.float64]], Mapping[str, float]]

#: What a solver raises where it finds nothing (`scipy.optimize.curve_fit`, `numpy.linalg`).
_FAILURES = (RuntimeError, ArithmeticError, ValueError)


class _Found(NamedTuple):
    """The last values that were found, or the start, and their standard errors."""

    known: Known
    values: Float[Array, " values"]
    errors: Float[Array, " values"]
    status: Int[Array, ""]


class OfFunction(Identifier):
    """`function(slip, adhesion)` of each block by itself, called by `jax.pure_callback`.

    It gives numbers by name: mu_max and slip_opt, and if it likes parameters of the curve that is
    asked for; NAME_se is the standard error of one. What it does not give is NaN. Where it raises
    what solvers raise, or gives no finite mu_max, the block counts as a failure and the values
    before it stay.
    """

    function: Function = eqx.field(static=True)

    FITS_LAST_RECORD = False
    RESETS = False

    def accepts(self, known: Known) -> str | None:
        return needs_blocks(known)

    def init(self, known: Known, key: PRNGKeyArray) -> _Found:
        values = quantities(known.curve, known)
        return as_arrays(_Found(known, values, jnp.full_like(values, jnp.nan), jnp.int32(0)))

    def update(self, state: _Found, record: Record) -> _Found:
        names = quantity_names(state.known.curve)
        numbers = jax.ShapeDtypeStruct((2, len(names)), state.values.dtype)

        def called(*points: Array) -> NDArray[np.float64]:
            slip, adhesion, mask = map(np.asarray, points)
            return self._of_block(slip[mask], adhesion[mask], names)

        of_block = (record.slip, record.adhesion, record.mask)
        values, errors = jax.pure_callback(called, numbers, *of_block, vmap_method="sequential")
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
        return _Found(state.known, values, errors, status)

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
            jnp.int32(0),
        )

    def _of_block(
        self, slip: NDArray[np.float64], adhesion: NDArray[np.float64], names: tuple[str, ...]
    ) -> NDArray[np.float64]:
        """Values and standard errors by these names, NaN where there are none."""
        try:
            found = self.function(slip, adhesion)
        except _FAILURES:
            found = {}
        of = [[found.get(f"{name}{end}", np.nan) for name in names] for end in ("", "_se")]
        return np.array(of, float)


def of_function(told: str, function: Function) -> OfFunction:
    """The method, after a trial on a curve without noise.

    InputError, which names the function as `told`, where it does not give what it must.
    """
    slip = np.linspace(0.001, 0.15, 200)
    adhesion = 0.4 * (1 - np.exp(-60 * slip)) - 0.5 * slip
    try:
        found = function(slip, adhesion)
        right = np.isfinite(float(found["mu_max"]))
    except Exception as error:  # of whatever the function does
        words = " ".join(str(error).split()).rstrip(".")
        raise InputError(
            f"{told} cannot be used as a method: on 200 points of a curve it raises "
            f"{type(error).__name__}: {words}. A function takes the slips and the adhesions of a "
            "block as arrays of NumPy, and gives numbers by name, such as mu_max and slip_opt."
        ) from error
    if not right:
        raise InputError(f"{told} finds no finite mu_max on 200 points of a curve without noise.")
    return OfFunction(function)
