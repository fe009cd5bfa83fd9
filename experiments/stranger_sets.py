"""Measured campaigns whose truth is known, from NumPy, SciPy and pandas alone.

They judge the discovery and share no code with it. A campaign is a set of runs at 10 Hz, of which
12, drawn at random, are the test. Its adhesion is a random curve of slip, one hidden effect or none
on top of it, and noise. Of the curves the discovery offers burckhardt and kiencke. Slip and
adhesion are ratios, and negative in braking runs.
"""

from collections.abc import Callable
from itertools import count
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq
from scipy.signal import lfilter
from scipy.stats import rankdata

Array = np.ndarray
Random = np.random.Generator
Curve = Callable[[Array], Array]

STEP_S, TEST_RUNS = 0.1, 12
BASES = ("brush", "tmeasy", "spline", "lugre", "exponential-rational", "burckhardt", "kiencke")
LAYOUTS = ("standard", "unbalanced", "correlated", "sweeps", "many short", "few long")
NOISES = (
    "white",
    "AR .5",
    "AR .9",
    "grows with slip",
    "Student t",
    "outliers",
    "quantised",
    "slip",
)
#: The part of the curve that each effect acts on; of a surface it is drawn from the first three.
_LEVEL = ("smooth level", "threshold", "filtered", "label", "hysteresis", "two weak", "designed")
_OTHER = {"smooth slip": "slip", "smooth fall": "fall", "offset": "offset", "shift": "shift"}
EFFECTS = {**dict.fromkeys(_LEVEL, "level"), **_OTHER, "surface": ""}
#: Largest size of an effect: relative, in logarithms of slip and of the fall, adhesion, slip.
LARGEST = {"level": 0.5, "slip": 1.0, "fall": 1.5, "offset": 0.08, "shift": 0.02}
#: Least and largest rms, in sigma, of what an effect adds that no function of slip can absorb.
STRENGTHS = (0.5, 2.0)
NUMBERS = ("vehicle_speed_mps", "normal_load_N", "temperature_C", "relative_humidity_pct")
#: Columns that may act, and those of them that change little within a run.
ACTING, STEADY = (*NUMBERS, "position_m", "x02", "x03"), (*NUMBERS[2:], "x03")
LABELS = {
    "operator": np.array(["Ada", "Ben", "Eve", "Kim"]),
    "rail_id": np.array(["R7", "R12", "R15", "R21", "R30"]),
    "rail_no": np.array([412, 97, 655, 230, 518]),
}
#: Any of these is the right name where adhesion depends on where the slip comes from.
REMEMBERING = ("hysteresis", "lag", "relaxation", "delay", "inertia")


class Stranger(NamedTuple):
    """A campaign and its truth."""

    train: pd.DataFrame
    test: pd.DataFrame
    change: Array  # by which the effect changes its part of the curve, [training rows]
    base: str
    layout: str
    noise: str
    effect: str  # a name of EFFECTS, or nothing
    causes: tuple[tuple[str, ...], ...]  # for each cause the names of which one must be told
    harmless: tuple[str, ...]  # names that are no false claim
    sigma: float  # standard deviation of the noise, levels of runs and outliers apart
    run_scatter: float  # relative standard deviation of the levels of runs
    strength: float  # rms over the training rows, in sigma, of what no function of slip absorbs
    test_gap: float  # the same over the test rows, in adhesion
    test_noise: float  # rms over the test rows of adhesion less its mean at the slip as measured


def stranger(seed: int, number: int, null: bool) -> Stranger:
    """Campaign `number`; one whose effect cannot be made strong enough is drawn again."""
    for attempt in count():
        made = _drawn(np.random.default_rng([seed, number, null, attempt]), number, null)
        if null or made.strength >= STRENGTHS[0]:
            return made
    raise AssertionError


