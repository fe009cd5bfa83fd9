"""`adhesion rerun`: the results in a folder once more, from what is recorded beside them."""

import json
import os
import shlex
from collections.abc import Mapping, Sequence
from contextlib import chdir
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import click

from adhesion_jax.command_line.command import RECORDED, command, out_folder
from adhesion_jax.errors import InputError

#: What is read of a folder.
_RECORD = "metadata.json"

#: What an interrupted or an extended job was told besides, which does not go on here.
_ONCE = {"--resume": 0, "--extend": 1, "--out": 1}


@command("rerun out/identify", "rerun out/identify --out out/again", cls=click.Command)
@click.argument("folder", type=click.Path(path_type=Path))
@out_folder("rerun", "the results")
def main(folder: Path, out: Path) -> None:
    """Repeat the command that wrote the results in FOLDER, by its metadata.json.

    It runs with the same options, from the working folder of the first time, and with the files as
    they are now. Where versions have changed since, it says so.
    """
    told = _told(folder)
    try:
        arguments, changed = _arguments(told, out.absolute()), _changed(told["versions"])
    except (KeyError, TypeError, ValueError):
        raise _no_record(folder) from None
    where = Path(told["folder"])
    if not where.is_dir() or not os.access(where, os.X_OK):
        raise InputError(
            f"{folder} was written from the folder {where}, which is not there; give the "
            f"command anew: {_typed(told)}."
        )
    if changed:
        click.echo(f"Versions have changed since: {', '.join(changed)}.\n")
    click.echo(f"In {where}: {_typed(told)}\n")
    command = import_module(f"adhesion_jax.command_line.{told['command']}").main
    with chdir(where):
        command.main(arguments, prog_name=f"adhesion {told['command']}", standalone_mode=False)


def _told(folder: Path) -> Mapping[str, Any]:
    """What metadata.json says; InputError where it is not that of a command."""
    path = folder / _RECORD
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            f"{path} cannot be read ({error.strerror}); name a folder of results."
        ) from None
    except (ValueError, RecursionError):
        told = None
    if isinstance(told, dict) and "call" in told and "command" not in told:
        raise InputError(
            f"{path} tells of results that a program of yours has asked for; run it again."
        )
    kinds = {"command": str, "arguments": list, "folder": str, "options": dict, "versions": dict}
    whole = isinstance(told, dict) and all(isinstance(told.get(k), v) for k, v in kinds.items())
    if not whole or told["command"] not in RECORDED:
        raise _no_record(folder)
    if not all(isinstance(one, str) and "\0" not in one for one in told["arguments"]):
        raise _no_record(folder)
    return told


def _no_record(folder: Path) -> InputError:
    return InputError(
        f"{folder / _RECORD} does not say by which command the results were made; name another "
        "folder of results."
    )


def _arguments(told: Mapping[str, Any], results: Path) -> list[str]:
    """The arguments that make the same results in another folder."""
    if told["command"] == "simulate":  # whose --out is a file
        results /= Path(told["options"]["--out"]).name
    extended, ours = told["options"].get("--extend"), ["--out", str(results)]
    if extended:
        runs = told["runs"] if "runs" in told else told["config"]["runs"]
        ours += ["--runs", str(runs)]
    return [*_without({**_ONCE, "--runs": 1} if extended else _ONCE, told["arguments"]), *ours]


def _without(names: Mapping[str, int], arguments: Sequence[str]) -> list[str]:
    """The arguments without these options, which have so many values."""
    kept: list[str] = []
    rest = iter(arguments)
    for one in rest:
        name, equals, _ = one.partition("=")
        if name not in names:
            kept.append(one)
        elif not equals:
            for _ in range(names[name]):
                next(rest, None)
    return kept


def _typed(told: Mapping[str, Any]) -> str:
    """The command as a shell takes it."""
    return shlex.join(["adhesion", told["command"], *told["arguments"]])


def _changed(before: Mapping[str, object]) -> list[str]:
    """The packages that are of another version now."""
    found = []
    for name, then in before.items():
        try:
            now = version(name)
        except PackageNotFoundError:
            now = "none"
        if now != then:
            found.append(f"{name} {then} to {now}")
    return found
