"""A plant from a TOML file of its parameters: each with value and unit, tag and source."""

import math
import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from adhesion_jax.data.columns import Conversion, conversion
from adhesion_jax.errors import InputError
from adhesion_jax.traction.plants import MODELS
from adhesion_jax.traction.plants.base import Plant, Quantity, quantities

#: The entries of a parameter in a file.
_KEYS = ("value", "unit", "tag", "source")

#: Where a value comes from.
TAGS: Mapping[str, str] = {
    "P": "printed in the source",
    "D": "derived from what is printed",
    "C": "found elsewhere",
    "K": "commonly quoted, not confirmed",
    "A": "assumed",
}


class Given(NamedTuple):
    """A parameter as a file gives it."""

    value: tuple[float, ...]
    unit: str
    tag: str
    source: str


class PlantFile(NamedTuple):
    """A plant, its title, and the entries of its parameters."""

    title: str
    plant: Plant
    given: Mapping[str, Given]


def shipped() -> Mapping[str, Path]:
    """The sets of parameters that come with the package, by name."""
    folder = Path(str(files("adhesion_jax.traction.plants")))
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def read_plant(path: Path) -> PlantFile:
    """The plant of a file; with `like`, a shipped plant with the parameters of the file replaced.

    With a `model` beside `like` it is one of that model, whose further parameters the file gives.

    Raises InputError, which names the file and the parameter, if the file gives no plant.
    """
    table = _with_what_it_is_like(path, _toml(path))
    if "model" not in table:
        raise InputError(
            f'{path} tells no train; name one that it is like, as like = "hxd1f", or a model, '
            f"{' or '.join(MODELS)}."
        )
    model = str(table["model"])
    if model not in MODELS:
        raise InputError(f"{path}: the model {model!r} is not known; name {' or '.join(MODELS)}.")
    kind, known = MODELS[model], quantities(MODELS[model])
    parameters = table.get("parameters")
    if not isinstance(parameters, dict):
        raise InputError(f"{path} has no [parameters]; give a table for each of {model}.")
    for key in {*table} - {"model", "title", "parameters"}:
        raise InputError(
            f"{path}: {key} is not known; a plant has model or like, title and parameters."
        )
    for name in parameters:
        if name not in known:
            close = get_close_matches(name, known, n=1)
            meant = f"did you mean {close[0]}" if close else f"{model} has {', '.join(known)}"
            raise InputError(f"{path}: parameter {name} is not known; {meant}.")
    for name, quantity in known.items():
        if name not in parameters:
            raise InputError(
                f"{path} lacks the parameter {name} ({quantity.meaning}); give it a value and the "
                f"unit {quantity.unit}."
            )
    given = {
        name: _given(path, name, parameters[name], quantity) for name, quantity in known.items()
    }
    return PlantFile(str(table.get("title", path.stem)), _plant(path, kind, given), given)


def _toml(path: Path) -> Mapping[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path} cannot be read ({error}); name a TOML file.") from None
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path} is no TOML file: {error}.") from None


def _with_what_it_is_like(path: Path, table: Mapping[str, Any]) -> Mapping[str, Any]:
    if "like" not in table:
        return table
    name = table["like"]
    if str(name) not in shipped():
        raise InputError(f"{path}: like {name!r} is not known; name {' or '.join(shipped())}.")
    base = _with_what_it_is_like(shipped()[name], _toml(shipped()[name]))
    own = table.get("parameters", {})
    if not isinstance(own, dict):
        raise InputError(f"{path} has no [parameters]; give a table for each that differs.")
    rest = {key: value for key, value in table.items() if key not in ("like", "parameters")}
    return {**base, **rest, "parameters": {**base["parameters"], **own}}


def _given(path: Path, name: str, table: object, quantity: Quantity) -> Given:
    if not isinstance(table, dict) or "value" not in table or "unit" not in table:
        raise InputError(
            f"{path}: parameter {name} needs a value and a unit, such as value = 1.0 and unit = "
            f'"{quantity.unit}".'
        )
    for key in {*table} - {*_KEYS}:
        raise InputError(f"{path}: parameter {name} has {key}; allowed are {', '.join(_KEYS)}.")
    unit, own = str(table["unit"]), quantity.unit
    into = Conversion(1.0, 0.0) if unit == own else conversion(unit, own)  # exact where it is one
    if into is None:
        raise InputError(
            f"{path}: parameter {name} is given in {table['unit']!r}, which is no unit of it; "
            f"write one such as {quantity.unit!r}."
        )
    given = table["value"] if isinstance(table["value"], list) else [table["value"]]
    values = []
    for value in given:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        values.append(into.factor * value + into.offset if number else math.nan)
        if not quantity.lower <= values[-1] <= quantity.upper:
            raise InputError(
                f"{path}: parameter {name} is {value!r} {table['unit']}; it must be a number from "
                f"{quantity.lower:g} to {quantity.upper:g} {quantity.unit}."
            )
    if not values:
        raise InputError(f"{path}: parameter {name} has no value; give at least one number.")
    tag, source = str(table.get("tag", "")), str(table.get("source", ""))
    if tag and tag not in TAGS:
        raise InputError(f"{path}: parameter {name} has the tag {tag}; use {', '.join(TAGS)}.")
    return Given(tuple(map(float, values)), quantity.unit, tag, source)


def _plant(path: Path, kind: type[Plant], given: Mapping[str, Given]) -> Plant:
    """The parameters of axles as arrays of the same length, the others as scalars."""
    differ = {name for name, quantity in quantities(kind).items() if quantity.per_axle}
    axles = math.lcm(1, *(len(given[name].value) for name in differ))
    numbers = {}
    for name, parameter in given.items():
        count = len(parameter.value)
        if name in differ and count in (1, axles):
            numbers[name] = jnp.asarray(np.broadcast_to(parameter.value, axles))
        elif name not in differ and count == 1:
            numbers[name] = jnp.asarray(parameter.value[0])
        else:
            right = f"one value or {axles}, one per axle" if name in differ else "one value"
            raise InputError(f"{path}: parameter {name} has {count} values; give {right}.")
    return kind(**numbers)
