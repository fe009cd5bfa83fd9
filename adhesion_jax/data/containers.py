"""Files that hold a table in another form than text, by the libraries that know their formats."""

import csv
import io
import json
import logging
import subprocess
import sys
import zipfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from io import BufferedIOBase
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.io import loadmat

from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed

SPREADSHEETS = (".xlsx", ".xlsm", ".xls", ".ods")

#: How many names of what is not read are told.
_TOLD = 5

#: A library that reads longer than this, with the size of the file, will never end.
_LEAST_S, _BYTES_A_SECOND = 60.0, 1e6


class Framed(NamedTuple):
    """The columns of a file, and what is said of how they were put together."""

    frame: pd.DataFrame
    said: str


class Vector(NamedTuple):
    """Values of one quantity and their times, both [samples]; no times where the file has none."""

    name: str  # with those of its groups before it, divided by /
    unit: str
    values: np.ndarray
    time: np.ndarray = np.empty(0)


def _library(module: str, path: Path) -> Any:
    """A library that reads files like this one; InputError tells how to install it."""
    try:
        return import_module(module)
    except ImportError:
        raise InputError(
            f"{path} needs the package {module.replace('_', '-')}, which is not installed; "
            "install it by pip install 'adhesion-jax[files]', or save the table as "
            "comma-separated text."
        ) from None


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
    calamine = _library("python_calamine", path)
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


def _matlab(path: Path) -> Framed:
    """The vectors of a MATLAB file, of fields of structures too."""
    with _whole(path, "MATLAB file"):
        try:
            content = loadmat(path, simplify_cells=True)
        except NotImplementedError:  # version 7.3 is HDF5
            return _hdf(path)
        own = {name: value for name, value in content.items() if not name.startswith("__")}
        return _of_one_length(path, _fields(own))


def _fields(values: Mapping[str, Any], before: str = "") -> Iterator[Vector]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _fields(value, f"{before}{name}/")
        else:
            yield Vector(f"{before}{name}", "", np.asarray(value))


def _hdf(path: Path) -> Framed:
    """The vectors of an HDF5 file, with the units of their attributes."""
    h5py = _library("h5py", path)
    found: list[Vector] = []

    def add(name: str, one: Any) -> None:
        # MATLAB keeps what its cells refer to in #refs#, and its text as numbers.
        is_text = one.attrs.get("MATLAB_class") == b"char"
        if not isinstance(one, h5py.Dataset) or name.startswith("#") or is_text:
            return
        values = (one.asstr() if h5py.check_string_dtype(one.dtype) else one)[()]
        if one.dtype.names:  # a table
            found.extend(Vector(f"{name}/{key}", "", values[key]) for key in one.dtype.names)
            return
        unit = one.attrs.get("units", one.attrs.get("unit", ""))
        unit = unit.decode(errors="replace") if isinstance(unit, bytes) else str(unit)
        found.append(Vector(name, unit, np.asarray(values)))

    with _whole(path, "HDF5 file"), h5py.File(path, "r") as file:
        file.visititems(add)
    return _of_one_length(path, found)


def _of_one_length(path: Path, vectors: Iterable[Vector]) -> Framed:
    """The vectors that have the length of most of them, as columns; what is not read is told."""
    usable = [one for one in vectors if _is_vector(one.values)]
    if not usable:
        how = " (a table by table2struct(T, 'ToScalar', true))" if path.suffix == ".mat" else ""
        raise InputError(
            f"{path} has no vectors; save one of each quantity, all of one length{how}."
        )
    length = Counter(one.values.size for one in usable).most_common(1)[0][0]
    used = [one for one in usable if one.values.size == length]
    other = [one.name for one in usable if one.values.size != length]
    said = f"{len(used)} vectors of length {length:,}"
    if other:
        said += f", and {len(other)} of other lengths that are not read: {listed(other[:_TOLD])}"
    columns = {name: _native(one.values) for name, one in _named(used).items()}
    return Framed(pd.DataFrame(columns), said)


def _is_vector(values: np.ndarray) -> bool:
    return values.size > 1 and values.size == max(values.shape) and values.dtype.kind in "biufOSU"


