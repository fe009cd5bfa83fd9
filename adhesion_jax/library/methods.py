"""Identifiers by their names, as the functions of the library are given them."""

from collections.abc import Mapping, Sequence

from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import IDENTIFIERS, Identifier
from adhesion_jax.wording import listed


def methods_named(identifiers: str | Sequence[str]) -> Mapping[str, Identifier]:
    """The identifiers of these names; InputError for a name that there is not, or for none."""
    names = [identifiers] if isinstance(identifiers, str) else identifiers
    unknown = [name for name in names if name not in IDENTIFIERS]
    if unknown or not names:
        raise InputError(
            f"There is no identifier {listed(unknown) if unknown else 'named'}; name some of "
            f"{', '.join(IDENTIFIERS)}, or give methods of your own by name: {{'mine': Mine()}}."
        )
    return {name: IDENTIFIERS[name] for name in names}
