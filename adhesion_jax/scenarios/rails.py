"""The rails of He et al. 2018, Table 1, and what its experiments tell the identifiers."""

from collections.abc import Mapping

import jax.numpy as jnp

from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.errors import InputError
from adhesion_jax.scenarios.base import Known

RAILS: Mapping[str, Burckhardt] = {
    "dry": Burckhardt(c1=0.8287, c2=45.45, c3=0.4),
    "common": Burckhardt(c1=0.32, c2=25.0, c3=0.1),
    "wet": Burckhardt(c1=0.165, c2=15.0, c3=0.1),
}

#: Start of Experiment 2 and search range of Table 2.
HE2018 = Known(
    curve=Burckhardt(c1=0.5, c2=30.0, c3=0.08),
    lower=jnp.array([0.1, 10.0, 0.05]),
    upper=jnp.array([1.0, 50.0, 0.5]),
)


def rail_named(name: str) -> Burckhardt:
    if name not in RAILS:
        raise InputError(f"--rail {name} is unknown; the rails are {', '.join(RAILS)}.")
    return RAILS[name]