def _native(values: np.ndarray) -> np.ndarray:
    """A vector in one dimension, of types that every machine has, and bytes as text."""
    values = values.ravel()
    if values.dtype.kind == "S":
        return np.char.decode(values, "utf-8", "replace")
    return values.astype(float if values.dtype.kind == "f" else values.dtype.newbyteorder("="))


def _named(vectors: Sequence[Vector]) -> dict[str, Vector]:
    """The vectors by name and unit, with their groups only where the name stands there twice."""
    short = Counter(one.name.rpartition("/")[2] for one in vectors)
    found = {}
    for one in vectors:
        last = one.name.rpartition("/")[2]
        name = last if short[last] == 1 else one.name
        found[f"{name} [{one.unit}]" if one.unit else name] = one
    return found


def _mdf(path: Path) -> Framed:
    """The channels of an MDF file on one time."""
    _library("asammdf", path)
    with TemporaryDirectory() as folder, _whole(path, "MDF file"):
        out = Path(folder) / "channels.npz"
        script = Path(__file__).with_name("mdf_channels.py")
        # -P: the script shall not find the modules beside it in the place of those of libraries.
        done = subprocess.run(
            [sys.executable, "-P", str(script), str(path), str(out)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=_LEAST_S + path.stat().st_size / _BYTES_A_SECOND,
            check=False,
        )
        if done.returncode:
            raise ValueError(done.stdout.decode(errors="replace") or "asammdf breaks down")
        with np.load(out) as arrays:
            found = [
                Vector(name, unit, arrays[f"values {i}"], arrays[f"time {i}"])
                for i, (name, unit) in enumerate(json.loads(str(arrays["names"])))
            ]
    return _on_one_time(path, found)


def _tdms(path: Path) -> Framed:
    """The channels of a TDMS file: on one time where each has a step of its own."""
    nptdms = _library("nptdms", path)
    nptdms.log.log_manager.set_level(logging.ERROR)  # it would print the bytes that are damaged
    with _whole(path, "TDMS file"):
        found = [
            Vector(
                f"{group.name}/{one.name}",
                str(one.properties.get("unit_string", "")),
                np.asarray(one[:]),
                one.time_track() if one.properties.get("wf_increment") else np.empty(0),
            )
            for group in nptdms.TdmsFile.read(path).groups()
            for one in group.channels()
        ]
    return _on_one_time(path, found)


def _on_one_time(path: Path, vectors: Sequence[Vector]) -> Framed:
    """Signals on the times of those that have most samples.

    Numbers of a slower one are put there by straight lines; whole numbers, which may be states, and
    text have the value before. Before its first and after its last sample a signal has no value.
    """
    usable = [one for one in vectors if _is_vector(one.values)]
    timed = [one for one in usable if one.time.size == one.values.size]
    if len(timed) < len(usable) or not usable:
        return _of_one_length(path, usable)
    clock = max((one.time for one in timed), key=lambda time: time.size)
    columns = {"time [s]": clock}
    for name, one in _named(timed).items():
        columns[name] = _at(clock, one.time, _native(one.values))
    said = f"{len(timed)} channels"
    rates = len({one.time.size for one in timed})
    if rates > 1:
        said += (
            f" of {rates} rates, on the times of those that have most samples: the others by "
            "straight lines, and whole numbers and text by the value before"
        )
    return Framed(pd.DataFrame(columns), said)


def _at(clock: np.ndarray, own: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The values of a signal at the times of another."""
    if np.array_equal(own, clock):
        return values
    if values.dtype.kind == "f":
        found: np.ndarray = np.interp(clock, own, values, np.nan, np.nan)
        return found
    place = np.searchsorted(own, clock, side="right") - 1
    there = (place >= 0) & (clock <= own[-1])
    is_number = values.dtype.kind in "biu"
    held = values.astype(float if is_number else object)[np.maximum(place, 0)]
    return np.where(there, held, np.nan if is_number else "")


def _feather(path: Path) -> Framed:
    with _whole(path, "feather file"):
        return Framed(pd.read_feather(path), "")


#: What reads the files of an ending as a frame.
FRAMED: Mapping[str, Callable[[Path], Framed]] = {
    ".mat": _matlab,
    ".h5": _hdf,
    ".hdf5": _hdf,
    ".mf4": _mdf,
    ".mdf": _mdf,
    ".tdms": _tdms,
    ".feather": _feather,
}
