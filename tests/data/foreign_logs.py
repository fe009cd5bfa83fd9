"""One log in the forms that loggers and people keep it in, written by the libraries of these."""

import zipfile
from functools import partial
from pathlib import Path

import asammdf
import h5py
import nptdms
import numpy as np
import pandas as pd
import scipy.io

ROWS = 200
TIME = 0.05 * np.arange(ROWS)
SLIP = 0.05 * (1 - np.cos(2 * TIME))
LOG = pd.DataFrame(
    {
        "Zeit [s]": TIME,
        "v [km/h]": 36.0 + TIME,
        "v_Rad [km/h]": (36.0 + TIME) * (1 + SLIP),
        "mu": 0.3 * SLIP / (0.02 + SLIP),
    }
)

#: The names and units of the columns.
NAMES = {name: tuple([*name.rstrip("]").split(" ["), ""][:2]) for name in LOG}

#: The columns by names that are those of variables.
VARIABLES = {
    f"{stem}_{unit}".replace("/", "").rstrip("_"): LOG[name].to_numpy()
    for name, (stem, unit) in NAMES.items()
}

#: Of channels with states, how many samples they have: the slow ones.
GEARS = np.arange(20)
DRIVER = ["neutral", *["driving"] * 19]


def sheet(path):
    LOG.to_excel(f"{path}", index=False)  # of a Path pandas does not see the ending


def titled_sheet(path):
    """As it stands in many workbooks: a title, names, units, and a small second sheet."""
    names = pd.DataFrame([["Messfahrt 7", *3 * [None]], *zip(*NAMES.values(), strict=True)])
    rows = pd.concat([names, LOG.set_axis(range(4), axis=1)])
    with pd.ExcelWriter(f"{path}") as book:
        pd.DataFrame({"Fahrer": ["A"]}).to_excel(book, sheet_name="Notizen", index=False)
        rows.to_excel(book, sheet_name="Daten", index=False, header=False)


def sheet_with_notes(path):
    """Text in further columns, an empty column and empty rows below."""
    more = LOG.assign(leer=np.nan, Bemerkung=["Start", *["" for _ in TIME[1:]]])
    pd.concat([more, pd.DataFrame(index=range(5))]).to_excel(f"{path}", index=False)


def sheet_of_dates(path):
    at = pd.Timestamp("2026-11-24 08:00:00") + pd.to_timedelta(TIME, unit="s")
    LOG.assign(**{"Zeit [s]": at}).rename(columns={"Zeit [s]": "Zeit"}).to_excel(path, index=False)


def matlab_vectors(path):
    scipy.io.savemat(path, VARIABLES)


def matlab_structure(path):
    scipy.io.savemat(path, {"log": VARIABLES, "rate": 20.0})


def matlab_columns(path):
    """Columns, and a vector of another length."""
    columns = {name: values[:, None] for name, values in VARIABLES.items()}
    scipy.io.savemat(path, {**columns, "c": np.arange(7.0)})


def hdf_vectors(path, block=0):
    with h5py.File(path, "w", userblock_size=block) as file:
        for name, values in VARIABLES.items():
            file[name] = values[None, :]


def hdf_groups(path, block=0):
    """Units among the attributes, and text."""
    with h5py.File(path, "w", userblock_size=block) as file:
        for name, (stem, unit) in NAMES.items():
            file[f"run/{stem}"] = LOG[name].to_numpy()
            file[f"run/{stem}"].attrs["unit"] = unit
        file["rail"] = ["dry"] * ROWS


def hdf_table(path, block=0):
    """Of numbers as another kind of machine writes them."""
    with h5py.File(path, "w", userblock_size=block) as file:
        file["log"] = pd.DataFrame(VARIABLES).astype(">f8").to_records(index=False)


def matlab_7_3(path, write):
    """HDF5 behind a header of MATLAB."""
    write(path, block=512)
    header = b"MATLAB 7.3 MAT-file".ljust(124) + bytes([0, 2]) + b"IM"
    path.write_bytes(header + path.read_bytes()[128:])


