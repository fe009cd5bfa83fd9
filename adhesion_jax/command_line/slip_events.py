"""The option by which a command is told whether it shall cut slip events out of a log."""

import click

slip_events = click.option(
    "--events/--whole",
    "events",
    default=None,
    help="Cut the slip events out of a log, as runs, or use all of its rows. By default events are "
    "cut out of a table of 10,000 rows or more with a time and without a column run.",
)
