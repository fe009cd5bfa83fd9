"""`identify`: which adhesion curve measured points follow."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np
import pandas as pd

from adhesion_jax.curves import CURVES, Curve
from adhesion_jax.data import Measured, as_one, check_curve, to_record
from adhesion_jax.data.events import Chosen, events_of
from adhesion_jax.data.grouping import group
from adhesion_jax.errors import InputError
from adhesion_jax.files import write_table
from adhesion_jax.library.reading import Data, all_of, citation_of, parts_of
from adhesion_jax.library.results import of_numbers, text_html
from adhesion_jax.measured.answer import Answer, answered
from adhesion_jax.measured.comparison import MOST_GROUPS, Comparison, compared
from adhesion_jax.measured.fit import MeasuredFit, missing_columns
from adhesion_jax.measured.identification import fit_curves
from adhesion_jax.measured.residual import Residual, residual_structure
from adhesion_jax.measured.slip import SlipErrors
from adhesion_jax.report.events import EVENTS_FIGURE, draw_events
from adhesion_jax.report.measured.figure import draw_comparison, draw_measured
from adhesion_jax.report.measured.tables import answer_lines, curve_rows, printed_table
from adhesion_jax.report.measured.words import verdict
from adhesion_jax.runtime import as_in_commands, silent
from adhesion_jax.wording import listed

#: The files of an identification.
IDENTIFY_FILES = (
    "curves.csv",
    "verdict.txt",
    "curves.png",
    EVENTS_FIGURE,
    "runs.csv",
    "runs.png",
)


@dataclass(frozen=True, eq=False, repr=False)
class Identification:
    """What measured points say of the peak, and of every curve that was fitted to them.

    Slips are ratios, or in m/s where the points have a slip velocity and no vehicle speed.
    Intervals are of 95 %, under the noise that was found: autocorrelation within the runs, scatter
    between them, noise in the slip, and what a curve misses. `best` predicts best what is left out.
    """

    measured: Measured  # the points, with the columns that were derived
    logs: Sequence[Chosen]  # the rows that were used of each table, and the slip events they are
    citation: str  # of a set that ships
    fits: Mapping[str, MeasuredFit]  # by the name of the curve
    not_fitted: Mapping[str, Sequence[str]]  # curve to the columns it needs and the points lack
    residuals: Mapping[str, Residual]  # what each curve leaves
    answer: Answer  # the peak, with the choice of the curve
    slip: SlipErrors  # the errors of the slip that the fits assume
    runs: Sequence[str]  # their names; one for points without runs
    comparison: Comparison | None  # of runs, or of groups of them, if it was asked for

    @property
    def table(self) -> pd.DataFrame:
        """A row a curve: fit, peak, status, noise, parameters with their standard errors."""
        return curve_rows(self.fits, self.not_fitted, self.answer)

    @property
    def best(self) -> str:
        """The name of the curve that predicts best what was left out of its fit."""
        return max(self.fits, key=lambda name: self.fits[name].log_density)

    @property
    def fit(self) -> MeasuredFit:
        """The fit of the best curve, with covariance, noise and status."""
        return self.fits[self.best]

    @property
    def curve(self) -> Curve:
        """The best curve, a function of slip and conditions: `curve(0.02, conditions)`."""
        return self.fit.curve

    @property
    def conditions(self) -> Mapping[str, float]:
        """What the curve needs beside the slip, at its medians: the peak is under these."""
        return self.fit.conditions

    @property
    def mu_max(self) -> float:
        """The largest adhesion, by all curves together."""
        return self.answer.mu_max.value

    @property
    def mu_max_interval(self) -> tuple[float, float]:
        """It includes the choice of the curve."""
        return self.answer.mu_max.low, self.answer.mu_max.high

    @property
    def slip_opt(self) -> float:
        """The slip of the largest adhesion; NaN where the points show no peak."""
        return self.answer.slip_opt.value

    @property
    def slip_opt_interval(self) -> tuple[float, float]:
        """It includes the choice of the curve; NaN where the points show no peak."""
        return self.answer.slip_opt.low, self.answer.slip_opt.high

    @property
    def verdict(self) -> str:
        """In words: the best curve, the noise, what is left over, and what not to trust."""
        return verdict(
            self.measured,
            " ".join(filter(None, (*(log.sentence for log in self.logs), self.citation))),
            self.fits,
            self.not_fitted,
            self.residuals[self.best],
            self.answer,
            self.slip,
            len(self.runs),
            self.comparison,
        )

    def write(self, folder: str | PathLike[str]) -> None:
        """The files IDENTIFY_FILES, as the command writes them; those of runs if compared."""
        path = Path(folder)
        path.mkdir(parents=True, exist_ok=True)
        write_table(path / "curves.csv", self.table)
        (path / "verdict.txt").write_text(f"{self.verdict}\n", encoding="utf-8")
        title = Path(self.measured.name).name
        draw = as_in_commands(draw_measured)
        draw(path / "curves.png", title, self.fits, self.residuals, self.answer)
        draw_events(path, self.logs)
        if self.comparison is not None:
            write_table(path / "runs.csv", self.comparison.table)
            draw_comparison(path / "runs.png", title, self.comparison)

    def __repr__(self) -> str:
        lines = answer_lines(self.answer, self.fit)
        return f"{lines}\n\n{printed_table(self.fits, self.answer)}\n\n{self.verdict}"

    def _repr_html_(self) -> str:
        lines = answer_lines(self.answer, self.fit)
        return text_html(lines) + self.table.to_html(index=False) + text_html(self.verdict)


def identify(
    data: Data | Sequence[Data],
    curves: str | Sequence[str] | Mapping[str, Curve] = tuple(CURVES),
    columns: Mapping[str, object] | None = None,
    wheel_radius: float | None = None,
    events: bool | None = None,
    by: str | None = None,
    slip_noise: float | None = None,
    progress: Callable[[str, float], None] = silent,
) -> Identification:
    """Fit adhesion curves to measured points under the noise that the points show.

    `data` has a row a point, with the columns slip_ratio (or slip_velocity_mps) and adhesion (or
    tangential_force_N with normal_load_N), and whatever else a curve needs, in SI units; several
    tables are taken together. `columns` says which columns these are where they have other names or
    units, as in {"speed": "v [km/h]"}, and `wheel_radius` is in m, for a slip from the rotation of
    the wheel. Runs are told by a column run, or by gaps in time_s; with time_s, the points of a run
    are in their order. Of a long log only its slip events are used, as runs (`data.events`), unless
    `events` is False; with True a short one is cut as well. `curves` are names of CURVES, or curves
    of your own by name. `by` is a column whose groups of runs are compared: did the rail change
    between them? (`run` compares the runs themselves.) `slip_noise` is the standard deviation of
    the noise of the wheel speed in m/s (of the slip, where there is no vehicle speed), 0 for an
    exact slip; by default it is estimated where there is time_s. `progress` is called with words
    and the share done. InputError names all that is wrong with the data. Source: restricted maximum
    likelihood, Patterson and Thompson 1971; the weights of the curves by pseudo Bayes factors,
    Geisser and Eddy 1979.
    """
    logs = events_of(all_of(data, columns, wheel_radius), events)
    citation = " ".join(filter(None, map(citation_of, parts_of(data))))
    return identify_chosen(logs, curves, citation, by, slip_noise, progress)


@as_in_commands
def identify_chosen(
    logs: Sequence[Chosen],
    curves: str | Sequence[str] | Mapping[str, Curve],
    citation: str,
    by: str | None = None,
    slip_noise: float | None = None,
    progress: Callable[[str, float], None] = silent,
) -> Identification:
    """The same of rows that were read and chosen before, of sets with this citation."""
    chosen = _curves(curves)
    points = as_one([log.points for log in logs])
    check_curve(points)
    record = to_record(points)
    lacking = {name: missing_columns(curve, record.conditions) for name, curve in chosen.items()}
    not_fitted = {name: lacks for name, lacks in lacking.items() if lacks}
    if len(not_fitted) == len(chosen):
        name, lacks = next(iter(not_fitted.items()))
        raise InputError(
            f"{points.name} lacks the column {listed(lacks)}, which the curve {name} needs; "
            "add it or name another curve."
        )
    grouping = group([points])
    labels = None if by is None else _labels(points, by, grouping.run)
    velocity = points.slip == "slip_velocity_mps"
    found, slip = fit_curves(chosen, record, grouping.run, velocity, slip_noise, progress)
    fits = {name: of_numbers(fit) for name, fit in found.items()}
    residuals = {name: residual_structure(fit, record) for name, fit in fits.items()}
    identified = Identification(
        points,
        logs,
        citation,
        fits,
        not_fitted,
        residuals,
        answered(fits),
        slip,
        grouping.names,
        None,
    )
    if labels is None or by is None:
        return identified
    return replace(identified, comparison=compared(identified.fit, labels, by))


def _labels(points: Measured, by: str, run: np.ndarray) -> pd.Series:
    """The group of every run, in the order of the runs."""
    table = points.table
    if by not in table and by != "run":
        raise InputError(
            f"{points.name} has no column {by} to compare by; there are "
            f"{', '.join(table.columns.astype(str)[:12])}."
        )
    column = table[by] if by in table else pd.Series(run + 1, table.index)
    labels = column.astype(str).groupby(run)
    mixed = labels.nunique().to_numpy()
    if mixed.max() > 1:
        raise InputError(
            f"{points.name}: run {mixed.argmax() + 1} has several values of {by}; a run belongs to "
            "one group."
        )
    first = labels.first()
    if not 2 <= first.nunique() <= MOST_GROUPS:
        raise InputError(
            f"{points.name} has {first.nunique()} groups by {by}; from 2 to {MOST_GROUPS} can be "
            "compared."
        )
    return first


def _curves(curves: str | Sequence[str] | Mapping[str, Curve]) -> Mapping[str, Curve]:
    if isinstance(curves, Mapping):
        return curves
    names = [curves] if isinstance(curves, str) else curves
    unknown = [name for name in names if name not in CURVES]
    if unknown or not names:
        raise InputError(
            f"There is no curve {listed(unknown) if unknown else 'named'}; name some of "
            f"{', '.join(CURVES)}, or give curves of your own by name."
        )
    return {name: CURVES[name] for name in names}