def _drawn(rng: Random, number: int, null: bool) -> Stranger:
    base, effect = BASES[number % len(BASES)], [*EFFECTS][number % len(EFFECTS)]
    effect, curve = "nothing" if null else effect, curve_of(base, rng)
    # Ten runs tell neither the levels of five labels nor the eight cells of a design.
    layout = str(rng.choice(LAYOUTS[:5] if effect in ("label", "designed") else LAYOUTS))
    noise, sigma = str(rng.choice(NOISES)), float(rng.choice([0.004, 0.007, 0.01]))
    scatter, label = float(rng.choice([0, 0.005, 0.01, 0.02])), str(rng.choice([*LABELS]))
    sizes = _sizes(rng, layout)
    slip, run = _slips(rng, layout, sizes), np.repeat(np.arange(sizes.size), sizes)
    table = _columns(rng, layout, sizes, label if effect == "label" else "")
    causes, cause = _cause(rng, effect, label, layout, table, slip, sizes)
    part = EFFECTS.get(effect, "level") or str(rng.choice(["level", "slip", "fall"]))
    in_test = np.isin(run, rng.choice(sizes.size, TEST_RUNS, replace=False))
    hats = _hats(slip)
    fitted = hats[~in_test]
    inverse = np.linalg.pinv(fitted.T @ fitted, hermitian=True) @ fitted.T

    def gap(size: float) -> Array:
        """What an effect of this size adds, less its best function of slip on the training rows."""
        more = _mean(curve, part, size * cause, slip) - _mean(curve, part, 0 * cause, slip)
        return more - hats @ (inverse @ more[~in_test])

    def beyond(size: float) -> float:
        return _rms(gap(size)[~in_test]) - wanted * sigma

    wanted, size = rng.uniform(*STRENGTHS), 0.0
    if not null:
        size = LARGEST[part] / float(np.abs(cause).max())
        size = brentq(beyond, 0.0, size, xtol=1e-10) if beyond(size) > 0 else size
    level = 1 + scatter * rng.standard_normal(sizes.size)[run]
    adhesion = level * _mean(curve, part, size * cause, slip)
    adhesion, shown = adhesion + sigma * _errors(rng, noise, sizes, slip), slip
    if noise == "slip":  # of a wheel speed with errors of 2 to 8 mm/s
        errors = rng.uniform(0.002, 0.008) * rng.standard_normal(slip.size)
        shown = slip + errors / table["vehicle_speed_mps"].to_numpy()
    elif noise == "quantised":
        adhesion, shown = np.round(adhesion, 2), 5e-4 * np.round(slip / 5e-4)
    table.insert(2, "slip_ratio", shown)
    table.insert(3, "adhesion", adhesion)
    unmodelled = adhesion - _mean(curve, part, size * cause, shown)
    harmless = ("slip_noise",) if noise in ("slip", "quantised") else ()
    gaps = _rms(gap(size)[~in_test]) / sigma, _rms(gap(size)[in_test])
    train, test = (table[which].reset_index(drop=True) for which in (~in_test, in_test))
    told = (base, layout, noise, effect, causes, harmless, sigma, scatter)
    return Stranger(train, test, (size * cause)[~in_test], *told, *gaps, _rms(unmodelled[in_test]))


def curve_of(base: str, rng: Random) -> Curve:
    """A random curve of a family: adhesion as a function of slips of at least 0.

    brush: parabolic pressure, x (3 - 3 x + x^2) of a friction that falls (Pacejka 2012, Tire and
    Vehicle Dynamics, 3.2). tmeasy: rational rise, cubic fall (Rill 2012, Road Vehicle Dynamics, 3).
    spline: monotone cubics (Fritsch and Carlson 1980) with one peak. lugre: steady, uniform
    pressure, one speed (Canudas de Wit et al. 2003, Vehicle System Dynamics 39(3)).
    """
    top, peak, end = rng.uniform([0.18, 0.02, 0.08], [0.4, 0.06, 0.25])
    rest, p = rng.uniform([0.4, 0], [0.75, 1])
    place, last = np.log1p(peak / 0.01), np.log1p(0.5 / 0.01)
    knots = np.concatenate([np.linspace(0, place, 5), np.linspace(place, last, 6)[1:]])
    rise = np.cumsum(rng.dirichlet([8.0, 6.0, 4.0, 2.0]))
    fall = 1 - (1 - rest) * np.cumsum(rng.dirichlet([2.0, 4.0, 5.0, 5.0, 4.0]))
    spline = PchipInterpolator(knots, np.concatenate([[0.0], rise, fall]))

    def brush(s: Array) -> Array:
        friction = rest + (1 - rest) * np.exp(-s / end)
        x = np.minimum(s / (peak * friction), 1.0)
        return friction * x * (3 - 3 * x + x**2)

    def tmeasy(s: Array) -> Array:
        x, y = np.minimum(s / peak, 1.0), np.clip((s - peak) / end, 0.0, 1.0)
        return (2 + p) * x / (1 + x * (x + p)) - (1 - rest) * y**2 * (3 - 2 * y)

    def lugre(s: Array) -> Array:
        friction = 1.3 * (rest / 2 + (1 - rest / 2) * np.exp(-np.sqrt(s / (2 * end))))
        z = np.maximum(4 * s / (peak * friction), 1e-6)
        return friction * (1 + np.expm1(-z) / z)

    curves: dict[str, Curve] = {
        "brush": brush,
        "tmeasy": tmeasy,
        "spline": lambda s: spline(np.log1p(np.minimum(s, 0.5) / 0.01)),
        "lugre": lugre,
        "exponential-rational": lambda s: -np.expm1(-3 * s / peak) * (1 + p * s) / (1 + s / end),
        "burckhardt": lambda s: -np.expm1(-3 * s / peak) - (0.5 + p) * s,
        "kiencke": lambda s: (2 + p) * (s / peak) / (1 + p * (s / peak) + (s / peak) ** 2),
    }
    return lambda s: top * curves[base](s)


