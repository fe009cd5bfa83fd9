"""`identify`: which adhesion curve measured points follow."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from adhesion_jax.curves import BASES, CURVES, Curve
from adhesion_jax.curves.bent import Bent
from adhesion_jax.data import as_one, check_curve, to_record
from adhesion_jax.data.columns import GROUP, guess
from adhesion_jax.data.forces import Corrections
from adhesion_jax.data.grouping import group
from adhesion_jax.data.stretches import usual_step
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.effects.saved import NO_TIME, save_law
from adhesion_jax.errors import InputError
from adhesion_jax.files import METADATA, output_directory, write_table
from adhesion_jax.inference.fit import missing_columns
from adhesion_jax.library.reading import Data, chosen_of, citation_of, parts_named, parts_of
from adhesion_jax.library.results import columns_of, of_numbers, recorded, text_html, written
from adhesion_jax.measured.answer import Estimate, answered, fit_curves
from adhesion_jax.measured.groups import AUTO, asked_of, branches_of, labels_of, split
from adhesion_jax.measured.residual import residual_structure
from adhesion_jax.measured.vetoes import judged, standing
from adhesion_jax.plugins import add
from adhesion_jax.report.events import draw_events
from adhesion_jax.report.measured.figure import draw_comparison, measured_figure
from adhesion_jax.report.measured.words import (
    Identified,
    answer_lines,
    curve_rows,
    in_lines,
    page,
    parameter_rows,
    printed_table,
    short_report,
    verdict,
)
from adhesion_jax.report.page import CAPTIONS
from adhesion_jax.report.rendering import write_page
from adhesion_jax.runtime import as_in_commands, silent
from adhesion_jax.wording import listed

#: The files of an identification.
IDENTIFY_FILES = (
    "curves.csv",
    "parameters.csv",
    "law.json",
    "verdict.txt",
    "report.html",
    "runs.csv",
    METADATA,
    *CAPTIONS["identify"],
)


class Param(NamedTuple):
    """A parameter of a fitted curve and its standard error; NaN where it is held."""

    value: float
    se: float


@dataclass(frozen=True, eq=False, repr=False)
class Identification(Identified):
    """What measured points say of the peak, and of every curve that was fitted to them.

    Slips are ratios, or in m/s where the points have a slip velocity and no vehicle speed.
    Intervals are of 95 %, whatever the noise of a run depends on. `best` predicts best what is left
    out. With `vetoes` no number stands for the peak; where the points show none, mu_max is what
    they reach at least, its interval is open, and there is no slip_opt.

    Attributes:
        measured: the points, with the columns that were derived.
        logs: the rows that were used of each table, and the slip events they are.
        citation: of a set that ships.
        fits: the fit of each curve, by its name.
        not_fitted: the columns that a curve needs and the points lack, by its name.
        residuals: what each curve leaves, by its name.
        answer: the peak, with the choice of the curve.
        judgement: what forbids an answer, and whether the points show a peak.
        slip: the noise of the slip that the fits assume.
        runs: their names; one for points without runs.
        comparison: that of runs, or of groups of rows, if it was asked for.
        groups: the peak of each group by itself, where there are a few.
        branches: traction and braking compared, where both were measured.
        in_vain: columns that were looked at for groups, of which none predicts.
        mixed: the levels by a column that nobody named and that predicts them.
    """

    @property
    def table(self) -> pd.DataFrame:
        """A row a curve: fit, peak, status, weight, noise."""
        return curve_rows(self)

    @property
    def parameters(self) -> pd.DataFrame:
        """A row for each parameter of each curve: value, standard error, unit, meaning."""
        return parameter_rows(self.fits)

    @property
    def params(self) -> Mapping[str, Param]:
        """The parameters of the best curve by their names."""
        rows = parameter_rows({self.best: self.fit})
        values = zip(rows["value"], rows["se"], strict=True)
        return dict(zip(rows["parameter"], map(Param._make, values), strict=True))

    @property
    def vetoes(self) -> Sequence[str]:
        """Sentences that forbid an answer; none for most measurements."""
        return self.judgement.vetoes

    @property
    def curve(self) -> Bent:
        """The best curve with its departure, whose peak the table has: `curve(0.02)`.

        Where it needs more than the slip: `curve(0.02, found.conditions)`.
        """
        return of_numbers(self.fit.law.bent)

    @property
    def conditions(self) -> Mapping[str, float]:
        """What the curve needs beside the slip, at its medians: the peak is under these."""
        return self.fit.conditions

    @property
    def mu_max(self) -> float:
        """The largest adhesion, by all curves together; NaN with a veto."""
        return self._told[0].value

    @property
    def mu_max_interval(self) -> tuple[float, float]:
        """It includes the choice of the curve; open where the points show no peak."""
        return self._told[0].low, self._told[0].high

    @property
    def _told(self) -> tuple[Estimate, Estimate]:
        """The largest adhesion and its slip."""
        return standing(self.answer, self.judgement)

    @property
    def slip_opt(self) -> float:
        """The slip of the largest adhesion; NaN where the points show no peak."""
        return self._told[1].value

    @property
    def slip_opt_interval(self) -> tuple[float, float]:
        """It includes the choice of the curve; NaN where the points show no peak."""
        return self._told[1].low, self._told[1].high

    @property
    def verdict(self) -> str:
        """In words: what forbids an answer, the curve, the noise, what is left, what to doubt."""
        return in_lines(verdict(self))

    def write(self, folder: str | PathLike[str]) -> None:
        """The files IDENTIFY_FILES, as the command writes them; those of runs if compared.

        law.json has the best curve with its departure, as `load_law` reads it.
        """
        path = output_directory(Path(folder))
        write_table(path / "curves.csv", self.table)
        write_table(path / "parameters.csv", self.parameters)
        (path / "verdict.txt").write_text(f"{self}\n", encoding="utf-8")
        law = CorrectedLaw(self.curve, (), {}, NO_TIME, self.measured.slip)
        save_law(path / "law.json", law)
        self.plot().savefig(path / "curves.png", dpi=150)
        draw_events(path, self.logs)
        if self.comparison is not None:
            write_table(path / "runs.csv", self.comparison.table)
            draw_comparison(path / "runs.png", self.title, self.comparison)
        drawn = [name for name in CAPTIONS["identify"] if (path / name).exists()]
        write_page(path, page(self, drawn))

    @as_in_commands
    def plot(self) -> Figure:
        """The points, the curves, their peak with its intervals, and what the curves leave."""
        return measured_figure(self)

    def report(self) -> str:
        """The peak, the best curve and its parameters in a few lines; `verdict` has the rest."""
        return short_report(self)

    def __repr__(self) -> str:
        return f"{answer_lines(self)}\n\n{printed_table(self)}\n\n{self.verdict}"

    def _repr_html_(self) -> str:
        table = self.table.to_html(index=False)
        return text_html(answer_lines(self)) + table + text_html(self.verdict)


@recorded
@as_in_commands
def identify(
    data: Data | Sequence[Data],
    curves: str | Sequence[str] | Mapping[str, Curve] | None = None,
    columns: Mapping[str, object] | None = None,
    wheel_radius: float | None = None,
    events: bool | None = None,
    by: str | None = None,
    slip_noise: float | None = None,
    progress: Callable[[str, float], None] = silent,
    delays: Mapping[str, float] | None = None,
    inertia: float | None = None,
    gear_ratio: float | None = None,
    efficiency: float = 1.0,
    axles: bool = False,
    out: str | PathLike[str] | None = None,
) -> Identification:
    """Fit adhesion curves that may bend to measured points, whatever their noise depends on.

    Of a long log only its slip events are used, as runs. Runs are told by a column run, or by gaps
    in time_s; with time_s the points of a run are in their order. Source: least squares with
    Huber's loss 1964; covariance by clusters, Bell and McCaffrey 2002, and by cosines, Lazarus et
    al. 2018; weights of the curves by pseudo Bayesian model averaging, Yao et al. 2018.

    Args:
        data: a table with a row a point, arrays by name, or a file, a folder or a pattern; several
            as a list. Columns are slip_ratio (or slip_velocity_mps, or the speeds of train and
            wheel, m/s) and adhesion (or force and load, N), by any name that is known.
        curves: names of CURVES, or curves of your own by name, which stay in CURVES; all of them if
            none is named.
        columns: what columns are where names and units do not tell, `{"speed": "v [km/h]"}`; a
            minus turns a sign, `{"wheel_load": "-FZ"}`, and a number is a constant.
        wheel_radius: rolling radius, m, for a slip from the rotation of the wheel.
        events: whether the slip events are cut out; by default they are in a long log.
        by: a column whose groups of rows are compared, `run`, or `auto` for the best one.
        slip_noise: standard deviation of the noise of the wheel speed, m/s (of the slip, where
            there is no vehicle speed), 0 for an exact slip; estimated where there is time_s.
        progress: called with words and the share that is done.
        delays: how late signals are, s, as in `{"vehicle_speed": 0.2}`.
        inertia: that of a wheelset with all that turns with it, kg m2, taken off its force.
        gear_ratio: turns of the motor for one of the wheel, where its torque was measured.
        efficiency: that of the gear between motor and wheel, a share.
        axles: columns of one quantity with an index are those of axles, one below the other.
        out: a folder for the files of the command of the same name.

    Returns:
        The peak with its intervals, all curves, and what to doubt.

    Raises:
        InputError: something cannot be used; the sentence names all that is wrong with the data.
    """
    known = Corrections(wheel_radius, delays or {}, inertia, gear_ratio, efficiency, axles)
    logs = chosen_of(data, with_groups(columns or {}, by), known, events)
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
    # A column of more labels than a search takes is compared by all the same.
    points = points._replace(left_out={n: why for n, why in points.left_out.items() if n != by})
    grouping, by = group(points), asked_of(points, by)
    labels = labels_of(points, by, grouping.run) if by not in (None, AUTO) else None
    velocity = points.slip == "slip_velocity_mps"
    found = fit_curves(chosen, record, grouping.run, velocity, slip_noise, progress)
    found = found._replace(curves={name: of_numbers(fit) for name, fit in found.curves.items()})
    fits, rows, answer = found.curves, found.rows, answered(found.curves)
    time = points.table.get("time_s")
    step = None if time is None else usual_step(time.to_numpy(float), np.zeros(len(time)))
    branches = branches_of(fits[found.best], rows)
    parts = split(points, by, labels, found, record, grouping.run, slip_noise, step)
    identified = Identification(
        points,
        logs,
        " ".join(filter(None, map(citation_of, parts_of(data)))),
        fits,
        not_fitted,
        {name: residual_structure(fit, rows) for name, fit in fits.items()},
        answer,
        judged(fits, answer, rows, step, branches),
        found.slip,
        grouping.names,
        parts.comparison,
        parts.groups,
        branches,
        parts.in_vain,
        parts.mixed,
    )
    understood = columns_of([log.points for log in logs])
    return written(identified, out, IDENTIFY_FILES, understood, vetoes=[*identified.vetoes])


def with_groups(columns: Mapping[str, object], by: str | None) -> Mapping[str, object]:
    """What is said of columns, with a column to compare by as labels, which may be text.

    A column that is read without that, such as axle or temperature_C, is compared by as it is.
    """
    if by in (None, AUTO) or guess(by).quantity:
        return columns
    return {**columns, GROUP: by}


def _curves(curves: str | Sequence[str] | Mapping[str, Curve] | None) -> Mapping[str, Curve]:
    if curves is None:
        return dict(CURVES)
    if isinstance(curves, Mapping):
        forms = {type(known) for known in BASES.values()}
        add("curve", {name: own for name, own in curves.items() if type(own) not in forms})
        return curves
    return parts_named("curve", "curves", curves, CURVES)
