"""`adhesion plan`: what a measurement would tell of the peak, before it is made."""

import math
from collections import Counter
from collections.abc import Callable
from typing import Any

import click
import numpy as np

from adhesion_jax.command_line.catalogue import catalogue
from adhesion_jax.command_line.command import (
    File,
    Name,
    Names,
    begin,
    command,
    listing,
    number_in,
    out_folder,
    written,
)
from adhesion_jax.command_line.reading import Log, Reading, reading
from adhesion_jax.errors import InputError
from adhesion_jax.options import NOISE

NAMES = catalogue().names

#: Largest number of values in a range.
_MOST_VALUES = 50


class Written(click.ParamType):
    """A value that is written as text and read by a function; what is none is one already."""

    def __init__(self, name: str, read: Callable[[str], Any], wanted: str) -> None:
        self.name, self.read, self.wanted = name, read, wanted

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        try:
            return self.read(value) if isinstance(value, str) else value
        except ValueError:
            raise InputError(f"{param.opts[0]} {value} is no {self.wanted}.") from None


def _values(text: str) -> tuple[float, ...]:
    """LOW:HIGH or LOW:HIGH:COUNT, with equal steps of the logarithm."""
    parts = text.split(":")
    low, high, count = [*parts, "8"] if len(parts) == 2 else parts
    ends, number = (float(low), float(high)), int(count)
    if not (0 < ends[0] < ends[1] < math.inf and 2 <= number <= _MOST_VALUES):
        raise ValueError
    return tuple(np.geomspace(*ends, number).tolist())


def _share(text: str) -> float:
    """1% or 0.01."""
    number = text.strip()
    share = float(number.removesuffix("%")) / (100 if number.endswith("%") else 1)
    if not 0 < share < 1:
        raise ValueError
    return share


def _condition(text: str) -> tuple[str, float]:
    """A column and its value."""
    column, _, number = text.partition("=")
    if not column or not math.isfinite(float(number)):
        raise ValueError
    return column, float(number)


_VALUES = Written(
    "LOW:HIGH[:COUNT]",
    _values,
    "range; write LOW:HIGH or LOW:HIGH:COUNT, two numbers above 0 in rising order and how many "
    f"values to take (2 to {_MOST_VALUES})",
)
_SHARE = Written("per cent", _share, "share; write it as 1% or 0.01, above 0 and below 100 %")
_CONDITION = Written(
    "COLUMN=NUMBER", _condition, "condition; write a column and its value, as vehicle_speed_mps=10"
)


def noise(command: Callable[..., None]) -> Callable[..., None]:
    """A decorator that gives a command an option for all that can be stated of the noise."""
    for name, option in reversed(NOISE.items()):
        default = {"sigma": "  [default: 0.01]", "slow_rows": ""}.get(name, "  [default: 0]")
        flag = f"--{name.replace('_', '-')}"
        command = click.option(flag, type=number_in(option), help=option.help + default)(command)
    return command


@command(
    "plan --rail common --want 1%",
    "plan --law out/identify/law.json",
    'plan log.csv --column "axle_force=Zugkraft [kN]" --curve kiencke,burckhardt',
)
@click.argument("log", type=Log(NAMES["data"]), required=False)
@reading
@click.option("--rail", type=Name(NAMES["rails"]), help=f"{', '.join(NAMES['rails'])}.")
@click.option(
    "--law",
    type=File((), "name the law.json of adhesion identify or adhesion discover"),
    help="The law.json of adhesion identify or adhesion discover; its conditions are in the middle "
    "of their ranges.",
)
@click.option(
    "--curve",
    type=Names(NAMES["curves"], "curve"),
    help="The curves of LOG whose best is taken for the truth, FILE.py:NAME among them, divided by "
    "commas.",
)
@click.option(
    "--condition",
    "conditions",
    type=_CONDITION,
    multiple=True,
    help="A condition of the peak, as vehicle_speed_mps=10.",
)
@click.option(
    "--largest-slips", type=_VALUES, help="Largest slips, as 0.05:0.5; by default about the peak."
)
@click.option("--samples", type=_VALUES, help="Numbers of samples, as 100:10000.")
@click.option(
    "--samples-per-run",
    type=click.IntRange(2, 10**6),
    help="Samples of a run, in which the slip rises from 0 to the largest.  [default: 200]",
)
@noise
@click.option("--want", type=_SHARE, help="Relative standard error of mu_max to reach, as 1%.")
@out_folder("plan", "plan.csv, plan.png and plan.txt")
@listing(data=NAMES["data"], rails=NAMES["rails"], curves=NAMES["curves"])
def main(
    log: str | None,
    rail: str | None,
    law: str | None,
    curve: tuple[Any, ...] | None,
    conditions: tuple[tuple[str, float], ...],
    reading: Reading,
    **asked: Any,
) -> None:
    """Say how far the slip must go, and how many samples it takes, to know the peak.

    What is taken for the truth is a named rail, a law that was identified or discovered, or the
    best curve of one's own LOG, a file as adhesion identify takes it. With a LOG the noise and the
    slips are those of the log, and the answer says what would halve its intervals.
    """
    sources = {"LOG": log, "--rail": rail, "--law": law}
    named = [name for name, value in sources.items() if value is not None]
    if len(named) != 1:
        raise InputError(
            "Name one of LOG, --rail and --law"
            + (f", not {' and '.join(named)} together." if named else ".")
        )
    if curve and log is None:
        raise InputError(f"--curve goes with LOG, not with {named[0]}.")
    of_sweeps = {"samples_per_run": asked["samples_per_run"]}
    for option, value in (reading.asked() if log is None else of_sweeps).items():
        if value is not None:
            raise InputError(f"--{option.replace('_', '-')} does not go with {named[0]}.")
    for column, number in Counter(column for column, _ in conditions).items():
        if number > 1:
            raise InputError(f"--condition {column} is given twice; name one condition for it.")
    (names,) = begin(curve)
    from adhesion_jax.effects.saved import load_law
    from adhesion_jax.library.identify import identify
    from adhesion_jax.library.plan import plan

    source: Any = rail
    if log is not None:
        source = identify(reading.logs([log]), names)
    elif law is not None:
        source = load_law(law)
    found = plan(source, conditions=dict(conditions), **asked)
    written(found, asked["out"])
