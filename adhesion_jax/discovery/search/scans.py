"""Waves of any length: along a column, coherent over the runs, and in time, of any phase."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy
from scipy.ndimage import median_filter

from adhesion_jax.discovery.model.fitting import Fitted
from adhesion_jax.discovery.model.problem import Problem
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import entry_of
from adhesion_jax.discovery.search.probes import Null
from adhesion_jax.discovery.search.screening import FLIPS, Score, least_p
from adhesion_jax.effects import EFFECTS
from adhesion_jax.effects.wave import Wave

#: Number of bins of the transform along an axis.
_BINS = 8192

#: Number of frequencies on either side whose median power the coherence of a wave is relative to.
#: It is large because a line is wide where every run has passed only a part of the axis.
_AROUND = 50

#: Number of frequencies on either side whose median power a line in time is relative to.
_NEIGHBOURS = 12

#: Fewest frequencies on either side of a line in time.
_FEWEST_BESIDE = 4


def waves(null: Null, taken: Sequence[str], seed: int) -> list[Score]:
    """The strongest coherent wave along each axis, if it is significant; none of those `taken`.

    Their z is only the deviate of p, which sign flips bound from below, and what they would gain
    and change is not worked out before they are fitted.

    The score of a run at a frequency f is the sum over its points of residual times adhesion times
    exp(i 2 pi f z), z the place along the axis. The coherence of the runs at f is |sum of their
    scores|^2 over the median, at the frequencies around, of the sum of their squares. p is adjusted
    for all frequencies by sign flips of the runs.
    """
    problem = null.fitted.setting.problem
    kinds = ((name, kind) for name, kind in EFFECTS.items() if issubclass(kind, Wave))
    axes = {kind.FACTS.needs[0]: (name, kind) for name, kind in kinds}
    # The weighted residual, beside all that is given, times the adhesion that a wave multiplies.
    pull = np.zeros(null.inside.shape)
    pull[null.inside] = (
        null.residual * (null.fitted.setting.root * null.fitted.adhesion)[null.inside]
    )
    found = []
    for place, axis in enumerate(sorted(axes.keys() & problem.flat.keys())):
        name, kind = axes[axis]
        if name in taken:
            continue
        frequency, p = _coherent(problem, axis, pull, [seed, 13, place])
        if p > rules.SCAN_SIGNIFICANT:
            continue
        start = kind.of_frequency(frequency)
        entry = entry_of(name, [start], problem)
        z, unknown = float(scipy.stats.norm.isf(p)), np.zeros(0)
        found.append(Score(entry, start, z, p, np.nan, unknown, unknown))
    return found


def _coherent(
    problem: Problem, axis: str, pull: np.ndarray, seed: Sequence[int]
) -> tuple[float, float]:
    """The frequency of the largest coherence, in waves a unit of the column, and its p.

    `pull` [runs, points] is the residual times the adhesion, weighted. Under slow noise the second
    harmonic of a wave may be the most coherent: half the frequency is returned if it is coherent as
    well.
    """
    values = np.asarray(problem.data.conditions[axis])
    inside = problem.points > 0
    low, high = values[inside].min(), values[inside].max()
    cell = np.clip((values - low) / (high - low) * (_BINS - 1), 0, _BINS - 1).astype(int)
    runs = values.shape[0]
    sums = np.zeros((runs, 2 * _BINS))
    np.add.at(sums, (np.arange(runs)[:, None], cell), np.where(inside, pull, 0.0))
    spectrum = np.fft.rfft(sums, axis=1)
    frequencies = np.arange(spectrum.shape[1]) * (_BINS - 1) / (high - low) / (2 * _BINS)
    # The transform is twice as long as the range, and has as many frequencies as the range bins.
    kept = slice(2 * rules.FEWEST_WAVES, 2 * spectrum.shape[1] // rules.FEWEST_BINS)
    spectrum, frequencies = spectrum[:, kept], frequencies[kept]
    used = np.abs(spectrum).sum(1) > 0
    spectrum = spectrum[used]
    power = np.maximum((np.abs(spectrum) ** 2).sum(0), 1e-300)
    # Relative to the power around it, not its own: the faint harmonics of a line cohere as well.
    level = median_filter(power, 2 * _AROUND + 1, mode="nearest")
    strong = power > rules.LEAST_POWER_SHARE * np.median(power)
    observed = np.where(strong, np.abs(spectrum.sum(0)) ** 2 / level, 0.0)
    best = int(np.argmax(observed))
    signs = np.random.default_rng(list(seed)).choice([-1.0, 1.0], size=(FLIPS, used.sum()))
    # Single precision is enough to compare with, and twice as fast.
    normal = np.where(strong, spectrum / np.sqrt(level), 0.0).astype(np.complex64)
    signs = signs.astype(np.float32)
    exceeded = 0
    for some in np.array_split(signs, 40):
        real, imaginary = some @ normal.real, some @ normal.imag
        largest = (real**2 + imaginary**2).max(axis=1)
        # Signs that are all alike give the data again, up to rounding.
        exceeded += int(np.sum(largest * (1 + 1e-4) >= observed[best]))
    p = max((1 + exceeded) / (1 + FLIPS), least_p(int(used.sum())))
    half = int(np.argmin(np.abs(frequencies - frequencies[best] / 2)))
    beside = slice(max(half - 1, 0), half + 2)
    coherent = observed[beside].max() > rules.HALF_FREQUENCY_COHERENCE
    if coherent and half < best - 1:
        best = beside.start + int(np.argmax(observed[beside]))
    return float(frequencies[best]), p


class Torsion(NamedTuple):
    """A line in time whose phase differs from run to run."""

    frequency: float  # Hz
    amplitude: float  # of adhesion
    p: float


def torsion(fitted: Fitted) -> Torsion | None:
    """The strongest line in the mean spectrum of the runs over time, if it is significant.

    The power of each run at a frequency is exponential; the level is that of the neighbouring
    frequencies on both sides. A wheelset twists faster than `rules.SLOWEST_TORSION`, and its line
    must lie well below half the frequency of the samples.
    """
    problem = fitted.setting.problem
    if not problem.in_time or problem.blocks:
        return None
    length = (problem.points > 0).sum(axis=1)
    points = int(length.max())
    whole = length == points
    step = np.diff(np.asarray(problem.data.conditions["time_s"])[whole, :points], axis=1)
    if whole.sum() < rules.FEWEST_RUNS_OF_A_LINE or step.size == 0:
        return None
    # Where all times are alike no step is a time.
    if not np.median(step) > 0 or np.ptp(step) > rules.EVEN_STEPS * np.median(step):
        return None
    rate = 1 / float(np.median(step))
    power = (np.abs(np.fft.rfft(fitted.error[whole, :points], axis=1)) ** 2).sum(0)
    first = int(np.ceil(rules.SLOWEST_TORSION * points / rate))
    power = power[first:-1]
    places = np.arange(_FEWEST_BESIDE, power.size - _FEWEST_BESIDE)
    if places.size == 0:
        return None
    below = [np.median(power[max(k - _NEIGHBOURS, 0) : k]) for k in places]
    above = [np.median(power[k + 1 : k + 1 + _NEIGHBOURS]) for k in places]
    # Of both sides the geometric mean: the spectrum of slow noise falls.
    level = np.sqrt(np.array(below) * np.array(above))
    power, first = power[places], first + _FEWEST_BESIDE
    runs = int(whole.sum())
    ratio = power / level
    best = int(np.argmax(ratio))
    # The median of the sum of `runs` unit exponentials is near runs - 1/3.
    p = float(power.size * scipy.stats.gamma.sf(ratio[best] * (runs - 1 / 3), runs))
    if p > rules.SCAN_SIGNIFICANT:
        return None
    excess = max(power[best] - level[best], 0.0) / runs
    return Torsion((best + first) * rate / points, 2 * float(np.sqrt(excess)) / points, min(p, 1.0))
