"""Files of every format with bytes changed, cut or moved are read, or refused in a sentence."""

import io
import json
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from foreign_logs import FOREIGN, LOG, written

from adhesion_jax.data import containers, read_measured
from adhesion_jax.data.vectors import READERS
from adhesion_jax.errors import InputError

WRITTEN_BY_US = {
    ".csv": lambda path: LOG.to_csv(path, index=False),
    ".csv.gz": lambda path: LOG.to_csv(path, index=False),
    ".parquet": LOG.to_parquet,
}

ENDINGS = (*WRITTEN_BY_US, *FOREIGN)

#: Of these a program of its own reads each file, which takes up to a second.
BY_A_PROGRAM = [one for one in ENDINGS if one in READERS]


def changed(content, draw):
    """A few bytes changed, a piece cut out, a piece written twice, or the end missing."""
    found = bytearray(content)
    for _ in range(draw.integers(1, 4)):
        at, size = draw.integers(len(found)), draw.integers(1, 200)
        match draw.integers(5):
            case 0:
                del found[at:]
            case 1:
                del found[at : at + size]
            case 2:
                found[at:at] = found[at : at + size]
            case 3:
                found[at : at + 4] = draw.choice([b"\0\0\0\0", b"\xff\xff\xff\xff", b"\x7f\xff"])
            case 4:
                for place in draw.integers(len(found), size=draw.integers(1, 20)):
                    found[place] = draw.integers(256)
        if not found:
            break
    return bytes(found)


def changed_inside(content, draw):
    """The same of one of the files in a zip file, which is whole itself."""
    with zipfile.ZipFile(io.BytesIO(content)) as whole:
        names = whole.namelist()
        chosen = names[draw.integers(len(names))]
        parts = {name: whole.read(name) for name in names}
    parts[chosen] = changed(parts[chosen], draw) if parts[chosen] else b""
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w") as whole:
        for name, part in parts.items():
            whole.writestr(name, part)
    return made.getvalue()


def fuzzed(ending, count, folder):
    """How many of so many files are read, and what is said of the others."""
    draw = np.random.default_rng(sum(ending.encode()))
    if ending in FOREIGN:
        good = [written(folder, ending, i).read_bytes() for i in range(len(FOREIGN[ending]))]
    else:
        path = Path(folder) / f"log{ending}"
        WRITTEN_BY_US[ending](path)
        good = [path.read_bytes()]
    path, read, told = Path(folder) / f"fuzzed{ending}", 0, []
    for number in range(count):
        content = good[number % len(good)]
        inside = zipfile.is_zipfile(io.BytesIO(content)) and draw.random() < 0.7
        path.write_bytes((changed_inside if inside else changed)(content, draw))
        try:
            read_measured(path)
            read += 1
        except InputError as refused:
            told.append(str(refused))
    return read, told


@pytest.fixture
def forking(monkeypatch, tmp_path):
    """Programs start in a hundredth of the time that importing their libraries takes."""
    server = subprocess.Popen(
        [sys.executable, Path(__file__).with_name("forking.py")],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )

    def run(command, **_):
        told = tmp_path / "told"
        print(json.dumps([*map(str, command[2:]), str(told)]), file=server.stdin, flush=True)
        status = int(server.stdout.readline())
        return subprocess.CompletedProcess(command, status, told.read_bytes())

    with server:
        monkeypatch.setattr(containers.subprocess, "run", run)
        yield
        monkeypatch.undo()
        server.stdin.close()


@pytest.mark.filterwarnings("ignore")  # of libraries, which the command shows to nobody
@pytest.mark.parametrize(
    ("ending", "count"),
    [
        *((one, 30) for one in ENDINGS if one not in READERS),
        *(pytest.param(one, 6, marks=pytest.mark.long) for one in BY_A_PROGRAM),
        *(pytest.param(one, 1000, marks=pytest.mark.slow) for one in ENDINGS if one not in READERS),
    ],
)
def test_no_file_is_answered_by_an_error_of_a_library(ending, count, tmp_path):
    read, told = fuzzed(ending, count, tmp_path)
    assert read < count
    assert [one for one in told if "\n" in one or not one.endswith(".")] == []


@pytest.mark.slow
@pytest.mark.usefixtures("forking")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("ending", BY_A_PROGRAM)
def test_nor_are_many_files_that_a_program_reads(ending, tmp_path):
    test_no_file_is_answered_by_an_error_of_a_library(ending, 1000, tmp_path)
