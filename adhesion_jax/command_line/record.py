"""How results came about, beside them: metadata.json, from which `adhesion rerun` repeats them."""

import json
import os
from collections.abc import Mapping
from pathlib import Path

import click

from adhesion_jax.command_line.command import ARGUMENTS
from adhesion_jax.plugins import Part

#: The commands that write results.
RECORDED = ("montecarlo", "identify", "track", "discover", "simulate", "plan", "traction")


def record(folder: Path) -> None:
    """Write metadata.json: what was asked, versions and machine.

    What a result has written there before, as how columns were understood, stays, but for the call
    of the function that made it.
    """
    from adhesion_jax import runtime
    from adhesion_jax.files import METADATA, staged, write_metadata

    path = folder / METADATA
    told = json.loads(path.read_text(encoding="utf-8")) if path.exists() else runtime.describe()
    told.pop("call", None)
    with staged(folder, [METADATA]) as stage:
        write_metadata(stage / METADATA, {**_asked(), **told})


def _asked() -> Mapping[str, object]:
    """The command, its arguments, from where, and what all options came to, as JSON has it."""
    context = click.get_current_context()
    assert context.command.callback is not None
    options = {
        param.opts[0]: _plain(context.params[param.name])
        for param in context.command.get_params(context)
        if param.name in context.params
    }
    return {
        "command": context.command.callback.__module__.rpartition(".")[-1],
        "arguments": context.meta[ARGUMENTS],
        "folder": os.getcwd(),
        "options": options,
    }


def _plain(value: object) -> object:
    if isinstance(value, (list, tuple)) and not isinstance(value, Part):
        return [_plain(one) for one in value]
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)
