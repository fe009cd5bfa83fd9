"""How every command speaks: options by click, and one sentence for what cannot be used."""

import math
import sys
from pathlib import Path
from typing import Any

import click

from adhesion_jax import programs, runtime
from adhesion_jax.errors import InputError, WorkerError


def run(command: click.Command) -> None:
    """Run a command to the end of the process: status 0, or one sentence and status 2.

    Status 1 where the machine failed: a worker process that died.
    """
    runtime.start()
    programs.share_with_jax()
    try:
        command.main(standalone_mode=False)
    except click.Abort:
        sys.exit(130)
    except click.ClickException as error:
        _refuse(error.format_message())
    except InputError as error:
        _refuse(str(error))
    except WorkerError as error:
        click.echo(f"error: {error}", err=True)
        sys.exit(1)


def _refuse(sentence: str) -> None:
    click.echo(f"error: {sentence}", err=True)
    sys.exit(2)


class FiniteRange(click.FloatRange):
    """A number in a range; nan and infinity, which pass every comparison or none, are refused."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number.", param, ctx)
        return number


class Folder(click.Path):
    """A folder by its name; an empty name, which pathlib takes for this folder, is refused."""

    name = "folder"

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            self.fail("the name is empty; name a folder, or . for this one.", param, ctx)
        return super().convert(value, param, ctx)


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
