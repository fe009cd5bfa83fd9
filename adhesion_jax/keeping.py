"""Where things are kept from one process to the next, and the sources they are made from.

The folder is the user's own, and nobody else may write there: `ADHESION_JAX_CACHE` names another
one, or is `off`. Nothing here needs jax, which takes longer to import than an answer may take.
"""

import atexit
import os
import shutil
import stat
import sys
import tempfile
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

#: The variable that names the folder.
VARIABLE = "ADHESION_JAX_CACHE"

_PACKAGE = Path(__file__).parent

#: Sources from outside the package by their path, as `plugins` read them.
_outside: dict[Path, bytes] = {}

_folder: list[Path] = []  # none before it is asked for


@cache
def of_package() -> str:
    """SHA-256 of the source of the package."""
    content = sha256()
    for path in sorted(_PACKAGE.rglob("*")):
        if path.is_file() and path.suffix != ".pyc":
            _add(content, path.relative_to(_PACKAGE), path.read_bytes())
    return content.hexdigest()


def outside(path: Path, source: bytes) -> None:
    """From now on programs depend on this source, too."""
    _outside[path] = source


def is_outside(*paths: str) -> bool:
    """Whether one of these is a source that programs depend on."""
    return any(Path(path) in _outside for path in paths)


def of_outside() -> str:
    """The sources from outside the package in a number of fixed length."""
    content = sha256()
    for path, source in sorted(_outside.items()):
        _add(content, path, source)
    return content.hexdigest()


def _add(content: Any, path: Path, source: bytes) -> None:
    content.update(f"{path}:{len(source)}:".encode() + source)


def folder() -> Path:
    """Where programs are kept: the user's cache folder, or one that passes with this process."""
    if not _folder:
        asked = os.environ.get(VARIABLE, "")
        _folder.append(_passing() if asked == "off" else _own(asked))
    return _folder[0]


def kept(path: Path) -> bytes | None:
    """What was kept there, if it is whole; None where there is nothing, or something damaged."""
    try:
        content = path.read_bytes()
    except OSError:
        return None
    return content[32:] if content[:32] == _checksum(path, content[32:]) else None


def keep(path: Path, payload: bytes) -> None:
    """Keep something whole or not at all: where there is no room, it is made again next time."""
    partly = path.with_suffix(f".{os.getpid()}")
    try:
        partly.touch(0o600)
        partly.write_bytes(_checksum(path, payload) + payload)
        partly.replace(path)
    except OSError:
        partly.unlink(missing_ok=True)


def _checksum(path: Path, payload: bytes) -> bytes:
    """With the name of the file in it, so that none takes another one's place."""
    return sha256(path.stem.encode() + payload).digest()


def use(path: Path) -> None:
    """Keep programs in the folder that another process of this command has chosen."""
    _folder[:] = [path]


def _own(asked: str) -> Path:
    path = Path(asked).expanduser().absolute() if asked else user_cache_path("adhesion_jax")
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        (path / "locks").mkdir(exist_ok=True)
        reason = _reason_not_to_trust(path)
    except OSError as error:
        reason = f"{path} cannot be written to ({error.strerror})"
    if reason is None:
        _remove_strangers(path)
        return path
    print(
        f"Compiled programs are not kept: {reason}. Name a folder of your own by {VARIABLE}, or "
        "switch them off by the value off.",
        file=sys.stderr,
    )
    return _passing()


def _reason_not_to_trust(path: Path) -> str | None:
    """A program that is loaded is run: nobody else may have been able to put it there."""
    if not hasattr(os, "getuid"):
        return None  # the folders of a Windows profile are the user's own
    if not os.access(path, os.W_OK):
        return f"{path} cannot be written to"
    resolved = path.resolve()
    for place in (resolved, *resolved.parents):
        status = place.stat()
        sticky = place != resolved and status.st_mode & stat.S_ISVTX
        if status.st_uid not in (0, os.getuid()):
            return f"{place} belongs to another user"
        if status.st_mode & 0o022 and not sticky:
            return f"others may write to {place}"
    return None


def _remove_strangers(folder: Path) -> None:
    """Remove what others put or may have changed there, in a time in which the folder was open.

    That is what belongs to another user or group, and what all may write to.
    """
    if not hasattr(os, "getuid"):
        return
    for where, folders, files in os.walk(folder, topdown=True):
        for name in [*folders, *files]:
            path = Path(where, name)
            try:
                status = path.lstat()
            except FileNotFoundError:  # removed by another process
                continue
            by_group = status.st_mode & 0o020 and status.st_gid != os.getgid()
            if status.st_uid == os.getuid() and not by_group and not status.st_mode & 0o002:
                continue
            if name in folders and not path.is_symlink():
                folders.remove(name)
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)


def _passing() -> Path:
    path = Path(tempfile.mkdtemp(prefix="adhesion_jax-"))
    (path / "locks").mkdir()
    atexit.register(shutil.rmtree, path, ignore_errors=True)
    return path
