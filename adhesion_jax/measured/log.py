"""A log sample by sample, and the initial slope of its curve, which online methods are told."""

from collections.abc import Mapping
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import uniform_filter1d

from adhesion_jax.curves import CURVES, SLIP_LIMIT, Peak
from adhesion_jax.curves.base import SLIP_VELOCITY_LIMIT
from adhesion_jax.data import Measured
from adhesion_jax.data.events import events_of
from adhesion_jax.data.grouping import group
from adhesion_jax.errors import InputError
from adhesion_jax.inference.fit import MeasuredFit
from adhesion_jax.measured.answer import fit_curves
from adhesion_jax.records import Record

#: Fewest samples of a log whose slip events are cut out without being asked for.
_FEWEST = 1000

#: A sample of a slip event is used where the slip exceeds this multiple of its noise: nearer to
#: zero, noise in the slip looks like a curve with its peak there. With 5 riv gave up its past
#: falsely in 8 of 12 simulated logs of five events, with 10 and with 20 in none.
_NOISES = 10.0

#: That noise is what is left when the mean over this time is taken off: what a driver asks for
#: changes more slowly.
_WINDOW_S = 2.0

#: The standard deviation of a normal variable over the median of its size.
_NORMAL = 1.4826


class Log(NamedTuple):
    """Samples one after the other, arrays [samples]."""

    name: str
    slip: Float[np.ndarray, " samples"]  # ratio, or m/s where there is no vehicle speed
    adhesion: Float[np.ndarray, " samples"]
    time: Float[np.ndarray, " samples"] | None  # s, never decreasing
    speed: Float[np.ndarray, " samples"] | None  # m/s
    used: Int[np.ndarray, " used"]  # the samples that methods are given, in their order
    starts: Bool[np.ndarray, " used"]  # whether the one before is not the neighbour in time
    events: Float[np.ndarray, "events 2"]  # begin and end of each slip event, s
    slip_is_velocity: bool
    sentences: tuple[str, ...]  # in which order the samples come, and which are used

    @property
    def slip_unit(self) -> str:
        return " m/s" if self.slip_is_velocity else ""

    @property
    def slip_limit(self) -> float:
        """Largest slip at which a peak is looked for."""
        return SLIP_VELOCITY_LIMIT if self.slip_is_velocity else SLIP_LIMIT


def to_log(measured: Measured, wanted: bool | None = None) -> Log:
    """The samples in the order of time, and those of them that tell something of the curve.

    Runs are told as in the discovery, by the column run or by gaps in time_s. Where their times do
    not overlap, they are followed in the order of time. Where they do, each run has a clock of its
    own: they are followed as they stand in the file, and time counts on from the end of the run
    before. Rows without time_s are followed as they stand.

    Where slip events are cut out (`data.events`, which is told whether they are `wanted`), samples
    of events alone are used, and of these those whose slip exceeds `_NOISES` times the noise that
    it has between the events. Else all are used.
    """
    table = measured.table
    if "axle" in table and table["axle"].nunique() > 1:
        raise InputError(
            f"{measured.name} has {table['axle'].nunique()} axles, and a method follows one; name "
            'the columns of that axle, as by --column "wheel_speed=v_Rad1" and --column '
            '"axle_force=Z_Achse1", or a file of one.'
        )
    (chosen,) = events_of([measured], wanted, _FEWEST)
    runs = group(measured).run
    clock = table["time_s"].to_numpy(float) if "time_s" in table else None
    if clock is None:
        order, time = np.argsort(runs, kind="stable"), None
        words = "There is no time_s: the samples are followed in the order of the rows."
    else:
        order, time, words = _in_time(clock, runs)

    in_order = bool(np.all(order[1:] > order[:-1]))  # as most logs are: nothing is copied

    def column(name: str) -> Float[np.ndarray, " samples"]:
        values = table[name].to_numpy(float)
        return values if in_order else values[order]

    slip, sentences = column(measured.slip), [words]
    speed = column("vehicle_speed_mps") if "vehicle_speed_mps" in table else None
    used, spans = np.arange(slip.size), np.zeros((0, 2))
    if chosen.events is not None and time is not None:
        spans = chosen.events.table[["start_s", "end_s"]].to_numpy(float)
        used, words = _telling(time, slip, speed, spans)
        sentences += [chosen.sentence, words]
    apart = np.diff(runs[order][used]) != 0
    starts = np.concatenate([[True], apart | (np.diff(used) > 1)])
    return Log(
        measured.name,
        slip,
        column("adhesion"),
        time,
        speed,
        used,
        starts,
        spans,
        measured.slip == "slip_velocity_mps",
        tuple(sentence for sentence in sentences if sentence),
    )


def _in_time(
    clock: Float[np.ndarray, " samples"], runs: Int[np.ndarray, " samples"]
) -> tuple[Int[np.ndarray, " samples"], Float[np.ndarray, " samples"], str]:
    """The order, the time of the samples in it, and what is said of it."""
    begins = clock[np.unique(runs, return_index=True)[1]]
    ends = np.full(begins.size, -np.inf)
    np.maximum.at(ends, runs, clock)
    by_time = np.argsort(begins, kind="stable")
    if np.all(begins[by_time][1:] >= ends[by_time][:-1]):
        rank = np.argsort(by_time)
        order = np.argsort(rank[runs], kind="stable")
        return order, clock[order], "The samples are followed in the order of time."
    order = np.argsort(runs, kind="stable")
    # A run begins one usual step after the end of the one before it.
    steps = np.diff(clock[order])[np.diff(runs[order]) == 0]
    lengths = ends - begins + (np.median(steps) if steps.size else 0.0)
    shift = np.cumsum(lengths) - lengths - begins
    return (
        order,
        (clock + shift[runs])[order],
        "The times of the runs overlap, so each has a clock of its own: the runs are followed as "
        "they stand in the file, and time counts on from the end of the run before.",
    )


