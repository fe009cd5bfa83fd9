"""Files that hold a table in another form than text, by the libraries that know their formats."""

import csv
import io
import json
import subprocess
import sys
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.util import find_spec
from io import BufferedIOBase
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd

from adhesion_jax.data import vectors
from adhesion_jax.data.stretches import longest_step
from adhesion_jax.data.vectors import Vector
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed

SPREADSHEETS = (".xlsx", ".xlsm", ".xls", ".ods")

#: How many names of what is not read are told.
_TOLD = 5

#: A clock is even if nine steps in ten are at most this multiple of the median step. By hand.
_EVEN = 2.0

#: A library that reads longer than this, with the size of the file, will never end.
_LEAST_S, _BYTES_A_SECOND = 60.0, 1e6


#: The columns of a file, and what is said of how they were put together.
Framed = tuple[pd.DataFrame, str]


def _lacking(package: str, path: Path) -> InputError:
    """What is said where the package that reads files like this one is not installed."""
    return InputError(
        f"{path} needs the package {package}, which is not installed; install it by "
        "pip install 'adhesion-jax[files]', or save the table as comma-separated text."
    )


@contextmanager
def _whole(path: Path, kind: str) -> Iterator[None]:
    """InputError in the place of whatever a library raises at a file that is damaged."""
    try:
        yield
    except InputError:
        raise
    except Exception as error:  # each library has errors of its own, and some of Python's
        reason = (str(error).splitlines() or [""])[0][:120] or type(error).__name__
        raise InputError(f"{path} is not a whole {kind} ({reason.rstrip('.')}).") from None


def spreadsheet(path: Path) -> tuple[bytes, str]:
    """The largest sheet of a workbook as text with tabs, and its name."""
    if find_spec("python_calamine") is None:
        raise _lacking("python-calamine", path)
    calamine = import_module("python_calamine")
    with _whole(path, "spreadsheet"):
        book = calamine.CalamineWorkbook.from_filelike(io.BytesIO(path.read_bytes()))
        sheets = {name: book.get_sheet_by_name(name) for name in book.sheet_names}
        name = max(sheets, key=lambda one: sheets[one].total_height * sheets[one].total_width)
        rows = sheets[name].to_python(skip_empty_area=False)
    text = io.StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    writer.writerows([_cell(one) for one in row] for row in rows)
    return text.getvalue().encode(), name


def _cell(value: object) -> object:
    """A date and time as text, and all else as it is."""
    stamped = getattr(value, "isoformat", None)
    return value if stamped is None else stamped().replace("T", " ")


def zipped(path: Path, endings: tuple[str, ...]) -> BufferedIOBase:
    """The one table of text in a zip file."""
    with _whole(path, "zip file"):
        whole = zipfile.ZipFile(path)
        names = [
            one
            for one in whole.namelist()
            if one.lower().endswith(endings) and not one.startswith("__MACOSX/")
        ]
        if len(names) == 1:
            return whole.open(names[0])  # type: ignore[return-value]
    there = listed(names[:_TOLD]) if names else "none"
    raise InputError(f"{path} must hold one table of text, and has {there}; unpack it.")


def _vectors(path: Path) -> tuple[list[Vector], list[str]]:
    """What the program `vectors` finds in a file, and the names of what it does not read."""
    with TemporaryDirectory() as folder, _whole(path, f"{path.suffix} file"):
        out = Path(folder) / "vectors.npz"
        # -P: it shall not find the modules beside it in the place of those of libraries.
        done = subprocess.run(
            [sys.executable, "-P", vectors.__file__, path.absolute(), out],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=_LEAST_S + path.stat().st_size / _BYTES_A_SECOND,
            check=False,
        )
        told = done.stdout.decode(errors="replace").strip()
        if done.returncode == 2:
            raise _lacking(told, path)
        if done.returncode:
            raise ValueError(told or "the library that reads it breaks down")
        with np.load(out) as arrays:
            names, unread = json.loads(str(arrays["told"]))
            return [
                Vector(name, unit, arrays[f"values {i}"], arrays[f"time {i}"])
                for i, (name, unit) in enumerate(names)
            ], unread


