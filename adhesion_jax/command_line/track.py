"""`adhesion track`: a log followed by online methods, sample by sample."""

from typing import Any

import click

from adhesion_jax.command_line.catalogue import catalogue
from adhesion_jax.command_line.command import (
    FiniteRange,
    Names,
    begin,
    command,
    listing,
    out_folder,
    shown,
    written,
)
from adhesion_jax.command_line.reading import Log, Reading, reading
from adhesion_jax.errors import InputError

KNOWN = catalogue()
NAMES = KNOWN.names

_ONLINE = [name for name in NAMES["identifiers"] if name not in KNOWN.not_following]


@command(
    "track eurosprinter",
    'track log.csv --column "axle_force=Zugkraft" --identifiers riv,mine.py:Mine',
)
@click.argument("log", type=Log(NAMES["data"]))
@reading
@click.option(
    "--identifiers",
    type=Names(NAMES["identifiers"], "identifier"),
    help=f"Some of {', '.join(_ONLINE)}, or FILE.py:NAME, divided by commas; by default riv, "
    "bank-kiencke and rls-kiencke.",
)
@click.option(
    "--initial-slope",
    type=FiniteRange(min=0, min_open=True),
    help="Slope a0 of the adhesion curve at slip 0, per unit of slip; by default that of a fit of "
    "Kiencke's curve to the log, with its error in the bands.",
)
@out_folder("track", "track.csv, track.png and track.txt")
@listing(data=NAMES["data"], identifiers=_ONLINE)
def main(
    log: str,
    identifiers: tuple[Any, ...] | None,
    reading: Reading,
    **asked: Any,
) -> None:
    """Follow LOG sample by sample, and draw what is known of the largest adhesion over time.

    LOG is a file that adhesion identify takes, with a time if there is one, or the name of a data
    set that ships with the package: eurosprinter. Its samples are followed in the order of time.
    """
    for name in identifiers or ():
        if name in KNOWN.not_following:
            raise InputError(
                f"--identifiers {name} cannot follow a log: {KNOWN.not_following[name]}."
            )
    (names,) = begin(identifiers)
    from adhesion_jax.library.track import METHODS, track

    (measured,) = reading.tables([log])
    with shown() as progress:
        found = track(measured, names or METHODS, events=reading.events, progress=progress, **asked)
    written(found, asked["out"])
