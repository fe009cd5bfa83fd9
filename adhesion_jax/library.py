"""The package from Python: what the commands do, as functions of data frames.

They compute in double precision, whatever jax is set to in the program around them, and leave its
precision, its flags and its environment as they are. What they are given and cannot use they refuse
by an InputError of one sentence.
"""

import html
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Float

from adhesion_jax.campaign.config import Config, choose_identifiers
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.curves import CURVES, Curve
from adhesion_jax.data import (
    SHIPPED,
    Measured,
    RunSet,
    check_curve,
    matching,
    read_measured,
    read_runs,
    table_of,
    to_measured,
    to_record,
    to_runs,
)
from adhesion_jax.discovery.engine import discover as find
from adhesion_jax.discovery.types import Findings
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.effects.saved import law_text
from adhesion_jax.errors import InputError
from adhesion_jax.files import write_table
from adhesion_jax.identifiers import IDENTIFIERS, Identifier
from adhesion_jax.measured.fit import MeasuredFit, fit_all, missing_columns
from adhesion_jax.measured.residual import Residual, residual_structure
from adhesion_jax.records import Record
from adhesion_jax.report.discovery.files import printed, write_discovery
from adhesion_jax.report.discovery.frames import effects_frame, errors_frame, ranking_frame
from adhesion_jax.report.discovery.tables import effects_table, errors_table
from adhesion_jax.report.discovery.words import verdict as discovery_verdict
from adhesion_jax.report.measured.figure import draw_measured
from adhesion_jax.report.measured.words import curve_rows, printed_table, verdict
from adhesion_jax.report.montecarlo.tables import accuracy_table
from adhesion_jax.report.page import Table
from adhesion_jax.runtime import in_double_precision, require_double_precision
from adhesion_jax.scenarios import SCENARIOS, Options, build, declared
from adhesion_jax.wording import listed

#: A table of measured points: a data frame, a file by its path, or a set that ships by its name.
Data = pd.DataFrame | str | PathLike[str]

#: The files of an identification.
IDENTIFY_FILES = ("curves.csv", "verdict.txt", "curves.png")

#: What is said for a data frame, which has no name.
_FRAME = "the data frame"

T = TypeVar("T")
L = TypeVar("L", Curve, CorrectedLaw)


@dataclass(frozen=True, eq=False, repr=False)
class Identification:
    """What measured points say of every curve that was fitted to them; `best` has the least BIC.

    Slips are ratios, or in m/s where the points have a slip velocity and no vehicle speed.
    Intervals are of 95 % and take the slip as exact and the noise as independent.
    """

    measured: Measured  # the points, with the columns that were derived
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
        return _of_numbers(self.fit.curve)

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
        return verdict(self.measured, self.citation, self.fits, self.not_fitted, left)

    def write(self, folder: str | PathLike[str]) -> None:
        """The files IDENTIFY_FILES, as the command writes them."""
        path = Path(folder)
        path.mkdir(parents=True, exist_ok=True)
        write_table(path / "curves.csv", self.table)
        (path / "verdict.txt").write_text(f"{self.verdict}\n", encoding="utf-8")
        title = Path(self.measured.name).name
        draw = in_double_precision(draw_measured)
        draw(path / "curves.png", title, self.fits, self.residuals)

    def __repr__(self) -> str:
        return f"{printed_table(self.fits)}\n\n{self.verdict}"

    def _repr_html_(self) -> str:
        return self.table.to_html(index=False) + _in_html(self.verdict)


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarlo:
    """How well methods know the truth of a scenario, over all runs.

    `tables` holds, by name, what the command writes as files: summary, and where a scenario has
    them switches, checkpoints, tracking, steady and bands.
    """

    tables: Mapping[str, pd.DataFrame]
    estimates: pd.DataFrame  # a row for each run, identifier and block

    @property
    def summary(self) -> pd.DataFrame:
        """A row for each rail, identifier and quantity: truth, bias, RMSE, bound, coverage ..."""
        return self.tables["summary"]

    def __repr__(self) -> str:
        return accuracy_table(self.summary, _quantities(self.summary))

    def _repr_html_(self) -> str:
        return self.summary.to_html(index=False)


