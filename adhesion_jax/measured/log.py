"""A measured table as one log: its samples in the order in which they are followed."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import uniform_filter1d

from adhesion_jax.curves import SLIP_LIMIT
from adhesion_jax.curves.base import SLIP_VELOCITY_LIMIT
from adhesion_jax.data import Measured
from adhesion_jax.data.events import events_of
from adhesion_jax.data.grouping import group
from adhesion_jax.errors import InputError

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
            'the columns of that axle, as by --column "wheel_speed=v_Rad1", or a file of one.'
        )
    (chosen,) = events_of([measured], wanted, _FEWEST)
    runs = group([measured]).run
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
