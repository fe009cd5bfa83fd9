"""The channels of an MDF file as arrays in an .npz file: a program of its own.

Code in C of asammdf ends the process at some files that are damaged, or never ends itself; whoever
starts this program outlives that. Call: python mdf_channels.py LOG OUT. Status 1, and the error of
the library, where it finds one.
"""

import json
import os
import sys

import asammdf
import numpy as np


def main(log: str, out: str) -> None:
    """Writes the times and values of each channel, and their names and units as JSON."""
    arrays: dict[str, np.ndarray] = {}
    names: list[tuple[str, str]] = []
    with asammdf.MDF(log) as file:
        for number, group in enumerate(file.groups):
            for index in range(len(group.channels)):
                if index == file.masters_db.get(number):
                    continue
                one = file.get(group=number, index=index)
                if one.samples.ndim == 1 and one.samples.dtype.kind in "biufS":
                    arrays[f"time {len(names)}"] = one.timestamps
                    arrays[f"values {len(names)}"] = one.samples
                    place = f"{group.channel_group.acq_name or number}/{one.name}"
                    names.append((place, one.unit or ""))
    np.savez(out, names=np.array(json.dumps(names)), **arrays)  # type: ignore[arg-type]


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except Exception as error:
        print(str(error) or type(error).__name__, flush=True)
        os._exit(1)  # half-made objects of the library would tell of errors when they go
