"""`identify`: which adhesion curve measured points follow."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import pandas as pd

from adhesion_jax.curves import CURVES, Curve
from adhesion_jax.data import Measured, check_curve, to_record
from adhesion_jax.data.events import Chosen, Events, events_of
from adhesion_jax.errors import InputError
from adhesion_jax.files import write_table
from adhesion_jax.library.reading import Data, citation_of, measured_of
from adhesion_jax.library.results import of_numbers, text_html
from adhesion_jax.measured.fit import MeasuredFit, fit_all, missing_columns
from adhesion_jax.measured.residual import Residual, residual_structure
from adhesion_jax.report.events import EVENTS_FIGURE, draw_events
from adhesion_jax.report.measured.figure import draw_measured
from adhesion_jax.report.measured.words import curve_rows, printed_table, verdict
from adhesion_jax.runtime import in_double_precision
from adhesion_jax.wording import listed

#: The files of an identification.
IDENTIFY_FILES = ("curves.csv", "verdict.txt", "curves.png", EVENTS_FIGURE)


@dataclass(frozen=True, eq=False, repr=False)
class Identification:
    """What measured points say of every curve that was fitted to them; `best` has the least BIC.

    Slips are ratios, or in m/s where the points have a slip velocity and no vehicle speed.
    Intervals are of 95 % and take the slip as exact and the noise as independent.
    """

    measured: Measured  # the points, with the columns that were derived
    events: Events | None  # slip events that the points were cut out of; None where all were used
    used: str  # which rows of a log are used, and why
    citation: str  # of a set that ships
    fits: Mapping[str, MeasuredFit]  # by the name of the curve
    not_fitted: Mapping[str, Sequence[str]]  # curve to the columns it needs and the points lack
    residuals: Mapping[str, Residual]  # what each curve leaves

    @property
    def table(self) -> pd.DataFrame:
        """A row a curve: fit, peak, status, and the parameters with their standard errors."""
        return curve_rows(self.fits, self.not_fitted)

    @property
    def best(self) -> str:
        """The name of the curve that describes the points best by BIC."""
        return min(self.fits, key=lambda name: self.fits[name].bic)

    @property
    def fit(self) -> MeasuredFit:
        """The fit of the best curve, with covariance and status."""
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
        """The largest adhesion."""
        return float(self.fit.peak.adhesion)

    @property
    def mu_max_interval(self) -> tuple[float, float]:
        half = self.fit.quantile * self.fit.mu_max_se
        return self.mu_max - half, self.mu_max + half

    @property
    def slip_opt(self) -> float:
        """The slip of the largest adhesion; without a peak the end of the range looked at."""
        return float(self.fit.peak.slip)

    @property
    def slip_opt_interval(self) -> tuple[float, float]:
        """NaN where the curve has no peak."""
        half = self.fit.quantile * self.fit.slip_opt_se
        return self.slip_opt - half, self.slip_opt + half

    @property
    def verdict(self) -> str:
        """In words: the best curve, its peak, what is left over, and what not to trust."""
        left = self.residuals[self.best]
        remarks = " ".join(filter(None, (self.used, self.citation)))
        return verdict(self.measured, remarks, self.fits, self.not_fitted, left)

    def write(self, folder: str | PathLike[str]) -> None:
        """The files IDENTIFY_FILES, as the command writes them."""
        path = Path(folder)
        path.mkdir(parents=True, exist_ok=True)
        write_table(path / "curves.csv", self.table)
        (path / "verdict.txt").write_text(f"{self.verdict}\n", encoding="utf-8")
        title = Path(self.measured.name).name
        draw = in_double_precision(draw_measured)
        draw(path / "curves.png", title, self.fits, self.residuals)
        draw_events(path, [Chosen(self.measured, self.events, self.used)])

    def __repr__(self) -> str:
        return f"{printed_table(self.fits)}\n\n{self.verdict}"

    def _repr_html_(self) -> str:
        return self.table.to_html(index=False) + text_html(self.verdict)


def identify(
    data: Data,
    curves: str | Sequence[str] | Mapping[str, Curve] = tuple(CURVES),
    columns: Mapping[str, object] | None = None,
    wheel_radius: float | None = None,
    events: bool | None = None,
) -> Identification:
    """Fit adhesion curves to measured points by least squares over their physical boxes.

    `data` has a row a point, with the columns slip_ratio (or slip_velocity_mps) and adhesion (or
    tangential_force_N with normal_load_N), and whatever else a curve needs, in SI units. `columns`
    says which columns these are where they have other names or units, as in {"speed": "v [km/h]"},
    and `wheel_radius` is in m, for a slip from the rotation of the wheel. `curves` are names of
    CURVES, or curves of your own by name. Of a long log only its slip events are used, as runs
    (`data.events`), unless `events` is False; with True a short one is cut as well. InputError
    names all that is wrong with the data. Source: least squares by differential evolution and
    Levenberg-Marquardt; intervals by the delta method, BIC after Schwarz 1978.
    """
    (log,) = events_of([measured_of(data, columns, wheel_radius)], events)
    return identify_chosen(log, curves, citation_of(data))


@in_double_precision
def identify_chosen(
    log: Chosen, curves: str | Sequence[str] | Mapping[str, Curve], citation: str
) -> Identification:
    """The same of rows that were read and chosen before, of a set with this citation."""
    chosen = _curves(curves)
    points = log.points
    check_curve(points)
    record = to_record(points)
    lacking = {name: missing_columns(curve, record) for name, curve in chosen.items()}
    not_fitted = {name: lacks for name, lacks in lacking.items() if lacks}
    if len(not_fitted) == len(chosen):
        name, lacks = next(iter(not_fitted.items()))
        raise InputError(
            f"{points.name} lacks the column {listed(lacks)}, which the curve {name} needs; "
            "add it or name another curve."
        )
    found = fit_all(chosen, record, points.slip == "slip_velocity_mps")
    fits = {name: of_numbers(fit) for name, fit in found.items()}
    table = points.table
    runs = table["run"] if "run" in table else pd.Series(0, table.index)
    numbers = pd.factorize(runs)[0]
    residuals = {name: residual_structure(fit, record, numbers) for name, fit in fits.items()}
    return Identification(points, log.events, log.sentence, citation, fits, not_fitted, residuals)


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
