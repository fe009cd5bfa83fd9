"""`track`: what online methods know of the largest adhesion after each sample of a log."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from adhesion_jax.data import check_curve
from adhesion_jax.data.forces import Corrections
from adhesion_jax.errors import InputError
from adhesion_jax.files import METADATA, output_directory, write_table
from adhesion_jax.library.reading import Data, Methods, citation_of, measured_of, methods_named
from adhesion_jax.library.results import columns_of, of_numbers, recorded, text_html, written
from adhesion_jax.measured.following import Followed, follow_log, refusal
from adhesion_jax.measured.log import InitialSlope, Log, to_log
from adhesion_jax.measured.log import initial_slope as slope_of
from adhesion_jax.report.track.figure import track_figure
from adhesion_jax.report.track.words import checkpoint_rows, printed_summary, summary_rows, told
from adhesion_jax.runtime import as_in_commands, silent

#: The files of a followed log.
TRACK_FILES = ("track.csv", "track.txt", "track.png", METADATA)

#: What follows a log where no method is named: one that forgets by resets alone, one that follows a
#: drift, and one that forgets evenly.
METHODS = ("riv", "bank-kiencke", "rls-kiencke")


@dataclass(frozen=True, eq=False, repr=False)
class Track:
    """What online methods made of a log.

    Attributes:
        log: the samples in the order in which they were followed.
        citation: of a set that ships.
        initial_slope: what all methods were told.
        followed: the estimates, by the name of the method.
    """

    log: Log
    citation: str
    initial_slope: InitialSlope
    followed: Mapping[str, Followed]

    @property
    def estimates(self) -> pd.DataFrame:
        """A row a method and checkpoint: time, estimate with its band, status, resets so far."""
        return checkpoint_rows(self.log, self.followed)

    @property
    def summary(self) -> pd.DataFrame:
        """A row a method: its last estimate, resets, shares of samples skipped and trusted."""
        return summary_rows(self.log, self.followed)

    @property
    def verdict(self) -> str:
        """In words: the log, the initial slope, the last estimates, and what not to trust."""
        return told(self.log, self.citation, self.initial_slope, self.followed)

    def write(self, folder: str | PathLike[str]) -> None:
        """The files TRACK_FILES, as the command writes them."""
        path = output_directory(Path(folder))
        write_table(path / "track.csv", self.estimates)
        (path / "track.txt").write_text(f"{self}\n", encoding="utf-8")
        self.plot().savefig(path / "track.png", dpi=150)

    def plot(self) -> Figure:
        """The estimates over the measured adhesion, the status of each method, slip and speed."""
        return track_figure(Path(self.log.name).name, self.log, self.followed)

    def __repr__(self) -> str:
        return f"{printed_summary(self.summary)}\n\n{self.verdict}"

    def _repr_html_(self) -> str:
        return self.summary.to_html(index=False) + text_html(self.verdict)


@recorded
@as_in_commands
def track(
    data: Data,
    identifiers: Methods = METHODS,
    initial_slope: float | None = None,
    columns: Mapping[str, object] | None = None,
    wheel_radius: float | None = None,
    events: bool | None = None,
    progress: Callable[[str, float], object] = silent,
    delays: Mapping[str, float] | None = None,
    inertia: float | None = None,
    gear_ratio: float | None = None,
    efficiency: float = 1.0,
    out: str | PathLike[str] | None = None,
) -> Track:
    """Follow a log by online methods, sample by sample in the order of time.

    Args:
        data: one table, as `identify` takes it.
        identifiers: names of IDENTIFIERS, or methods of your own by name.
        initial_slope: slope a0 of Kiencke's curve at slip 0, per unit of slip; by default that of a
            fit to the log.
        columns: what columns are where names and units do not tell, `{"speed": "v [km/h]"}`; a
            minus turns a sign, `{"wheel_load": "-FZ"}`, and a number is a constant.
        wheel_radius: rolling radius, m, for a slip from the rotation of the wheel.
        events: whether slip events alone are used; by default they are in a log that hardly slips.
        progress: called with words and the share that is done.
        delays: how late signals are, s, as in `{"vehicle_speed": 0.2}`.
        inertia: that of a wheelset with all that turns with it, kg m2, taken off its force.
        gear_ratio: turns of the motor for one of the wheel, where its torque was measured.
        efficiency: that of the gear between motor and wheel, a share.
        out: a folder for the files of the command of the same name.

    Returns:
        The estimates of each method over time, and what they were told.

    Raises:
        InputError: the data cannot be used, or a method cannot follow a log.
    """
    methods = methods_named(identifiers)
    for name, method in methods.items():
        if (reason := refusal(method)) is not None:
            raise InputError(f"{name} cannot follow a log: {reason}.")
    known = Corrections(wheel_radius, delays or {}, inertia, gear_ratio, efficiency)
    measured = measured_of(data, columns, known)
    check_curve(measured)
    log = to_log(measured, events)
    if initial_slope is not None and not (np.isfinite(initial_slope) and initial_slope > 0):
        raise InputError(f"The initial slope is {initial_slope}; give a positive number.")
    slope = of_numbers(slope_of(log, initial_slope))
    total, done = log.used.size * len(methods), [0]

    def one_more(count: int) -> None:
        done[0] += count
        progress("following", done[0] / total)

    followed = follow_log(methods, log, slope.plausible, slope.form, one_more)
    found = Track(log, citation_of(data), slope, followed)
    return written(found, out, TRACK_FILES, columns_of([measured]))
