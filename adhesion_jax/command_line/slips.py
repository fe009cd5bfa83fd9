"""What a command is told of the slip of a log: whether to cut out its events, and its noise."""

import click

from adhesion_jax.command_line.command import FiniteRange

slip_events = click.option(
    "--events/--whole",
    "events",
    default=None,
    help="Cut the slip events out of a log, as runs, or use all of its rows. By default events are "
    "cut out of a table of 10,000 rows or more with a time and without a column run.",
)

slip_noise = click.option(
    "--slip-noise",
    type=FiniteRange(min=0),
    help="Standard deviation of the noise of the wheel speed in m/s (of slip, where there is no "
    "vehicle speed), 0 for an exact slip; by default it is estimated where there is time_s.",
)