@dataclass(frozen=True, eq=False, repr=False)
class Discovery:
    """What a curve lacks in measured runs, and how far its error falls with it."""

    findings: Findings  # everything, as the reports read it

    @property
    def law(self) -> CorrectedLaw:
        """The curve with its effects, a function of slip and conditions (columns by name).

        Conditions are scalars for a steady state, or arrays [points] of one whole run in time.
        """
        return _of_numbers(self.findings.law)

    @property
    def effects(self) -> pd.DataFrame:
        """A row for each parameter of an effect, with its 95 % interval and unit."""
        return effects_frame(self.findings)

    @property
    def errors(self) -> pd.DataFrame:
        """Root mean square error before and after, in training, cross-validation and test."""
        return errors_frame(self.findings)

    @property
    def ranking(self) -> pd.DataFrame:
        """A row for each candidate of each round, the strongest first."""
        return ranking_frame(self.findings)

    @property
    def base_parameters(self) -> pd.DataFrame:
        """The parameters of the base curve before and after."""
        return self.findings.base_parameters

    @property
    def points(self) -> pd.DataFrame:
        """A row for each training point: run, slip, adhesion, before, after and its columns."""
        return self.findings.points

    @property
    def predictions(self) -> pd.DataFrame | None:
        """A row for each row of the test data: row, base, corrected; None without a test."""
        return self.findings.predictions

    @property
    def verdict(self) -> str:
        """What is missing, how sure that is, and how much smaller the error becomes."""
        return discovery_verdict(self.findings)

    def write(self, folder: str | PathLike[str]) -> None:
        """The report.html, report.md, law.json, tables and figures that the command writes."""
        path = Path(folder)
        path.mkdir(parents=True, exist_ok=True)
        in_double_precision(write_discovery)(path, self.findings)

    def __repr__(self) -> str:
        return printed(self.findings)

    def _repr_html_(self) -> str:
        tables = (errors_table(self.findings), effects_table(self.findings))
        return _in_html(self.verdict) + "".join(_table_html(table) for table in tables)


@in_double_precision
def identify(
    data: Data, curves: str | Sequence[str] | Mapping[str, Curve] = tuple(CURVES)
) -> Identification:
    """Fit adhesion curves to measured points by least squares over their physical boxes.

    `data` has a row a point, with the columns slip_ratio (or slip_velocity_mps) and adhesion (or
    tangential_force_N with normal_load_N), and whatever else a curve needs, in SI units. `curves`
    are names of CURVES, or curves of your own by name. InputError names all that is wrong with the
    data. Source: least squares by differential evolution and Levenberg-Marquardt; intervals by the
    delta method, BIC after Schwarz 1978.
    """
    chosen = _curves(curves)
    measured, citation = _measured(data), _citation(data)
    check_curve(measured)
    record = to_record(measured)
    lacking = {name: missing_columns(curve, record) for name, curve in chosen.items()}
    not_fitted = {name: columns for name, columns in lacking.items() if columns}
    if len(not_fitted) == len(chosen):
        name, columns = next(iter(not_fitted.items()))
        raise InputError(
            f"{measured.name} lacks the column {listed(columns)}, which the curve {name} needs; "
            "add it or name another curve."
        )
    fits = _read(fit_all(chosen, record, measured.slip == "slip_velocity_mps"))
    table = measured.table
    runs = table["run"] if "run" in table else pd.Series(0, table.index)
    numbers = pd.factorize(runs)[0]
    residuals = {name: residual_structure(fit, record, numbers) for name, fit in fits.items()}
    return Identification(measured, citation, fits, not_fitted, residuals)


@in_double_precision
def montecarlo(
    scenario: str = "single",
    identifiers: str | Sequence[str] | Mapping[str, Identifier] | None = None,
    runs: int = 256,
    seed: int = 0,
    workers: int = 1,
    **options: object,
) -> MonteCarlo:
    """Identify the same noisy runs of a scenario by several methods.

    `scenario` is a name of SCENARIOS, and `options` are its arguments (rail, sigma, points ...;
    `law` is a law that was found, or the path of a saved one). `identifiers` are names of
    IDENTIFIERS, or methods of your own by name; without any, all that accept the scenario. Run r of
    a seed has the same noise whatever else is asked for. With more `workers` than one the runs are
    shared among processes, which a script must start under `if __name__ == "__main__":`.
    InputError where a name, a number or an option does not fit.
    """
    given = _options(scenario, options)
    if runs < 1 or workers < 1 or not 0 <= seed < 2**32:
        raise InputError("runs and workers are 1 or more, and a seed is from 0 to 2**32 - 1.")
    methods, names = _methods(identifiers)
    config = Config(scenario, names, given, int(runs), int(seed))
    _refuse_unsuited(config, methods)
    estimates: list[pd.DataFrame] = []
    campaign = run_campaign(config, estimates.append, _silent, workers, methods)
    return MonteCarlo(campaign.tables, pd.concat(estimates, ignore_index=True))


