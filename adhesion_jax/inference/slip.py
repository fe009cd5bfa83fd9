"""The noise of the measured slip, from the course of the slip in time."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from adhesion_jax.inference.rows import Rows

#: Rows of a stretch through which a parabola is drawn, and most stretches that are looked at.
_STRETCH, _MOST_STRETCHES = 15, 20_000

#: A noise below this share of the largest slip, or slip velocity, changes nothing.
_ROUNDING = 1e-6

#: Least vehicle speed by which the noise of a wheel speed is divided, m/s.
_SLOWEST = 0.1

#: The column that the noise of a slip ratio falls with, where it is one of the wheel speed.
SPEED = "vehicle_speed_mps"


class SlipNoise(NamedTuple):
    """White noise of the slip, or of the wheel speed, by which the slip is computed."""

    sigma: float  # standard deviation; 0 for an exact slip
    of_wheel_speed: bool  # then in m/s, and the slip has this over the vehicle speed
    given: bool
    spread: Float[np.ndarray, " rows"]  # standard deviation of the slip of each row


def exact(rows: Rows) -> SlipNoise:
    return SlipNoise(0.0, False, False, np.broadcast_to(0.0, rows.slip.shape))


def slip_noise(
    rows: Rows, speed: Float[np.ndarray, " rows"] | None, given: float | None
) -> SlipNoise:
    """The noise that is `given`, or that of stretches of 15 rows about parabolas of least squares.

    Its variance is the median over the stretches, since in a few of them the slip may jump. It is
    an upper bound, because a slip that truly jumps from row to row looks the same: how much of it
    acts is judged by the residual (`weighing`). Without an order in time there is none to see.
    """
    # To be found it has one size where the speed is constant; one that is given is in m/s.
    moving = speed is not None and (given is not None or bool(np.ptp(speed) > 0))
    per_row = 1 / np.maximum(speed, _SLOWEST) if moving and speed is not None else np.ones(1)
    if given is not None:
        return SlipNoise(given, moving, True, np.broadcast_to(given * per_row, rows.slip.shape))
    lengths = np.diff(rows.starts)
    if not rows.ordered or lengths.max() < _STRETCH:
        return exact(rows)
    firsts = np.concatenate(
        [
            np.arange(start, start + length - _STRETCH + 1, _STRETCH // 3)
            for start, length in zip(rows.starts[:-1], lengths, strict=True)
        ]
    )
    firsts = firsts[:: -(-firsts.size // _MOST_STRETCHES)]
    stretches = (rows.slip / np.broadcast_to(per_row, rows.slip.shape))[
        firsts[:, None] + np.arange(_STRETCH)
    ]
    parabola = np.linalg.qr(np.vander(np.linspace(-1, 1, _STRETCH), 3))[0]
    left = np.sum(stretches**2, axis=1) - np.sum((stretches @ parabola) ** 2, axis=1)
    degrees = _STRETCH - 3
    # The median of chi squared (Wilson and Hilferty 1931, Proc. Natl. Acad. Sci. 17:684-688).
    variance = np.median(np.maximum(left, 0.0)) / (degrees * (1 - 2 / (9 * degrees)) ** 3)
    sigma = float(np.sqrt(variance))
    if sigma <= _ROUNDING * float(np.abs(stretches).max()):
        return exact(rows)
    return SlipNoise(sigma, moving, False, np.broadcast_to(sigma * per_row, rows.slip.shape))
