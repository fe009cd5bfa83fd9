"""What the numbers of a job depend on, beside what is asked for."""

from collections.abc import Mapping
from hashlib import sha256
from importlib.metadata import version
from typing import Any

import jax
import numpy as np

from adhesion_jax import keeping, programs, runtime


def surroundings() -> Mapping[str, str]:
    """The package, the libraries and the machine, by what a user calls them."""
    return {
        "source of adhesion-jax": keeping.of_package(),
        **{f"version of {name}": version(name) for name in runtime.PACKAGES},
        "kind of processor or settings of jax": programs.digest(),
    }


def own_files() -> Mapping[str, str]:
    """The files of the user's own that are in use."""
    return {"source of your own files": keeping.of_outside()}


def settings_of(part: Any) -> str:
    """The numbers and the form of a part, or of several, in a number of fixed length."""
    leaves, form = jax.tree.flatten(part)
    stable = programs.stable_key(form)
    content = sha256(stable.content if stable else type(part).__qualname__.encode())
    for leaf in map(np.asarray, leaves):
        content.update(f"{leaf.dtype} {leaf.shape}".encode() + leaf.tobytes())
    return content.hexdigest()