@in_double_precision
def discover(
    data: Data | Sequence[Data],
    test: Data | Sequence[Data] | None = None,
    base: str = "auto",
    seed: int = 0,
    slip_noise: float | None = None,
    progress: Callable[[str, float], None] | None = None,
) -> Discovery:
    """Find which effects an adhesion curve lacks in measured runs.

    `data` has the columns that `identify` takes, a column run (or time_s, from whose gaps runs are
    told) and whatever was measured beside them; several tables are taken together. `test` is
    predicted and never fitted. `base` is a name of CURVES, or auto. `seed` draws the runs that are
    held out. `slip_noise` is the standard deviation of the noise of the wheel speed in m/s, where
    it is known. `progress` is called with words and the share that is done. InputError names all
    that is wrong with the data.
    """
    runs = _runs(data)
    findings = find(
        runs,
        None if test is None else matching(runs, _runs(test)),
        base,
        seed,
        _silent if progress is None else progress,
        source=", ".join(map(_name, _several(data))),
        citation=" ".join(filter(None, map(_citation, _several(data)))),
        slip_noise=slip_noise,
    )
    return Discovery(_read(findings))


def sample(
    slip: float | Float[Array, "..."],
    adhesion: float | Float[Array, "..."],
    **conditions: float | Float[Array, "..."],
) -> Record:
    """One fresh sample, or arrays [points] of a block, as `update` of an identifier takes it.

    Slip is a ratio, adhesion is force over load, conditions are columns in SI units, such as
    time_s or vehicle_speed_mps. May be used within `jax.jit` and `jax.vmap`. InputError where jax
    computes in single precision.
    """
    require_double_precision()
    slips = jnp.atleast_1d(jnp.asarray(slip, float))

    def like_slips(values: float | Float[Array, "..."]) -> Float[Array, " points"]:
        return jnp.broadcast_to(jnp.asarray(values, float), slips.shape)

    every = jnp.ones(slips.shape, dtype=bool)
    columns = {name: like_slips(values) for name, values in conditions.items()}
    return Record(slips, like_slips(adhesion), every, every, columns)


def _silent(*_: object) -> None:
    """Reports no progress."""


def _read(result: T) -> T:
    """The result with arrays of NumPy: in a program of single precision those of jax are cut."""
    found: T = jax.tree.map(lambda x: np.asarray(x) if isinstance(x, jax.Array) else x, result)
    return found


def _of_numbers(law: L) -> L:
    """The law with numbers of Python, which have whatever precision it is called in."""
    found: L = jax.tree.map(float, law)
    return found


def _name(data: Data) -> str:
    return _FRAME if isinstance(data, pd.DataFrame) else str(data)


def _citation(data: Data) -> str:
    return SHIPPED[data].citation if isinstance(data, str) and data in SHIPPED else ""


def _measured(data: Data) -> Measured:
    name = _name(data)
    if isinstance(data, pd.DataFrame):
        return to_measured(name, table_of(data, name))
    return read_measured(_path(data))._replace(name=name)


def _path(data: str | PathLike[str]) -> Path:
    if not isinstance(data, (str, PathLike)):
        raise InputError(
            f"Data are a pandas DataFrame or the path of a file, not {type(data).__name__}."
        )
    name = str(data)
    return SHIPPED[name].path if name in SHIPPED else Path(data)


def _several(data: Data | Sequence[Data]) -> Sequence[Data]:
    return data if isinstance(data, (list, tuple)) else [data]  # type: ignore[list-item]


