"""The errors of the measured slip: how large they are, and the slip to be expected."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from adhesion_jax.curves import Conditions
from adhesion_jax.effects.slip_likelihood import FALLS_WITH, SlipSignal, likeliest
from adhesion_jax.effects.slip_noise import SlipNoise, expected_slip
from adhesion_jax.programs import kept
from adhesion_jax.records import Record

#: Largest number of stretches, evenly chosen, by which the size of the noise is judged, and the
#: number of points of each.
_STRETCHES, _LENGTH = 16, 256

#: Number of stretches in which the slip is smoothed at a time, of points of a stretch, and of those
#: before and after it whose own result is not used: far more than the smoother reaches.
_AT_A_TIME, _INNER, _LEAD = 16, 896, 64

#: Least vehicle speed by which the noise of a wheel speed is divided, m/s.
_SLOWEST = 0.1


class SlipErrors(NamedTuple):
    """What is known of the slip of every point, [points], and of the noise of its signal."""

    slip: Float[np.ndarray, " points"]  # to be expected, given all measured ones of the run
    unknown: Float[np.ndarray, " points"]  # its variance about the expected one
    noise: Float[np.ndarray, " points"]  # variance that a point is weighed by
    sigma: float  # standard deviation of the noise of the signal; 0 for an exact slip
    low: float  # of its 95 % interval
    high: float
    falls_with: str  # the column that the noise is divided by; "" for none


def exact(record: Record) -> SlipErrors:
    slip = np.asarray(record.slip)
    nothing = np.broadcast_to(0.0, slip.shape)
    return SlipErrors(slip, nothing, nothing, 0.0, 0.0, 0.0, "")


def likely_errors(
    record: Record, run: Int[np.ndarray, " points"], given: float | None
) -> SlipErrors | None:
    """The errors of the slip if its signal has white noise; None where nothing tells of them.

    `given` is the standard deviation of the noise of the wheel speed in m/s (of the slip, where
    there is no vehicle speed). Where it is not, its size is estimated from the course of the slip
    in time. Without an order in time the slip to be expected is the measured one: its errors are
    taken to lie evenly about it, as they do where slips are spread evenly.
    """
    in_time = "time_s" in record.conditions
    if given is None and not in_time:
        return None
    names = [name for name in FALLS_WITH if not name or name in record.conditions]
    if len(names) > 1 and np.ptp(record.conditions[names[0]]) == 0:
        names = names[:1]  # the two cannot be told apart
    names = names if given is None else names[:1]
    slip = np.asarray(record.slip)
    if not in_time:
        sigma = given or 0.0
        speed = np.maximum(record.conditions[names[0]], _SLOWEST) if names[0] else np.array(1.0)
        variance = np.broadcast_to((sigma / speed) ** 2, slip.shape)
        return SlipErrors(slip, variance, variance, sigma, sigma, sigma, names[0])
    some = _some(record, run)
    single = np.ones(some.slip.shape)
    signal = min((likeliest(some, single, name, given) for name in names), key=_loss)
    smoothed, unknown = _smoothed(signal.effect, record, run)
    return SlipErrors(
        smoothed,
        unknown,
        unknown,
        float(signal.effect.sigma),
        signal.low,
        signal.high,
        signal.effect.falls_with,
    )


def _loss(signal: SlipSignal) -> float:
    return signal.loss


def _some(record: Record, run: np.ndarray) -> Record:
    """Evenly chosen stretches of the runs, [stretches, points], the last row of each repeated."""
    rows, _ = _stretches(run, _LENGTH, 0)
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, _STRETCHES).astype(int))]
    nothing = np.full((_STRETCHES - len(rows), _LENGTH), rows[0, 0])  # the program has one size
    rows = np.concatenate([rows, nothing])
    mask = jnp.asarray(np.diff(rows, axis=1, prepend=-1) != 0)
    return Record(
        jnp.asarray(np.asarray(record.slip)[rows]),
        jnp.asarray(np.asarray(record.adhesion)[rows]),
        mask,
        mask,
        _conditions(record, rows),
    )


def _conditions(record: Record, rows: np.ndarray) -> dict[str, Array]:
    found = {}
    for name in ("time_s", *filter(None, FALLS_WITH)):
        if name in record.conditions:
            column = np.asarray(record.conditions[name])[rows]
            found[name] = jnp.asarray(column if name == "time_s" else np.maximum(column, _SLOWEST))
    return found


def _smoothed(
    noise: SlipNoise, record: Record, run: np.ndarray
) -> tuple[Float[np.ndarray, " points"], Float[np.ndarray, " points"]]:
    slip, variance = np.empty(run.size), np.empty(run.size)
    rows, inner = _stretches(run, _INNER, _LEAD)
    measured = np.asarray(record.slip)
    for first in range(0, len(rows), _AT_A_TIME):
        some = rows[np.minimum(np.arange(first, first + _AT_A_TIME), len(rows) - 1)]
        found = _expected(noise, jnp.asarray(measured[some]), _conditions(record, some))
        kept_rows = inner[first : first + _AT_A_TIME]
        expected, errors = (np.asarray(one)[: len(kept_rows)] for one in found)
        at = some[: len(kept_rows)][kept_rows]
        slip[at], variance[at] = expected[kept_rows], errors[kept_rows]
    return slip, variance


def _stretches(run: np.ndarray, inner: int, lead: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows of stretches of the runs, [stretches, lead + inner + lead], and which are its own.

    Beyond the ends of a run its first or last row is repeated.
    """
    order = np.argsort(run, kind="stable")
    length = np.bincount(run)
    first = np.cumsum(length) - length
    pieces = -(-length // inner)
    of_piece = np.repeat(np.arange(length.size), pieces)
    number = np.arange(of_piece.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    place = number[:, None] * inner + np.arange(-lead, inner + lead)
    last = length[of_piece][:, None] - 1
    own = (place >= number[:, None] * inner) & (place < (number[:, None] + 1) * inner)
    rows = order[first[of_piece][:, None] + np.clip(place, 0, last)]
    return rows, own & (place <= last)


@kept()
def _expected(
    noise: SlipNoise, slip: Float[Array, "stretches points"], conditions: Conditions
) -> tuple[Float[Array, "stretches points"], Float[Array, "stretches points"]]:
    found = jax.vmap(lambda *run: expected_slip(noise, *run))(slip, conditions)
    return found.slip, found.variance
