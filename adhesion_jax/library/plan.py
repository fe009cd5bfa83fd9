"""`plan`: how well a measurement would know the peak of an adhesion curve, before it is made."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float
from matplotlib.figure import Figure

from adhesion_jax.curves import CURVES, Law
from adhesion_jax.curves.base import SLIP_VELOCITY_LIMIT
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.errors import InputError
from adhesion_jax.files import METADATA, output_directory, write_table
from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.inference.noise import RunNoise
from adhesion_jax.library.identify import Identification
from adhesion_jax.library.results import columns_of, recorded, text_html, written
from adhesion_jax.measured.answer import log_densities
from adhesion_jax.options import NOISE
from adhesion_jax.planning.plan import (
    FEWEST_SAMPLES,
    MOST_SAMPLES,
    OwnLog,
    Plan,
    Planner,
    Present,
    Sweeps,
    Wanted,
    own_log,
)
from adhesion_jax.planning.truth import Truth, curve_of
from adhesion_jax.report.plan import plan_figure, plan_rows, told, wanted_rows
from adhesion_jax.runtime import as_in_commands
from adhesion_jax.scenarios.rail_process import steady
from adhesion_jax.scenarios.rails import RAILS
from adhesion_jax.wording import listed

#: The files of a plan.
PLAN_FILES = ("plan.csv", "plan.txt", "plan.png", "wanted.csv", METADATA)

#: Noise of the adhesion, and samples of a sweep, where neither is stated.
_SIGMA, _SAMPLES_PER_RUN = 0.01, 200

#: The smallest and the largest of the largest slips, over that of the peak or of one's own log,
#: and how many there are; numbers of samples; both where none are stated.
_SLIPS, _SAMPLES = (0.5, 4.0, 8), 100 * 2.0 ** np.arange(8)

#: Numbers of samples over that of one's own log.
_LONGER = 2.0 ** np.arange(-2.0, 6.0)

#: Number of largest slips of the map.
_MAP = 32


@dataclass(frozen=True, eq=False, repr=False)
class Planning:
    """How well the peak would be known, over the largest slip and the number of samples.

    Attributes:
        source: what is taken for the truth, in words.
        plan: the errors over the grid.
        map: the same for more largest slips.
        log: the slips and the noise of a log that was planned from.
        present: that log in the plan, and what would halve its intervals.
        wanted: the fewest samples for an error that is wanted.
    """

    source: str
    plan: Plan
    map: Plan
    log: OwnLog | None
    present: Present | None
    wanted: Wanted | None

    @property
    def table(self) -> pd.DataFrame:
        """A row for each largest slip and number of samples: relative standard errors."""
        return plan_rows(self.plan)

    @property
    def verdict(self) -> str:
        """In words and tables: the noise, the errors, and what they rest on."""
        return told(self.source, self.plan, self.log, self.present, self.wanted)

    def write(self, folder: str | PathLike[str]) -> None:
        """plan.csv, plan.txt, plan.png, and if asked for wanted.csv."""
        path = output_directory(Path(folder))
        write_table(path / "plan.csv", self.table)
        if self.wanted is not None:
            write_table(path / "wanted.csv", wanted_rows(self.plan, self.wanted))
        (path / "plan.txt").write_text(f"{self.verdict}\n", encoding="utf-8")
        self.plot().savefig(path / "plan.png", dpi=150)

    def plot(self) -> Figure:
        """The errors of mu_max and slip_opt over the largest slip and the number of samples."""
        return plan_figure(self.source, self.map, self.present, self.wanted)

    def __repr__(self) -> str:
        return self.verdict

    def _repr_html_(self) -> str:
        return text_html(self.verdict)


#: What is taken for the truth in words, all that a plan depends on, and the log it is from.
_Settled = tuple[str, Planner, OwnLog | None]


@recorded
@as_in_commands
def plan(
    source: str | Law | Identification,
    *,
    largest_slips: Sequence[float] | None = None,
    samples: Sequence[float] | Sequence[int] | None = None,
    samples_per_run: int | None = None,
    sigma: float | None = None,
    autocorrelation: float | None = None,
    run_scatter: float | None = None,
    slow_level: float | None = None,
    slow_rows: float | None = None,
    slip_noise: float | None = None,
    conditions: Mapping[str, float] | None = None,
    want: float | None = None,
    out: str | PathLike[str] | None = None,
) -> Planning:
    """How far the slip must go, and how many samples it takes, until the peak is known.

    Source: sandwich covariance of weighted least squares (White 1980, Econometrica 48:817-838) with
    the delta method.

    Args:
        source: what is taken for the truth: a rail by its name, a curve, a law, or what `identify`
            found in a log, whose slips and noise are then those of the plan.
        largest_slips: two or more to which the slip may go, ratios.
        samples: two or more numbers of samples.
        samples_per_run: samples of a run, in which the slip rises from 0 to the largest.
        sigma: standard deviation of the noise of adhesion.
        autocorrelation: correlation of that noise from sample to sample.
        run_scatter: standard deviation of the level of a run, as a share of the adhesion.
        slow_level: the same of a level that varies slowly within a run.
        slow_rows: samples after which the correlation of that level has fallen to 1/e.
        slip_noise: standard deviation of the noise of the slip, in its unit; where `source` has a
            vehicle speed that of the wheel speed, m/s.
        conditions: those of the peak, by column, in SI units.
        want: a relative standard error of mu_max, for which the fewest samples are searched.
        out: a folder for the files of the command of the same name.

    Returns:
        Relative standard errors of the peak over largest slip and number of samples.

    Raises:
        InputError: something does not fit.
    """
    stated = _stated(
        sigma=sigma,
        autocorrelation=autocorrelation,
        run_scatter=run_scatter,
        slow_level=slow_level,
        slow_rows=slow_rows,
        slip_noise=slip_noise,
    )
    if want is not None and not 0 < want < 1:
        raise InputError(f"want is a share of mu_max between 0 and 1, as 0.01, not {want:g}.")
    words, of, log = _settled(source, stated, conditions or {}, samples_per_run)
    slips, numbers = _grid(of, log, largest_slips, samples)
    planned = Planning(
        words,
        of.plan(slips, numbers),
        of.plan(np.geomspace(slips[0], slips[-1], _MAP), numbers),
        log,
        of.present(log.largest_slip, log.samples, log.runs) if log else None,
        of.wanted(slips, want) if want else None,
    )
    logs = source.logs if isinstance(source, Identification) else ()
    return written(planned, out, PLAN_FILES, columns_of([one.points for one in logs]))


def _settled(
    source: str | Law | Identification,
    stated: Mapping[str, float],
    conditions: Mapping[str, float],
    samples_per_run: int | None,
) -> _Settled:
    if isinstance(source, Identification):
        if samples_per_run is not None:
            raise InputError("samples_per_run does not go with a log, which has runs of its own.")
        name, fit = _best_with_peak(source)
        log = own_log(fit, source.measured, stated)
        _refuse_strange(conditions, dict.fromkeys(log.truth.conditions, (-math.inf, math.inf)))
        truth = log.truth._replace(conditions={**log.truth.conditions, **conditions})
        words = f"{name} as fitted to {Path(source.measured.name).name}"
        return words, Planner(truth, _complete(log.noise), log.design), log
    words, truth = _truth(source, conditions)
    runs = Sweeps(_SAMPLES_PER_RUN if samples_per_run is None else samples_per_run)
    if samples_per_run is not None and samples_per_run < 2:
        raise InputError(f"samples_per_run is 2 or more, not {samples_per_run}.")
    noise = _complete(RunNoise(**{"sigma": _SIGMA, **stated}))
    return words, Planner(truth, noise, runs), None


def _complete(noise: RunNoise) -> RunNoise:
    """InputError for a slow level of which either its size or how slow it is is not known."""
    if bool(noise.slow_level) != bool(noise.slow_rows):
        there, other = ["slow_level", "slow_rows"][:: 1 if noise.slow_level else -1]
        raise InputError(
            f"{there} is stated without {other}; a slow level has a size, slow_level, and a number "
            "of samples after which its correlation has fallen to 1/e, slow_rows: state both."
        )
    return noise


def _truth(source: str | Law, conditions: Mapping[str, float]) -> tuple[str, Truth]:
    if isinstance(source, str):
        words = f"Burckhardt's curve on {source} rail (He et al. 2018)"
        truth = steady(RAILS, source).curve
        _refuse_strange(conditions, {})
        return words, Truth(truth, {})
    of_curve = dict.fromkeys(curve_of(source).NEEDS, (-math.inf, math.inf))
    if isinstance(source, CorrectedLaw):
        ranges = {name: (float(low), float(high)) for name, (low, high) in source.ranges.items()}
        _refuse_strange(conditions, {**of_curve, **ranges})
        middle = {name: (low + high) / 2 for name, (low, high) in ranges.items()}
        words = "the law with effects" if source.effects else "the law that was identified"
        of_slip = (SLIP_VELOCITY_LIMIT, " m/s") if source.slip == "slip_velocity_mps" else ()
        return words, Truth(source, {**middle, **conditions}, *of_slip)
    _refuse_strange(conditions, of_curve)
    names = [name for name, known in CURVES.items() if type(known) is type(source)]
    return names[0] if names else type(source).__name__, Truth(source, dict(conditions))


def _refuse_strange(
    conditions: Mapping[str, float], ranges: Mapping[str, tuple[float, float]]
) -> None:
    """InputError for a condition that the law does not have, or one outside its range."""
    for name, value in conditions.items():
        if name not in ranges:
            there = f"whose conditions are {listed([*ranges])}" if ranges else "which has none"
            raise InputError(f"{name} is no condition of the law, {there}.")
        low, high = ranges[name]
        if not low <= value <= high:
            raise InputError(
                f"The law was found with {name} from {low:g} to {high:g}, and says nothing of "
                f"{value:g}."
            )


def _best_with_peak(found: Identification) -> tuple[str, MeasuredFit]:
    """The curve that predicts best what was left out, of those with a peak and its errors."""
    fits = {
        name: fit
        for name, fit in found.fits.items()
        if fit.curve.peak(fit.conditions, fit.slip_limit).found
    }
    why = " ".join(found.vetoes) or found.judgement.why
    if why or not fits:
        none = f"No curve that was fitted to {found.measured.name} has a peak."
        raise InputError(
            f"{why if fits else none} So there is no mu_max to plan for; plan from a named rail, "
            "as --rail common."
        )
    densities = log_densities(found.fits)
    name = max(fits, key=lambda name: densities[name])
    return name, fits[name]


def _stated(**asked: float | None) -> dict[str, float]:
    stated = {name: float(value) for name, value in asked.items() if value is not None}
    for name, value in stated.items():
        if not NOISE[name].holds(value):
            raise InputError(f"{name} is a number {NOISE[name].range()}, not {value:g}.")
    return stated


def _slips(slip_opt: float, present: float | None, limit: float) -> Float[np.ndarray, " slips"]:
    """Round slips on both sides of the peak and of the present largest slip, which is one."""
    low, high = (_SLIPS[0] * min(slip_opt, present or slip_opt), _SLIPS[1] * (present or slip_opt))
    slips = [float(f"{slip:.2g}") for slip in np.geomspace(low, min(high, limit), _SLIPS[2])]
    return np.unique([*np.minimum(slips, limit), *([present] if present else [])])


def _grid(
    of: Planner,
    log: OwnLog | None,
    largest_slips: Sequence[float] | None,
    samples: Sequence[float] | Sequence[int] | None,
) -> tuple[Float[np.ndarray, " slips"], Float[np.ndarray, " numbers"]]:
    """The largest slips and numbers of samples that are stated, or some that suit."""
    truth, peak = of.truth, of.peak
    if largest_slips is not None:
        slips = np.unique(np.asarray(largest_slips, float))
    else:
        slips = _slips(peak.slip_opt, log.largest_slip if log else None, truth.slip_limit)
    if samples is not None:
        numbers = np.asarray(samples, float)
    else:
        numbers = np.maximum(log.samples * _LONGER if log else _SAMPLES, FEWEST_SAMPLES)
    numbers = np.unique(np.round(numbers))
    if slips.size < 2 or not np.all((slips > 0) & (slips <= truth.slip_limit)):
        raise InputError(
            f"The largest slips are two or more between 0 and {truth.slip_limit:g}"
            f"{truth.slip_unit}, where the peak is searched."
        )
    if numbers.size < 2 or not np.all((numbers >= FEWEST_SAMPLES) & (numbers <= MOST_SAMPLES)):
        raise InputError(
            f"Numbers of samples are two or more from {FEWEST_SAMPLES} to {MOST_SAMPLES}."
        )
    return slips, numbers