def _mean(curve: Curve, part: str, change: Array, slip: Array) -> Array:
    """Adhesion at the slip where a part of the curve is changed by so much."""
    slip = slip + change if part == "shift" else slip
    size = np.abs(slip) * (np.exp(change) if part == "slip" else 1.0)
    adhesion = curve(size) * (1 + change if part == "level" else 1.0)
    if part == "fall":
        grid = np.linspace(0, 0.4, 2001)
        top, peak = curve(grid).max(), grid[curve(grid).argmax()]
        adhesion = np.where(size > peak, top - (top - adhesion) * np.exp(change), adhesion)
    return np.sign(slip) * adhesion + (change if part == "offset" else 0.0)


def _sizes(rng: Random, layout: str) -> Array:
    """Points of each run."""
    if layout == "unbalanced":
        return np.exp(rng.uniform(np.log(25), np.log(300), 28 + TEST_RUNS)).astype(int)
    runs = {"many short": 70, "few long": 10}.get(layout, 28)
    points = {"many short": 40, "few long": 250}.get(layout, int(rng.choice([100, 200])))
    return np.full(runs + TEST_RUNS, points)


def _slips(rng: Random, layout: str, sizes: Array) -> Array:
    """A slip that rises once, or some times and returns; in a third of the sets half brakes."""
    braking, slips = rng.uniform() < 1 / 3, []
    for points in sizes:
        x, turns = np.linspace(0, 1, points), rng.integers(1, 5 if layout == "few long" else 4)
        wave = 0.5 - 0.5 * np.cos(2 * np.pi * (turns * x + rng.uniform()))
        share = x if layout == "sweeps" else wave ** rng.uniform(1, 2)
        sign = -1 if braking and rng.uniform() < 0.5 else 1
        slips.append(sign * (0.002 + rng.uniform(0.05, 0.18) * share))
    return np.concatenate(slips) * np.exp(0.05 * _series(rng, sizes, 0.9))


def _columns(rng: Random, layout: str, sizes: Array, needed: str) -> pd.DataFrame:
    """All but slip and adhesion: run, time, what was measured, labels, columns without meaning."""
    run, starts = np.repeat(np.arange(sizes.size), sizes), np.cumsum(sizes) - sizes
    within = STEP_S * (np.arange(run.size) - starts[run])

    def mixed(between: float, rho: float = 0.99) -> Array:
        """A standard normal column, so much of whose variance is between runs."""
        own = rng.standard_normal(sizes.size)[run]
        return np.sqrt(between) * own + np.sqrt(1 - between) * _series(rng, sizes, rho)

    start = np.cumsum(rng.exponential(900, sizes.size) + STEP_S * sizes)[run]
    speed, load, warm, moist = mixed(0.7), mixed(0.6), mixed(0.96), mixed(0.96)
    place = rng.uniform(0, 5000, sizes.size)[run]
    if layout == "correlated":
        speed, load = 0.95 * _standard(start) + 0.3 * speed, 0.95 * _standard(place) + 0.3 * load
        moist = 0.3 * moist - 0.95 * warm
    speed = 14 * np.exp(0.35 * speed)
    place = place + pd.Series(STEP_S * speed).groupby(run).cumsum().to_numpy()
    values = (speed, 9e4 * np.exp(0.15 * load), 15 + 8 * warm, 100 / (1 + np.exp(-moist)))
    columns = {"run": run, "time_s": start + within, **dict(zip(NUMBERS, values, strict=True))}
    columns["position_m"] = place
    for name, names in LABELS.items():
        if name == needed or rng.uniform() < 0.5:
            columns[name] = names[rng.permutation(np.arange(sizes.size) % names.size)[run]]
    for number in range(rng.integers(3, 16)):
        pulses = 1.0 * (_series(rng, sizes, 0.97) > 0.6)
        drift = _standard(np.cumsum(rng.standard_normal(sizes.size))[run])
        kinds = (pulses, _series(rng, sizes, 0.9), mixed(1.0), mixed(0.0, 0.0), drift)
        own = kinds[number % len(kinds)]
        if number > 2 and rng.uniform() < 0.35:  # a proxy of another column
            r, of = rng.uniform(0.6, 0.95), columns[str(rng.choice(ACTING[:5]))]
            own = r * _standard(of) + np.sqrt(1 - r**2) * mixed(0.5, 0.9)
        columns[f"x{number + 1:02d}"] = own
    return pd.DataFrame(columns)


