"""Laws that are called with numbers answer in double precision, whatever jax is set to."""

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np


def precise_of_numbers(method: Callable[..., Any]) -> Callable[..., Any]:
    """A method of a law and one or two arguments more, with numbers of NumPy in double precision.

    Where the law or an argument has an array of jax, traced or not, it is the method itself, which
    then has the precision and the device of the program around it.
    """

    @wraps(method)
    def called(law: Any, first: Any, *more: Any) -> Any:
        if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves((law, first, more))):
            return method(law, first, *more)
        with jax.enable_x64(True), jax.ensure_compile_time_eval():
            given = first if isinstance(first, Mapping) else jnp.asarray(first)
            found = method(law, given, *more)
        return jax.tree.map(lambda leaf: np.asarray(leaf)[()], found)

    return called