def _of_one_length(path: Path, found: Sequence[Vector]) -> Framed:
    """The vectors that have the length of most of them, as columns; what is not read is told."""
    if not found:
        how = " (a table by table2struct(T, 'ToScalar', true))" if path.suffix == ".mat" else ""
        raise InputError(
            f"{path} has no vectors; save one of each quantity, all of one length{how}."
        )
    length = Counter(one.values.size for one in found).most_common(1)[0][0]
    used = [one for one in found if one.values.size == length]
    other = [one.name for one in found if one.values.size != length]
    said = f"{len(used)} vectors of length {length:,}"
    if other:
        said += f", and {len(other)} of other lengths that are not read: {listed(other[:_TOLD])}"
    return pd.DataFrame({name: one.values for name, one in _named(used).items()}), said


def _named(found: Sequence[Vector]) -> dict[str, Vector]:
    """The vectors by name and unit, with their groups only where the name stands there twice."""
    short = Counter(one.name.rpartition("/")[2] for one in found)
    columns = {}
    for one in found:
        last = one.name.rpartition("/")[2]
        name = last if short[last] == 1 else one.name
        columns[f"{name} [{one.unit}]" if one.unit else name] = one
    return columns


def _framed(path: Path) -> Framed:
    """The vectors of a file as columns; what is not read is told."""
    found, unread = _vectors(path)
    frame, said = _together(path, found)
    if unread:
        said += (
            "; what is no vector of real numbers, text or dates is not read: "
            f"{listed(unread[:_TOLD])}{' ...' if unread[_TOLD:] else ''}"
        )
    return frame, said


def _together(path: Path, found: Sequence[Vector]) -> Framed:
    """Vectors as columns, on the times of those that have most samples.

    Numbers of a slower one are put there by straight lines; whole numbers, which may be states, and
    text have the value before. Before its first and after its last sample a signal has no value,
    nor in a gap; but a state that is only sent when it changes holds until then.
    """
    timed = [one for one in found if one.time.size == one.values.size]
    if len(timed) < len(found) or not found:
        return _of_one_length(path, found)
    clock = max((one.time for one in timed), key=lambda time: time.size)
    own = {name: _at(clock, one.time, one.values) for name, one in _named(timed).items()}
    said = f"{len(timed)} channels"
    clocks = len({one.time.tobytes() for one in timed})
    if clocks > 1:
        said += (
            f" with {clocks} clocks, on the times of those that have most samples: the others by "
            "straight lines, and whole numbers and text by the value before"
        )
    return pd.DataFrame({"time [s]": clock, **own}), said


def _at(clock: np.ndarray, own: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The values of a signal at the times of another."""
    if np.array_equal(own, clock):
        return values
    steps = np.diff(own, append=own[-1])
    gaps = steps > longest_step(own, np.zeros(own.size))
    is_straight, is_text = values.dtype.kind == "f", values.dtype.kind not in "fbiu"
    if not is_straight and np.quantile(steps, 0.9) > _EVEN * np.median(steps):
        gaps[:] = False
    place = np.searchsorted(own, clock, side="right") - 1
    there = (place >= 0) & (clock <= own[-1]) & ~(gaps[place] & (clock > own[place]))
    if is_straight:
        return np.where(there, np.interp(clock, own, values), np.nan)
    held = values.astype(object if is_text else float)[np.maximum(place, 0)]
    return np.where(there, held, "" if is_text else np.nan)


def _feather(path: Path) -> Framed:
    with _whole(path, "feather file"):
        return pd.read_feather(path), ""


#: What reads the files of an ending as a frame.
FRAMED: Mapping[str, Callable[[Path], Framed]] = {
    **dict.fromkeys(vectors.READERS, _framed),
    ".feather": _feather,
}
