"""Results on disk, where more than one job writes them."""

import os
import threading
import time
from pathlib import Path

import pytest

from adhesion_jax.files import output_directory, staged

NAMES = ("figure.png", "metadata.json", "table.csv")


@pytest.mark.parametrize("second_writes", [NAMES, NAMES[:2]])
def test_of_two_jobs_that_end_together_one_is_there_whole(tmp_path, monkeypatch, second_writes):
    """Each is slow to put its files in place, and at another one: unguarded they would mix."""
    together = threading.Barrier(2, timeout=30)
    replaced, order = os.replace, []

    def slowly(source, target):
        job = threading.current_thread().name
        first_file = Path(target).name == NAMES[0]
        if job == "other" and first_file:
            time.sleep(0.2)
        replaced(source, target)
        order.append(job)
        if job == "one" and first_file:
            time.sleep(0.4)

    monkeypatch.setattr("adhesion_jax.files.os.replace", slowly)

    def job(names):
        with staged(tmp_path, NAMES) as stage:
            for name in names:
                (stage / name).write_text(threading.current_thread().name)
            together.wait()

    jobs = [
        threading.Thread(target=job, args=(names,), name=name)
        for name, names in (("one", NAMES), ("other", second_writes))
    ]
    for thread in jobs:
        thread.start()
    for thread in jobs:
        thread.join(30)
    last = order[-1]
    expected = dict.fromkeys(NAMES if last == "one" else second_writes, last)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == expected


def test_two_jobs_that_begin_together_both_find_their_folder_writable(tmp_path, monkeypatch):
    touched = Path.touch

    def touch(path, *arguments):
        touched(path, *arguments)
        path.unlink()  # as the other job does that has tried the same

    monkeypatch.setattr(Path, "touch", touch)
    assert output_directory(tmp_path / "out") == tmp_path / "out"
    assert list((tmp_path / "out").iterdir()) == []
