"""Memory that reading a long log takes beside its columns."""

import subprocess
import sys

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet
import pytest

ROWS = 3_000_000

#: Reads a file, and prints the rows, the bytes of its columns and the growth of the memory.
READ = """
import sys
from pathlib import Path
from adhesion_jax.data import read_measured
def peak():
    # Not the maximum that getrusage tells, in which the process that started this one counts.
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.split("VmHWM:")[1].split()[0])
before = peak()
found = read_measured(Path(sys.argv[1]), {"wheel_force": "F", "wheel_load": "Q"})
print(len(found.table), int(found.table.memory_usage(index=False).sum()), peak() - before)
"""


def log():
    """Eight columns at 100 Hz."""
    time = 0.01 * np.arange(ROWS)
    slip = 8 * np.abs(np.sin(time / 50)) + 0.1
    return pyarrow.table(
        {
            "t [s]": time.round(2),
            "v [km/h]": (60 + 10 * np.sin(time / 300)).round(2),
            "slip [%]": slip.round(4),
            "F [kN]": (60 * slip / (2 + slip)).round(3),
            "Q [kN]": np.full(ROWS, 100.5),
            "rH (%)": (50 + 10 * np.sin(time / 9000)).round(1),
            "T [°C]": (10 + np.sin(time / 9000)).round(1),
            "x [m]": (16 * time).round(1),
        }
    )


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="memory is told in kB on Linux")
@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_memory_beside_the_columns_is_little(ending, tmp_path):
    path = tmp_path / f"log.{ending}"
    write = pyarrow.csv.write_csv if ending == "csv" else pyarrow.parquet.write_table
    write(log(), path)
    done = subprocess.run(
        [sys.executable, "-c", READ, str(path)], capture_output=True, text=True, check=True
    )
    rows, columns, grown = map(int, done.stdout.split())
    assert rows == ROWS
    # 150 MB of CSV and 110 MB of parquet when this was written.
    assert grown - columns < 220e6
