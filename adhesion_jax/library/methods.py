"""Identifiers by their names, as the functions of the library are given them."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import IDENTIFIERS, Identifier
from adhesion_jax.plugins import made
from adhesion_jax.wording import listed

#: Names of IDENTIFIERS, or methods of one's own by name: objects, classes or functions.
Methods: TypeAlias = str | Sequence[object] | Mapping[str, Any]


def called(own: object) -> str:
    """How a part of a list is told that is no name."""
    return own if isinstance(own, str) else str(getattr(own, "__name__", type(own).__name__))


def methods_named(identifiers: Methods) -> Mapping[str, Identifier]:
    """The identifiers by name; InputError for a name that there is not, for none, or for no method.

    A function of the slips and the adhesions of a block, or a class of NumPy that takes samples, is
    a method, too (`OfNumpy`).
    """
    if isinstance(identifiers, Mapping):
        taken = [name for name, own in identifiers.items() if IDENTIFIERS.get(name, own) is not own]
        if taken:
            raise InputError(
                f"{listed(taken)} is the name of a method of the package; name yours otherwise."
            )
        return {name: made("identifier", name, own) for name, own in identifiers.items()}
    names: list[Any] = [identifiers] if isinstance(identifiers, str) else [*identifiers]
    unknown = [called(one) for one in names if one not in IDENTIFIERS]
    if unknown or not names:
        raise InputError(
            f"There is no identifier {listed(unknown) if unknown else 'named'}; name some of "
            f"{', '.join(IDENTIFIERS)}, or give methods of your own by name: {{'mine': Mine()}}."
        )
    return {name: IDENTIFIERS[name] for name in names}