def _cause(
    rng: Random,
    effect: str,
    label: str,
    layout: str,
    table: pd.DataFrame,
    slip: Array,
    sizes: Array,
) -> tuple[tuple[tuple[str, ...], ...], Array]:
    """The right names of each cause, and what acts, [rows], with mean 0 and variance 1.

    The columns of a design are put into the table.
    """
    free = [name for name in ACTING if layout != "few long" or name not in STEADY]
    one, two = (str(name) for name in rng.choice(free, 2, replace=False))
    names, cause = [one], np.zeros(slip.size)

    def wave(name: str) -> Array:
        """A random smooth function of a column: three cosines of its rank."""
        k, u = np.arange(1, 4)[:, None], rankdata(table[name]) / len(table)
        cosines = np.cos(np.pi * k * u + rng.uniform(0, 2 * np.pi, (3, 1)))
        return _standard((rng.standard_normal((3, 1)) / k * cosines).sum(axis=0))

    def filtered(values: Array, seconds: float) -> Array:
        """A filter of first order that begins anew, at rest, in every run."""
        keep, parts = np.exp(-STEP_S / seconds), np.split(values, np.cumsum(sizes)[:-1])
        return np.concatenate([lfilter([1 - keep], [1, -keep], v - v[0]) + v[0] for v in parts])

    if effect == "nothing":
        return (), cause
    if effect == "surface":
        names, cause = [one, two], (1 + wave(one)) * (1 + wave(two))
    elif effect == "threshold":
        cause = np.tanh((rankdata(table[one]) / len(table) - rng.uniform(0.3, 0.7)) / 0.04)
    elif effect == "filtered":
        names, cause = ["x01"], filtered(table["x01"].to_numpy(), rng.uniform(1.5, 5))
    elif effect == "label":
        levels = rng.permutation(np.linspace(-1, 1, LABELS[label].size)) ** 3
        names, cause = [label], levels[pd.factorize(table[label])[0]]
    elif effect == "hysteresis":
        cause = np.abs(slip) - filtered(np.abs(slip), rng.uniform(1, 3))
        return (REMEMBERING,), _standard(cause)
    elif effect in ("two weak", "designed"):
        names = [one, two] if effect == "two weak" else [*NUMBERS[1:]]
        if effect == "designed":  # two levels of each in all combinations, constant within runs
            cell = rng.permutation(np.arange(sizes.size) % 8)[table["run"]]
            for bit, name in enumerate(names):
                table[name] = table[name].quantile([0.2, 0.8]).to_numpy()[cell >> bit & 1]
        for name in names:
            weight = rng.uniform(0.6, 1.4) * rng.choice([-1, 1])
            cause = cause + weight * _standard(table[name].to_numpy())
    else:
        cause = wave(one)
    return tuple((name,) for name in names), _standard(cause)


def _errors(rng: Random, noise: str, sizes: Array, slip: Array) -> Array:
    """Noise of standard deviation 1, outliers apart: 2 % of ten sigma."""
    errors = _series(rng, sizes, {"AR .5": 0.5, "AR .9": 0.9}.get(noise, 0.0))
    if noise == "grows with slip":
        grown = 0.3 + np.abs(slip) / np.abs(slip).mean()
        errors *= grown / _rms(grown)
    elif noise == "Student t":
        errors = rng.standard_t(3, slip.size) / np.sqrt(3)
    elif noise == "outliers":
        errors += 10 * rng.choice([-1, 0, 1], slip.size, p=[0.01, 0.98, 0.01])
    return errors


def _series(rng: Random, sizes: Array, rho: float) -> Array:
    """x_t = rho x_(t-1) + white noise, stationary, of variance 1, anew in every run."""
    white = rng.standard_normal((sizes.size, sizes.max()))
    white[:, 1:] *= np.sqrt(1 - rho**2)
    return lfilter([1], [1, -rho], white)[np.arange(sizes.max()) < sizes[:, None]]


def _hats(slip: Array) -> Array:
    """Twelve piecewise linear functions of log(1 + |slip|/.005), apart for braking: [rows, 24]."""
    u = np.log1p(np.abs(slip) / 0.005)
    knots = np.linspace(0, u.max(), 12)
    hats = np.stack([np.interp(u, knots, row) for row in np.eye(12)], axis=1)
    return np.concatenate([hats * (slip > 0)[:, None], hats * (slip <= 0)[:, None]], axis=1)


def _standard(values: Array) -> Array:
    return (values - values.mean()) / values.std()


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