def _telling(
    time: Float[np.ndarray, " samples"],
    slip: Float[np.ndarray, " samples"],
    speed: Float[np.ndarray, " samples"] | None,
    spans: Float[np.ndarray, "events 2"],
) -> tuple[Int[np.ndarray, " used"], str]:
    """The samples of events whose slip is known to a share of it, and what is said of them."""
    inside = np.zeros(time.size, dtype=bool)
    for begin, end in spans:
        inside[np.searchsorted(time, begin, "left") : np.searchsorted(time, end, "right")] = True
    # Noise of the wheel speed makes a noise of the slip ratio that grows as the speed falls.
    velocity = slip if speed is None else slip * speed
    step = float(np.median(np.diff(time)))
    window = 1 + round(_WINDOW_S / step) if step > 0 else 1
    left = np.abs(velocity - uniform_filter1d(velocity, window, mode="nearest"))[~inside]
    noise = _NORMAL * float(np.median(left)) if left.size else 0.0
    used = np.flatnonzero(inside & (np.abs(velocity) > _NOISES * noise))
    return used, (
        f"Between the slip events the {'slip' if speed is None else 'slip velocity'} scatters by "
        f"{noise:.2g}{' m/s' if speed is not None else ''} around its mean over {_WINDOW_S:g} s: "
        f"the methods are given the {used.size:,} samples of the events "
        f"({100 * used.size / time.size:.2f} % of the log) in which it "
        f"exceeds {_NOISES:g} times that, for nearer to zero the noise of the slip looks like a "
        "curve."
    )


#: Cells of equal width in the root of |slip| from 0 to the largest, and the most samples of a cell:
#: a log is mostly micro-slip, and the curve is to be fitted to all of its slips.
_CELLS, _OF_A_CELL = 60, 40

#: A standard error above this share of the slope is taken as this share: the slope is positive.
_WIDEST = 0.8

#: The form of the curve that the methods have.
_FORM = "kiencke"


class InitialSlope(NamedTuple):
    """Adhesion per slip near slip 0, a0 of Kiencke's curve, and what a log says of that curve.

    `form` has the standard error that the form of the curve makes, relative to mu_max and to
    slip_opt: the difference of the peak of the fitted curve with its departure (`inference.fit`)
    from that of the curve alone. It is zero where the curve misses nothing.
    """

    value: float
    standard_error: float  # 0 where it was given
    given: bool
    fit: MeasuredFit  # of Kiencke's curve, a0 among what is fitted
    alone: Peak  # of the fitted curve, without its departure
    form: Mapping[str, float]
    samples: int  # that it was fitted to

    @property
    def fitted(self) -> tuple[float, float]:
        """The slope of the fit, and its standard error."""
        place = self.fit.curve.free.index("a0")
        value = float(self.fit.parameters[place])
        error = float(self.fit.standard_errors[place])
        # Without a standard error of its own (on its bound, without influence) it is hardly known.
        return value, error if np.isfinite(error) else _WIDEST * value

    @property
    def plausible(self) -> Float[np.ndarray, " lanes"]:
        """The slope, and where it is uncertain what lies one standard error below and above it.

        By its logarithm, so that both are positive.
        """
        if self.standard_error == 0:
            return np.array([self.value])
        share = min(self.standard_error / self.value, _WIDEST)
        return self.value * np.exp(share * np.array([0.0, -1.0, 1.0]))


def initial_slope(log: Log, given: float | None = None) -> InitialSlope:
    """The slope that was given, or a0 of Kiencke's curve fitted to samples of those used.

    They are chosen evenly in the root of |slip|, `_OF_A_CELL` at most of each of `_CELLS` cells.
    """
    chosen = log.used[_chosen(np.abs(log.slip[log.used]))]
    slip, adhesion = jnp.asarray(log.slip[chosen]), jnp.asarray(log.adhesion[chosen])
    every = jnp.ones(chosen.size, dtype=bool)
    record = Record(slip, adhesion, every, every, {})
    one_run, curve = np.zeros(chosen.size, dtype=int), {_FORM: CURVES[_FORM]}
    fits = fit_curves(curve, record, one_run, log.slip_is_velocity, given=0.0).curves
    fit = fits[_FORM]
    alone = fit.curve.peak(fit.conditions, fit.slip_limit)
    form = {"mu_max": 0.0, "slip_opt": 0.0}
    if fit.peak.found and alone.found:
        form["mu_max"] = abs(float(fit.peak.adhesion) / float(alone.adhesion) - 1)
        form["slip_opt"] = abs(float(fit.peak.slip) / float(alone.slip) - 1)
    found = InitialSlope(0.0, 0.0, given is not None, fit, alone, form, chosen.size)
    value, error = found.fitted if given is None else (given, 0.0)
    return found._replace(value=value, standard_error=error)


def _chosen(size: Float[np.ndarray, " samples"]) -> Int[np.ndarray, " chosen"]:
    """Samples in their order, spread evenly over each cell of the root of |slip|."""
    top = float(size.max())
    cell = np.minimum((np.sqrt(size / top) * _CELLS).astype(np.int8), _CELLS - 1)
    order = np.argsort(cell, kind="stable")
    count = np.bincount(cell, minlength=_CELLS)
    begin = np.cumsum(count) - count
    kept = [
        order[start + np.linspace(0, held - 1, min(held, _OF_A_CELL)).astype(int)]
        for start, held in zip(begin, count, strict=True)
        if held
    ]
    return np.sort(np.concatenate(kept))
