"""What becomes of a rail in the course of a stream."""

import equinox as eqx
import numpy as np

from adhesion_jax.options import Fall, Period, Recovery, Shift, WaveHeight


class Change(eqx.Module):
    """What becomes of a rail in a run, at a constant initial slope or of the curve as a whole.

    It loses a share `fall` of its adhesion evenly from the first to the last sample, and the slip
    of the peak grows by the share `shift` meanwhile. With `recovery` it loses that share at once
    in the middle of the run and recovers exponentially with this time constant in samples. A sine
    of amplitude `wave` and of `period` samples goes on top.
    """

    fall: Fall = eqx.field(default=0.0, static=True)
    shift: Shift = eqx.field(default=0.0, static=True)
    recovery: Recovery = eqx.field(default=0.0, static=True)
    wave: WaveHeight = eqx.field(default=0.0, static=True)
    period: Period = eqx.field(default=500.0, static=True)

    def course(self, points: int) -> tuple[np.ndarray, np.ndarray]:
        """The height of the peak and its slip over those of the rail before, at each sample."""
        sample, last = np.arange(points), points - 1
        lost = self.fall * sample / last
        if self.recovery:
            since = sample - points // 2
            left = np.exp(-np.maximum(since, 0) / self.recovery)
            lost = np.where(since < 0, 0.0, self.fall * left)
        wave = self.wave * np.sin(2 * np.pi * sample / self.period)
        return 1 - lost + wave, 1 + self.shift * sample / last
