"""The vectors of a MATLAB, HDF5, MDF or TDMS file as an .npz file: a program of its own.

Code in C of the libraries ends the process at some files that are damaged, or never ends itself;
whoever starts this program outlives that. Call: python -P vectors.py LOG OUT. Status 1 and a line
where the file is not whole, 2 and the name of the package where one is lacking.
"""

import json
import logging
import os
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np


class Vector(NamedTuple):
    """Values of one quantity and their times, both [samples]; no times where the file has none."""

    name: str  # with those of its groups before it, divided by /
    unit: str
    values: np.ndarray
    time: np.ndarray = np.empty(0)


def _matlab(path: Path) -> Iterator[Vector]:
    from scipy.io import loadmat

    try:
        content = loadmat(path, simplify_cells=True)
    except NotImplementedError:  # version 7.3 is HDF5
        return _hdf(path)
    return _fields({name: value for name, value in content.items() if not name.startswith("__")})


def _fields(values: Mapping[str, Any], before: str = "") -> Iterator[Vector]:
    """The entries of structures, too."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _fields(value, f"{before}{name}/")
        else:
            yield Vector(f"{before}{name}", "", np.asarray(value))


def _hdf(path: Path) -> Iterator[Vector]:
    """Those of tables, too, and units from attributes."""
    import h5py

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

    with h5py.File(path, "r") as file:
        file.visititems(add)
    return iter(found)


def _mdf(path: Path) -> Iterator[Vector]:
    import asammdf

    with asammdf.MDF(str(path)) as file:
        for number, group in enumerate(file.groups):
            for index in range(len(group.channels)):
                if index != file.masters_db.get(number):
                    one = file.get(group=number, index=index)
                    place = f"{group.channel_group.acq_name or ''} {number}/{one.name}"
                    yield Vector(place, one.unit or "", one.samples, one.timestamps)


def _tdms(path: Path) -> Iterator[Vector]:
    """With times where a channel has a step, from where the first of all channels starts."""
    import nptdms
    from nptdms.log import log_manager

    log_manager.set_level(logging.ERROR)
    channels = [one for group in nptdms.TdmsFile.read(path).groups() for one in group.channels()]
    starts = [one.properties.get("wf_start_time") for one in channels]
    first = min((start for start in starts if start is not None), default=None)
    for one, start in zip(channels, starts, strict=True):
        times = []
        if one.properties.get("wf_increment"):
            late = 0.0 if start is None else (start - first) / np.timedelta64(1, "s")
            times = [one.time_track() + late]
        unit = str(one.properties.get("unit_string", ""))
        yield Vector(f"{one.group_name}/{one.name}", unit, np.asarray(one[:]), *times)


#: By ending: what reads a file.
READERS = {".mat": _matlab, ".h5": _hdf, ".hdf5": _hdf, ".mf4": _mdf, ".mdf": _mdf, ".tdms": _tdms}


def _native(values: np.ndarray) -> np.ndarray:
    """A vector in one dimension, of types that every machine has; text and stamps as text."""
    values = values.ravel()
    if values.dtype.kind == "S":
        return np.char.decode(values, "utf-8", "replace")
    if values.dtype.kind in "OM":
        return values.astype(str)
    return values.astype(float if values.dtype.kind == "f" else values.dtype.newbyteorder("="))


def main(log: Path, out: Path) -> None:
    """Writes names and units as JSON, and values and times by their number.

    With the names of what has several values and is no vector of numbers, text or stamps.
    """
    told: list[tuple[str, str]] = []
    unread: list[str] = []
    arrays: dict[str, np.ndarray] = {}
    for name, unit, values, time in READERS[log.suffix.lower()](log):
        is_vector = values.size > 1 and values.size == max(values.shape)
        if is_vector and values.dtype.kind in "biufOSUM":
            arrays[f"values {len(told)}"] = _native(values)
            arrays[f"time {len(told)}"] = time
            told.append((name, unit))
        elif values.size > 1:
            unread.append(name)
    arrays["told"] = np.array(json.dumps([told, unread]))
    np.savez(out, **arrays)  # type: ignore[arg-type]


if __name__ == "__main__":
    try:
        main(*map(Path, sys.argv[1:]))
    except ImportError as error:
        print(error.name)
        sys.exit(2)
    except Exception as error:  # each library has errors of its own, and some of Python's
        print((str(error).splitlines() or [type(error).__name__])[0], flush=True)
        os._exit(1)  # half-made objects of a library would tell of errors when they go
