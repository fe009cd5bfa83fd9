"""Notes on the shards that are being computed, for those who wait: the runs done and what goes on.

A note is a small file beside the shards, which begins as what is not complete does. Nothing depends
on it: one that cannot be written or read is left out.
"""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

#: What begins with this is not complete yet, or was left by a job that was killed.
PARTIAL = ".partial-"

_NOTE = f"{PARTIAL}note-"

#: Seconds between two notes on the same thing.
_PAUSE = 0.5

#: Takes the number of runs that are done, and words on what goes on.
Tell = Callable[[int, str], None]


@contextmanager
def noting(folder: Path, shard: str) -> Iterator[Tell]:
    """Keep a note on a shard while it is computed: new words at once, numbers now and then."""
    path, told, last = folder / f"{_NOTE}{shard}", set[str](), 0.0

    def tell(runs: int, words: str) -> None:
        nonlocal last
        now = time.monotonic()
        if words not in told or now - last > _PAUSE:
            told.add(words)
            last = now
            with suppress(OSError):
                path.write_text(f"{runs} {words}", encoding="utf-8")

    try:
        yield tell
    finally:
        with suppress(OSError):
            path.unlink()


def notes(folder: Path) -> list[tuple[int, str]]:
    """The runs done and the words on what goes on of every shard that is being computed.

    Workers of a cluster have folders of their own in that of the shards; of those that send what
    they store there are no notes.
    """
    found = []
    paths = [
        Path(where, name)
        for where, _, names in os.walk(folder)  # which passes over a folder that vanishes
        for name in names
        if name.startswith(_NOTE)
    ]
    for path in sorted(paths):
        with suppress(OSError, ValueError):
            runs, _, words = path.read_text(encoding="utf-8").partition(" ")
            found.append((int(runs), words))
    return found
