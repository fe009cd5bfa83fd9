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

from adhesion_jax.errors import InputError

if sys.platform != "win32":
    import fcntl

_CANNOT_WRITE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM)


def output_directory(path: Path) -> Path:
    """`path`, made if need be, and proved writable before any work is done."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe = path / ".writable"
        probe.touch()
        probe.unlink(missing_ok=True)  # another job may try the same
    except OSError as error:
        raise InputError(
            f"--out {path} cannot be written to ({error.strerror}); name a folder that can."
        ) from None
    return path


@contextmanager
def staged(directory: Path, own: Sequence[str]) -> Iterator[Path]:
    """A folder to write into whose files appear in `directory` when all are complete.

    `own` are the names a command may write: what an earlier job left of them goes, other files
    are left alone. After an error nothing changes. Of several jobs with one directory the files are
    those of the job that ended last, all of them. InputError where a folder bears one of the names,
    or where there is no room to write.
    """
    for name in own:
        if (directory / name).is_dir():
            raise InputError(
                f"--out {directory} has a folder {name} where a file of that name belongs; "
                "move it or name another folder."
            )
    try:
        with tempfile.TemporaryDirectory(dir=directory, prefix=".partial-") as folder:
            stage = Path(folder)
            yield stage
            written = sorted(file.name for file in stage.iterdir())
            with _alone(directory):
                for name in written:
                    os.replace(stage / name, directory / name)
                for name in set(own) - set(written):
                    (directory / name).unlink(missing_ok=True)
    except OSError as error:
        if error.errno not in _CANNOT_WRITE:
            raise
        raise InputError(
            f"--out {directory} cannot be written to ({error.strerror}); name a folder that can."
        ) from None


@contextmanager
def _alone(directory: Path) -> Iterator[None]:
    """No other job puts its files there meanwhile; a job that is killed lets go of the folder."""
    if sys.platform == "win32":
        yield
        return
    folder = os.open(directory, os.O_RDONLY)
    try:
        with suppress(OSError):  # a network disk may know no locks: then as if alone
            fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)


def write_table(path: Path, table: pd.DataFrame) -> None:
    """As CSV at full precision; what does not apply is left empty."""
    table.to_csv(path, index=False)


def write_metadata(path: Path, metadata: Mapping[str, object]) -> None:
    path.write_text(json.dumps(metadata, indent=2) + "\n")
