"""What results share: numbers that mean the same in a program of another precision, and HTML."""

import html
import json
import re
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from inspect import signature
from os import PathLike
from pathlib import Path
from typing import Any, ParamSpec, Protocol, TypeVar, runtime_checkable

import jax
import numpy as np
import pandas as pd

from adhesion_jax import runtime
from adhesion_jax.data import Measured
from adhesion_jax.errors import InputError
from adhesion_jax.files import METADATA, output_directory, staged, write_metadata

P = ParamSpec("P")
T = TypeVar("T")
Columns = Mapping[str, object]

#: The options of a command in a sentence, and the arguments of a function that say the same.
_ARGUMENTS = {
    r'--column "([^"=]+)=([^"]*)"': r'columns={"\1": "\2"}',
    r"--delay (\w+)=([\d.]+)": r'delays={"\1": \2}',
    r"--axles\b": "axles=True",
    r"--whole\b": "events=False",
    r"--events\b": "events",
    r"--wheel-radius\b": "wheel_radius",
    r"--gear-ratio\b": "gear_ratio",
}


@runtime_checkable
class _Writes(Protocol):
    def write(self, folder: Path) -> None: ...


W = TypeVar("W", bound=_Writes)


def columns_of(tables: Sequence[Measured]) -> Columns:
    """The columns of each table as they were understood, for JSON, which has null for NaN."""
    return {one.name: json.loads(one.understood.to_json(orient="records")) for one in tables}


def written(
    found: W,
    out: str | PathLike[str] | None,
    files: Sequence[str],
    columns: Columns,
    **told: object,
) -> W:
    """The result, whose files, of which these are possible, are in the folder `out` if it is named.

    They appear there when all are complete, in the place of those of an earlier result, with the
    columns of its tables, what else is `told`, and what it was made with.
    """
    if out is not None:
        with staged(output_directory(Path(out)), files) as stage:
            found.write(stage)
            write_metadata(stage / METADATA, {"columns": columns, **told, **runtime.describe()})
    return found


def recorded(function: Callable[P, T]) -> Callable[P, T]:
    """The function, whose name and arguments are told beside the files in the folder `out`.

    Where something is to be said of the data it is told by arguments of the function; of tables
    that a command has read (`Measured`) by its options.
    """

    @wraps(function)
    def told(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            found = function(*args, **kwargs)
        except InputError as error:
            given = [one for part in args for one in (part if isinstance(part, list) else [part])]
            sentence = str(error)
            if not any(isinstance(one, Measured) for one in given):
                for option, argument in _ARGUMENTS.items():
                    sentence = re.sub(option, argument, sentence)
            raise InputError(sentence) from None
        arguments = signature(function).bind(*args, **kwargs).arguments
        if arguments.get("out") is not None:
            folder = Path(arguments["out"])
            call = {"function": function.__name__, "arguments": _as_json(arguments)}
            known = json.loads((folder / METADATA).read_text(encoding="utf-8"))
            with staged(folder, [METADATA]) as stage:
                write_metadata(stage / METADATA, {"call": call, **known})
        return found

    return told


def _as_json(arguments: Mapping[str, object]) -> object:
    """Arguments as JSON has them: what is neither number nor text by the name of its class."""

    def told(value: object) -> str:
        return str(value) if isinstance(value, PathLike) else type(value).__name__

    return json.loads(json.dumps(arguments, default=told))


def of_numbers(result: T) -> T:
    """The result with numbers of Python and arrays of NumPy in place of arrays of jax.

    Those lose digits when they are read where jax is in single precision, and a law made of them
    cannot be called in another precision.
    """

    def without_jax(leaf: Any) -> Any:
        if not isinstance(leaf, (jax.Array, np.generic)):
            return leaf
        return np.asarray(leaf) if leaf.ndim else leaf.item()

    found: T = jax.tree.map(without_jax, result)
    return found


def text_html(text: str) -> str:
    return f"<pre style='white-space: pre-wrap'>{html.escape(text)}</pre>"


def aligned(table: pd.DataFrame, width: int | None = None) -> str:
    """A table for a terminal, with cells of at most this width."""
    return table.to_string(
        index=False, float_format=lambda x: f"{x:.4g}", na_rep="", max_colwidth=width
    )


def steps_told(steps: int, seconds: float, compile_seconds: float) -> str:
    """What plant steps took, all processes together."""
    return (
        f"{steps:.3g} plant steps in {seconds:.0f} CPU-seconds ({steps / seconds / 1e6:.1f} "
        f"million a CPU-second), compiled in {compile_seconds:.0f} s"
    )
