"""Waves of any length, which the library cannot look for one by one."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.ndimage import median_filter

from adhesion_jax.discovery.model.fitting import Fitted
from adhesion_jax.discovery.model.noise import chain
from adhesion_jax.discovery.model.problem import Problem, label_of
from adhesion_jax.discovery.search.catalogue import Entry
from adhesion_jax.effects import EFFECTS, Effect, Periodic, family_of
from adhesion_jax.effects.wave import Wave

#: A scan looks at hundreds of places: what it finds must be this sure.
SCAN_SIGNIFICANT = 0.001

_FLIPS = 1999

#: Bins for the fast transform along an axis that a cause is a wave along, and along a plain column;
#: waves shorter than eight bins are not looked for.
_BINS, _FEW_BINS = 8192, 1024

#: Axes along which causes are waves, by the column: the name of the cause.
_AXES = dict(sorted((kind.AXIS, name) for name, kind in EFFECTS.items() if issubclass(kind, Wave)))

#: A line in time must go through so many waves in a run: slower ones are the excitation's.
_WAVES = 6

#: A wave along an axis must stand out from as many frequencies on either side: a line is wide
#: where every run has passed a part of the axis only.
_AROUND = 50

#: The coherence of a line at a frequency that is given: 4.5e-5 by chance, for it is exponential.
_LINE = 10.0

#: Neighbouring frequencies whose median is the level that a line must stand out from.
_NEIGHBOURS = 12


class Line(NamedTuple):
    """A line in a spectrum."""

    entry: Entry
    p: float


def waves(fitted: Fitted, taken: Sequence[str], seed: int) -> list[Line]:
    """The strongest coherent wave along each axis, with p adjusted for all lengths by sign flips.

    The score of a run at a frequency is the sum over its points of residual times adhesion times
    exp(i 2 pi f z); coherent is what adds up over runs: |sum of scores|^2 over the median of the
    sums of their squares at the frequencies around.
    """
    setting = fitted.setting
    problem = setting.problem
    axes = {name: effect for name, effect in _AXES.items() if name in problem.varying}
    axes |= {
        name: "periodic"
        for name in problem.columns
        if name not in axes and name in problem.measured and _many_values(problem.flat[name])
    }
    pull = _adjoint(fitted)
    found = []
    for place, (axis, effect) in enumerate(axes.items()):
        name = effect if effect != "periodic" else f"periodic:{axis}"
        if name in taken or f"periodic:{axis}" in taken:
            continue
        frequency, p = _coherent(problem, axis, pull, axis in _AXES, [seed, 13, place])
        if p > SCAN_SIGNIFICANT:
            continue
        start = _start(axis, effect, frequency)
        label = label_of(axis, problem.measured)
        found.append(Line(Entry(name, (start,), (label,), ":" in name, family_of(name)), p))
    return found


def _start(axis: str, effect: str, frequency: float) -> Effect:
    kind = EFFECTS.get(effect)
    if kind is not None and issubclass(kind, Wave):
        return kind.of_frequency(frequency)
    return Periodic(0.01, 0.01, frequency, column=axis)


def _many_values(values: np.ndarray) -> bool:
    """A wave along a column of a few levels is no wave."""
    return np.unique(values).size > 0.5 * values.size


def _adjoint(fitted: Fitted) -> np.ndarray:
    """[runs, points]: the sensitivity of the fit to a relative change of adhesion at each point."""
    noise = fitted.setting.noise
    weight = np.asarray(noise.weight)
    carry, spread = chain(noise)
    fresh = -fitted.residual / spread
    back = fresh.copy()
    back[:, :-1] -= carry[:, 1:] * fresh[:, 1:]
    return back * weight * fitted.adhesion


def _coherent(
    problem: Problem, axis: str, pull: np.ndarray, harmonics: bool, seed: Sequence[int]
) -> tuple[float, float]:
    """The frequency of the largest coherence, in waves a unit, and its p.

    Of a wave that may have `harmonics` the second can stand out most, where the noise is slow: then
    half of its frequency is told, if there is a line as well.
    """
    values = np.asarray(problem.data.conditions.get(axis, np.zeros(0)))
    if not values.size or axis in problem.columns:
        values = np.asarray(problem.data.columns[problem.columns.index(axis)])
    inside = problem.points > 0
    low, high = values[inside].min(), values[inside].max()
    bins = _BINS if axis in _AXES else _FEW_BINS
    cell = np.clip((values - low) / (high - low) * (bins - 1), 0, bins - 1).astype(int)
    runs = values.shape[0]
    sums = np.zeros((runs, 2 * bins))
    np.add.at(sums, (np.arange(runs)[:, None], cell), np.where(inside, pull, 0.0))
    spectrum = np.fft.rfft(sums, axis=1)
    frequencies = np.arange(spectrum.shape[1]) * (bins - 1) / (high - low) / (2 * bins)
    # At least three waves over the range, and at least eight bins a wave.
    kept = slice(6, spectrum.shape[1] // 4)
    spectrum, frequencies = spectrum[:, kept], frequencies[kept]
    used = np.abs(spectrum).sum(1) > 0
    spectrum = spectrum[used]
    power = np.maximum((np.abs(spectrum) ** 2).sum(0), 1e-300)
    # Against the level around it, not its own power: the faint harmonics of a line cohere as well.
    level = median_filter(power, 2 * _AROUND + 1, mode="nearest")
    # A place that a run or two have passed coheres with itself.
    strong = power > 0.05 * np.median(power)
    observed = np.where(strong, np.abs(spectrum.sum(0)) ** 2 / level, 0.0)
    best = int(np.argmax(observed))
    signs = np.random.default_rng(list(seed)).choice([-1.0, 1.0], size=(_FLIPS, used.sum()))
    # Single precision is enough to compare with, and twice as fast.
    normal = np.where(strong, spectrum / np.sqrt(level), 0.0).astype(np.complex64)
    signs = signs.astype(np.float32)
    exceeded = 0
    for some in np.array_split(signs, 40):
        real, imaginary = some @ normal.real, some @ normal.imag
        largest = (real**2 + imaginary**2).max(axis=1)
        exceeded += int(np.sum(largest >= observed[best]))
    p = (1 + exceeded) / (1 + _FLIPS)
    half = int(np.argmin(np.abs(frequencies - frequencies[best] / 2)))
    beside = slice(max(half - 1, 0), half + 2)
    if harmonics and observed[beside].max() > _LINE and half < best - 1:
        best = beside.start + int(np.argmax(observed[beside]))
    return float(frequencies[best]), p


class Torsion(NamedTuple):
    """A line in time whose phase differs from run to run."""

    frequency: float  # Hz
    amplitude: float  # of adhesion
    p: float


def torsion(fitted: Fitted) -> Torsion | None:
    """The strongest line in the mean spectrum of the runs, if any is sure.

    Under white noise the power of each run at a frequency is exponential; the level is the median
    of the neighbouring frequencies, since the noise is white only about.
    """
    setting = fitted.setting
    problem = setting.problem
    if not problem.in_time or problem.blocks:
        return None
    weight = np.asarray(setting.noise.weight)
    whole = (weight > 0).all(axis=1)
    step = np.diff(np.asarray(problem.data.conditions["time_s"])[whole], axis=1)
    if whole.sum() < 4 or step.size == 0 or np.ptp(step) > 0.01 * np.median(step):
        return None
    points = weight.shape[1]
    power = (np.abs(np.fft.rfft(fitted.residual[whole], axis=1)) ** 2).sum(0)[_WAVES:-1]
    level = np.array(
        [
            np.median(
                np.delete(power[max(k - _NEIGHBOURS, 0) : k + _NEIGHBOURS + 1], min(k, _NEIGHBOURS))
            )
            for k in range(power.size)
        ]
    )
    runs = int(whole.sum())
    ratio = power / level
    best = int(np.argmax(ratio))
    # The median of a sum of exponentials is near its mean less a third.
    p = float(power.size * stats.gamma.sf(ratio[best] * (runs - 1 / 3), runs))
    if p > SCAN_SIGNIFICANT:
        return None
    frequency = (best + _WAVES) / points / float(np.median(step))
    r = float(setting.noise.autocorrelation)
    gain = abs(1 - r * np.exp(-2j * np.pi * (best + _WAVES) / points)) / np.sqrt(1 - r**2)
    excess = max(power[best] - level[best], 0.0) / runs
    amplitude = 2 * np.sqrt(excess) / points * float(setting.noise.sigma) / gain
    return Torsion(frequency, float(amplitude), min(p, 1.0))
