"""Results on disk: written whole or not at all."""

import errno
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import pandas as pd

from adhesion_jax.errors import InputError, cannot_write

if sys.platform != "win32":
    import fcntl

#: The name of the file that says how the results beside it came about.
METADATA = "metadata.json"

_CANNOT_WRITE = (
    *(errno.ENOSPC, errno.EDQUOT, errno.EFBIG),
    *(errno.EROFS, errno.EACCES, errno.EPERM),
)


def output_directory(path: Path) -> Path:
    """`path`, made if need be, and proved writable before any work is done."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe = path / ".writable"
        probe.touch()
        probe.unlink(missing_ok=True)  # another job may try the same
    except OSError as error:
        raise cannot_write(path, error.strerror) from None
    return path


def refuse_folders(directory: Path, own: Sequence[str]) -> None:
    """InputError where a folder has the name of a file that a command may write."""
    for name in own:
        if (directory / name).is_dir():
            raise InputError(
                f"--out {directory} has a folder {name} where a file of that name belongs; "
                "move it or name another folder."
            )


@contextmanager
def writing_to(directory: Path) -> Iterator[None]:
    """InputError instead of an error of the operating system that says that this cannot be."""
    try:
        yield
    except OSError as error:
        if error.errno not in _CANNOT_WRITE:
            raise
        # A library has words of its own in the error.
        raise cannot_write(directory, os.strerror(error.errno)) from None


@contextmanager
def staged(directory: Path, own: Sequence[str], beside: Path | None = None) -> Iterator[Path]:
    """A folder to write into whose files appear in `directory` when all are complete.

    `own` are the names that a command may write: files of an earlier job with these names are
    removed, other files are left alone. After an error nothing changes. If several jobs write to
    one directory, all its files are those of the job that ended last. The folder lies in the
    directory, or in another one on its disk, `beside`. Raises InputError if a folder has one of the
    names, or if the directory cannot be written to.
    """
    refuse_folders(directory, own)
    with (
        writing_to(directory),
        tempfile.TemporaryDirectory(dir=beside or directory, prefix=".partial-") as folder,
    ):
        stage = Path(folder)
        yield stage
        written = sorted(file.name for file in stage.iterdir())
        with _alone(directory):
            for name in written:
                os.replace(stage / name, directory / name)
            for name in set(own) - set(written):
                (directory / name).unlink(missing_ok=True)


@contextmanager
def _alone(directory: Path) -> Iterator[None]:
    """A lock on the directory for moving files into it; a killed job releases it."""
    if sys.platform == "win32":
        yield
        return
    folder = os.open(directory, os.O_RDONLY)
    try:
        with suppress(OSError):  # a network disk may not support locks: the job goes on without one
            fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)


def write_table(path: Path, table: pd.DataFrame) -> None:
    """Writes a table as CSV at full precision; cells that do not apply are left empty."""
    table.to_csv(path, index=False)


def write_metadata(path: Path, metadata: Mapping[str, object]) -> None:
    path.write_text(json.dumps(metadata, indent=2) + "\n")