def mdf(path, every=1, states=False):
    """The speed of the train has every so many samples, and so have the states."""
    file = asammdf.MDF()

    def signals(names, step):
        for name in names:
            stem, unit = NAMES[name]
            values = LOG[name].to_numpy()[::step]
            yield asammdf.Signal(values, TIME[::step], name=stem, unit=unit)

    file.append([*signals(("v_Rad [km/h]", "mu"), 1)], acq_name="fast")
    slow = [*signals(("v [km/h]",), every)]
    if states:
        words = {f"val_{i}": i for i in GEARS}
        words |= {f"text_{i}": word.encode() for i, word in enumerate(DRIVER)}
        for name, conversion in (("gear", None), ("driver", words)):
            one = asammdf.Signal(
                GEARS.astype(np.uint8), TIME[::every], name=name, conversion=conversion
            )
            slow.append(one)
    file.append(slow, acq_name="slow")
    file.save(path)


def tdms(path, every=1, states=False, steps=True):
    """The same; with or without the step in time of each channel."""

    def channel(group, stem, values, unit="", step=1):
        told = {"unit_string": unit}
        told |= {"wf_increment": 0.05 * step, "wf_start_offset": 0.0} if steps else {}
        return nptdms.ChannelObject(group, stem, values, properties=told)

    channels = [
        channel("slow" if step > 1 else "fast", stem, LOG[name].to_numpy()[::step], unit, step)
        for name, (stem, unit) in NAMES.items()
        for step in [every if name == "v [km/h]" else 1]
        if not (steps and stem == "Zeit")
    ]
    if states:
        channels.append(channel("slow", "gear", GEARS, step=every))
        channels.append(channel("slow", "driver", DRIVER, step=every))
    with nptdms.TdmsWriter(path) as file:
        file.write_segment(channels)


def tdms_of_two_starts(path):
    """The speed of the train is measured from sample 20 on, by a task that starts then."""
    began = np.datetime64("2026-03-18T06:00:00.000000")
    with nptdms.TdmsWriter(path) as file:
        for name, (stem, unit) in [*NAMES.items()][1:]:
            first = 20 if stem == "v" else 0
            start = began + np.timedelta64(50 * first, "ms")
            told = {"unit_string": unit, "wf_increment": 0.05, "wf_start_offset": 0.0}
            told["wf_start_time"] = start
            values = LOG[name].to_numpy()[first:]
            file.write_segment([nptdms.ChannelObject(f"from {first}", stem, values, told)])


def zipped(path, **content):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name, text in content.items():
            file.writestr(name, text)


#: By ending: what writes the log in three ways or more.
FOREIGN = {
    ".xlsx": (sheet, titled_sheet, sheet_with_notes, sheet_of_dates),
    ".ods": (sheet, titled_sheet, sheet_with_notes),
    ".mat": (
        matlab_vectors,
        matlab_structure,
        matlab_columns,
        partial(matlab_7_3, write=hdf_vectors),
        partial(matlab_7_3, write=hdf_groups),
        partial(matlab_7_3, write=hdf_table),
    ),
    ".h5": (hdf_vectors, hdf_groups, hdf_table),
    ".hdf5": (hdf_vectors, hdf_groups, hdf_table),
    ".mf4": (mdf, partial(mdf, every=10), partial(mdf, every=10, states=True)),
    ".tdms": (
        tdms,
        partial(tdms, steps=False),
        partial(tdms, every=10),
        partial(tdms, every=10, states=True),
    ),
    ".feather": (
        LOG.to_feather,
        LOG.astype("float32").to_feather,
        LOG.assign(rail=pd.Categorical(["dry", "wet"] * (ROWS // 2))).to_feather,
    ),
    ".zip": (
        lambda path: zipped(path, **{"log.csv": LOG.to_csv(index=False)}),
        lambda path: zipped(
            path,
            **{
                "readme.md": "no table",
                "__MACOSX/log.csv": "x",
                "data/log.txt": LOG.to_csv(index=False, sep=";", decimal=","),
            },
        ),
        lambda path: zipped(path, **{"log.TSV": LOG.to_csv(index=False, sep="\t")}),
    ),
}


def written(folder, ending, place):
    path = Path(folder) / f"log{ending}"
    FOREIGN[ending][place](path)
    return path