def _runs(data: Data | Sequence[Data]) -> RunSet:
    several = _several(data)
    paths = [one for one in several if not isinstance(one, pd.DataFrame)]
    if len(paths) == len(several):
        return read_runs([_path(one) for one in paths])
    tables = [_measured(one) for one in several]
    if len(tables) > 1:  # runs of one name are told apart by that of their table
        names = [f"table {number}" for number in range(1, len(tables) + 1)]
        tables = [table._replace(name=name) for table, name in zip(tables, names, strict=True)]
    return to_runs(tables)


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


def _methods(
    identifiers: str | Sequence[str] | Mapping[str, Identifier] | None,
) -> tuple[Mapping[str, Identifier], tuple[str, ...]]:
    """Every method that may be run, by its name, and the names of those that are asked for."""
    if identifiers is None:
        return IDENTIFIERS, ()
    if isinstance(identifiers, Mapping):
        taken = [n for n, own in identifiers.items() if IDENTIFIERS.get(n, own) is not own]
        if taken:
            raise InputError(
                f"{listed(taken)} is the name of a method of the package; name yours otherwise."
            )
        return {**IDENTIFIERS, **identifiers}, tuple(identifiers)
    names = (identifiers,) if isinstance(identifiers, str) else tuple(identifiers)
    unknown = [name for name in names if name not in IDENTIFIERS]
    if unknown:
        raise InputError(
            f"There is no identifier {listed(unknown)}; the identifiers are "
            f"{', '.join(IDENTIFIERS)}, and one of your own is given by name: {{'mine': Mine()}}."
        )
    return IDENTIFIERS, names


def _refuse_unsuited(config: Config, methods: Mapping[str, Identifier]) -> None:
    """InputError where a method that is asked for does not accept the scenario."""
    scenario = build(config.scenario, config.options)
    for name in config.identifiers:
        reason = methods[name].accepts(scenario.known)
        if reason is not None:
            raise InputError(f"{name} cannot be run on {config.scenario}: {reason}.")
    choose_identifiers(config, scenario, methods)


def _options(scenario: str, options: Mapping[str, object]) -> Options:
    """The arguments of a scenario; InputError where it takes none such."""
    if scenario not in SCENARIOS:
        raise InputError(
            f"There is no scenario {scenario}; the scenarios are {', '.join(SCENARIOS)}."
        )
    known = declared(SCENARIOS[scenario])
    needed = [name for name, one in known.items() if one.required and name not in options]
    if needed:
        raise InputError(f"The scenario {scenario} needs {listed(needed)}.")
    strange = [name for name in options if name not in known]
    if strange:
        raise InputError(f"{scenario} takes {listed([*known])}, but not {listed(strange)}.")
    return Options(**{name: _option(name, known[name], value) for name, value in options.items()})


def _option(name: str, one: Any, value: object) -> object:
    """The value of an option as a scenario takes it; InputError where it lies outside its range."""
    if one.option.is_file:
        return _law_text(name, value)
    if one.kind is str:
        return str(value)
    low, high = one.option.low, one.option.high
    try:
        number = one.kind(value)
        right = number == value and math.isfinite(number)
    except (TypeError, ValueError, OverflowError):
        right = False
    above = right and (low is None or number > low or (number == low and not one.option.low_open))
    below = right and (
        high is None or number < high or (number == high and not one.option.high_open)
    )
    if not (above and below):
        kind = "a whole number" if one.kind is int else "a number"
        ends = " ".join(
            f"{word} {end:g}" for word, end in (("from", low), ("to", high)) if end is not None
        )
        raise InputError(f"{name} is {kind} {ends}, not {value!r}.")
    return number


def _law_text(name: str, value: object) -> str:
    if isinstance(value, CorrectedLaw):
        return law_text(value)
    try:
        return Path(str(value)).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        raise InputError(f"{name} {value} cannot be read; give a law or the path of one.") from None


def _quantities(summary: pd.DataFrame) -> tuple[str, ...]:
    there = tuple(dict.fromkeys(summary["quantity"]))
    return ("mu_max",) if "mu_max" in there else there


def _in_html(text: str) -> str:
    return f"<pre style='white-space: pre-wrap'>{html.escape(text)}</pre>"


def _table_html(table: Table) -> str:
    return pd.DataFrame(list(table.rows), columns=list(table.headings)).to_html(index=False)
