"""Runs whose truth is known, on curves that the package does not offer, in many kinds of noise.

Written from the equations with NumPy and SciPy alone: what is judged by these runs shares nothing
with them. Slip and adhesion are ratios; a curve is asked for slips of at least 0.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd
from scipy.interpolate import PchipInterpolator
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

Array = np.ndarray
Function = Callable[[Array], Array]
Random = np.random.Generator

#: Time between two points in s, and from the end of a run to the start of the next.
STEP_S, PAUSE_S = 0.1, 30.0
#: Runs, points of each, and the slip from which each rises and to which it returns.
RUNS, POINTS, LOWEST = 12, 200, 0.002
#: Standard deviation of the noise of adhesion, unless a cell says otherwise.
SD = 0.01


@dataclass(frozen=True)
class Truth:
    """A curve: adhesion as a function of slip, the slip of its largest value, and that value."""

    adhesion: Function
    slip_opt: float
    mu_max: float


def peaked(adhesion: Function, low: float = 0.0, high: float = 0.15) -> Truth:
    """The curve with its peak, by bounded scalar minimisation between two slips."""
    found = minimize_scalar(
        lambda slip: -float(adhesion(np.asarray(slip))),
        bounds=(low, high),
        method="bounded",
        options={"xatol": 1e-9, "maxiter": 1000},
    )
    return Truth(adhesion, float(found.x), -float(found.fun))


def _brush(stiffness: float, static: float, sliding: float, decay: float) -> Function:
    """Brush with parabolic pressure. Pacejka 2012, Tire and Vehicle Dynamics, section 3.2.

    x = stiffness s / (3 mu), mu x (3 - 3 x + x^2) up to x = 1 and mu beyond, where the friction mu
    falls from static to sliding as exp(-s / decay).
    """

    def adhesion(s: Array) -> Array:
        friction = sliding + (static - sliding) * np.exp(-s / decay)
        x = np.minimum(stiffness * s / (3 * friction), 1.0)
        return friction * x * (3 - 3 * x + x**2)

    return adhesion


def _tmeasy(initial: float, end: float, peak: float, top: float, sliding: float) -> Function:
    """TMeasy: a rational rise, then a parabola. After Rill 2012, Road Vehicle Dynamics, chapter 3.

    The rise starts with one slope and ends with another one of at least 0; the parabola starts with
    a slope below 0, so the curve has a kink at its peak. Sliding is reached at slip .25.
    """
    # top x / (x + (1 - x) (a (1 - x) + b x)) has the slopes top / (peak a) and top b / peak.
    a, b = top / (peak * initial), end * peak / top

    def adhesion(s: Array) -> Array:
        x = np.minimum(s / peak, 1.0)
        rise = top * x / (x + (1 - x) * (a * (1 - x) + b * x))
        beyond = np.clip((s - peak) / (0.25 - peak), 0.0, 1.0)
        return rise - (top - sliding) * beyond * (2 - beyond)

    return adhesion


def _lugre(stiffness: float, static: float, sliding: float, speed: float) -> Function:
    """LuGre, steady, uniform pressure. Canudas de Wit et al. 2003, Vehicle System Dynamics 39(3).

    g (1 - (1 - exp(-z)) / z), z = stiffness s / g, and the friction g = sliding + (static -
    sliding) exp(-sqrt(s speed)), with the speed relative to the Stribeck speed.
    """

    def adhesion(s: Array) -> Array:
        g = sliding + (static - sliding) * np.exp(-np.sqrt(s * speed))
        z = stiffness * s / g
        large = np.maximum(z, 1e-5)  # below which the quotient would be lost in rounding
        return g * np.where(z < 1e-5, z / 2, 1 + np.expm1(-large) / large)

    return adhesion


def _stribeck(width: float, static: float, sliding: float, slip: float) -> Function:
    """(sliding + (static - sliding) exp(-(s / slip)^1.5)) tanh(s / width)."""
    return lambda s: (
        (sliding + (static - sliding) * np.exp(-((s / slip) ** 1.5))) * np.tanh(s / width)
    )


def _spline(name: str) -> Function:
    """A random curve that rises to one peak and falls from there, by monotone cubics.

    The knots are equidistant in log(1 + s / .01) on either side; PCHIP (Fritsch and Carlson 1980)
    keeps the order of the values, so the knot in the middle is the peak.
    """
    rng = np.random.default_rng([*name.encode()])
    peak, top = rng.uniform(0.025, 0.07), rng.uniform(0.18, 0.4)
    place, last = math.log1p(peak / 0.01), math.log1p(0.5 / 0.01)
    knots = np.concatenate([np.linspace(0, place, 5), np.linspace(place, last, 6)[1:]])
    rise = np.cumsum(rng.dirichlet([8.0, 6.0, 4.0, 1.5]))
    fall = 1 - rng.uniform(0.35, 0.6) * np.cumsum(rng.dirichlet([2.0, 4.0, 5.0, 5.0, 4.0]))
    curve = PchipInterpolator(knots, top * np.concatenate([[0.0], rise, fall]))
    return lambda s: curve(np.log1p(np.minimum(s, 0.5) / 0.01))


def _exponentials(*terms: tuple[float, float]) -> Function:
    """The sum of amplitude (1 - exp(-rate s))."""
    return lambda s: sum((-a * np.expm1(-rate * s) for a, rate in terms), np.zeros_like(s))


def _bump(plateau: float, rate: float, height: float, centre: float, width: float) -> Function:
    """A saturation, and on it a bump that is normal in the logarithm of slip."""
    return lambda s: (
        -plateau * np.expm1(-rate * s)
        + height * np.exp(-0.5 * (np.log(np.maximum(s, 1e-9) / centre) / width) ** 2)
    )


#: Burckhardt: .32 (1 - exp(-60 s)) - .35 s, whose peak is at log(32 * 60 / 35) / 60.
BURCKHARDT = peaked(lambda s: -0.32 * np.expm1(-60.0 * s) - 0.35 * s)

#: Curves by name that the package does not offer.
STRANGERS = {
    name: peaked(curve)
    for name, curve in {
        "brush": _brush(24.0, 0.4, 0.19, 0.12),
        "tmeasy": _tmeasy(22.0, 0.0, 0.042, 0.3, 0.2),
        "tmeasy-kink": _tmeasy(28.0, 2.5, 0.034, 0.27, 0.17),
        "lugre": _lugre(65.0, 0.47, 0.12, 2.4),
        "stribeck": _stribeck(0.017, 0.31, 0.16, 0.13),
        "spline-1": _spline("spline-1"),
        "spline-2": _spline("spline-2"),
        "spline-3": _spline("spline-3"),
        "spline-4": _spline("spline-4"),
        "tanh-fall": lambda s: 0.29 * np.tanh(s / 0.02) / (1 + 1.9 * s),
        "exponentials-1": _exponentials((0.3, 80.0), (0.12, 30.0), (-0.28, 4.5)),
        "exponentials-2": _exponentials((0.2, 150.0), (0.2, 35.0), (-0.25, 6.0)),
        "exponentials-3": _exponentials((0.6, 55.0), (-0.14, 25.0), (-0.25, 3.5)),
        "exponential-rational": lambda s: -0.36 * np.expm1(-75 * s) * (1 + 3 * s) / (1 + 7 * s),
        "hyperbola": lambda s: 15 * s / (1 + (s / 0.022) ** 2.2) ** 0.53,
        "lognormal-bump": _bump(0.2, 120.0, 0.1, 0.04, 0.55),
        "arctangents": lambda s: (
            0.16 * np.arctan(s / 0.006) + 0.12 * np.arctan(s / 0.02) - 0.24 * np.arctan(s / 0.12)
        ),
    }.items()
}


def autoregression(rng: Random, size: int, rho: float, sd: float) -> Array:
    """A stationary series x_t = rho x_(t-1) + white noise, of this standard deviation."""
    white = rng.normal(0.0, sd * math.sqrt(1 - rho**2), size)
    white[0] = rng.normal(0.0, sd)
    return lfilter([1.0], [1.0, -rho], white)


def of_runs(rng: Random, run: Array, rho: float, sd: float) -> Array:
    """Such a series that starts anew in every run."""
    return np.concatenate(
        [autoregression(rng, int((run == r).sum()), rho, sd) for r in np.unique(run)]
    )


@dataclass(frozen=True)
class Design:
    """Time in s, run and slip of every point, before any error."""

    time: Array
    run: Array
    slip: Array


def _there_and_back(rng: Random, rolling: int) -> Array:
    """A slip that rises steadily to .10-.15 and returns, with rolling before and after."""
    way = 1 - np.abs(np.linspace(-1.0, 1.0, POINTS))
    rise = LOWEST + (rng.uniform(0.1, 0.15) - LOWEST) * way
    return np.pad(rise, rolling, constant_values=2e-4)


def sweeps(rng: Random, rolling: int = 0) -> Design:
    """Twelve runs, each with so many rows of rolling at slip .0002 before and after."""
    rows = POINTS + 2 * rolling
    slip = np.concatenate([_there_and_back(rng, rolling) for _ in range(RUNS)])
    run = np.repeat(np.arange(1, RUNS + 1), rows)
    time = STEP_S * (np.arange(slip.size) % rows) + (run - 1) * (STEP_S * rows + PAUSE_S)
    return Design(time, run, slip)


def one_log(rng: Random) -> Design:
    """3,000 points with micro-slip of .003 to .012 and six events up to .10-.15, 12 s long each."""
    slip = 0.0075 + 0.0045 * np.sin(np.cumsum(rng.uniform(0.0, 0.06, 3000)))
    for event in range(6):
        start = 500 * event + int(rng.integers(100, 280))
        rows = slice(start, start + 120)
        bump = np.sin(np.linspace(0.0, np.pi, 120)) ** 2
        slip[rows] += (rng.uniform(0.1, 0.15) - slip[rows]) * bump
    return Design(STEP_S * np.arange(3000), np.ones(3000, int), slip)


@dataclass(frozen=True)
class Parts:
    """What the points of a draw consist of: measured slip is slip + slip_error, measured adhesion
    clean (1 + level) + noise, before both are rounded.
    """

    design: Design
    clean: Array
    level: Array
    noise: Array
    slip_error: Array


def white(rng: Random, _design: Design, clean: Array, sd: float = SD) -> Array:
    return rng.normal(0.0, sd, clean.size)


def correlated(rng: Random, design: Design, _clean: Array, rho: float = 0.0) -> Array:
    return of_runs(rng, design.run, rho, SD)


def heavy_tailed(rng: Random, _design: Design, clean: Array) -> Array:
    """Student's t with three degrees of freedom, whose variance is 3, at the same deviation."""
    return SD / math.sqrt(3) * rng.standard_t(3, clean.size)


def with_outliers(rng: Random, _design: Design, clean: Array) -> Array:
    """3 % of the points are ten standard deviations too high or too low."""
    hit = rng.random(clean.size) < 0.03
    return rng.normal(0.0, SD, clean.size) + 10 * SD * hit * rng.choice([-1.0, 1.0], clean.size)


def growing(rng: Random, _design: Design, clean: Array) -> Array:
    """A standard deviation of .003 + .05 adhesion."""
    return rng.normal(0.0, 0.003 + 0.05 * clean)


def no_level(_rng: Random, design: Design) -> Array:
    return np.zeros(design.slip.size)


def run_levels(rng: Random, design: Design) -> Array:
    """One factor a run, 1 % of scatter."""
    return rng.normal(0.0, 0.01, RUNS)[design.run - 1]


def slow_level(rng: Random, design: Design, samples: float, goes_on: bool = False) -> Array:
    """3 %, with a correlation that falls as exp(-samples apart / samples); or it goes on over runs,
    as if these followed upon each other without a pause.
    """
    run = np.ones_like(design.run) if goes_on else design.run
    return of_runs(rng, run, math.exp(-1 / samples), 0.03)


def slip_errors(rng: Random, design: Design, sd: float = 0.0, rho: float = 0.0) -> Array:
    return of_runs(rng, design.run, rho, sd)


def wheel_errors(rng: Random, design: Design) -> Array:
    """Noise of .01 m/s of the wheel over a speed of 10 to 20 m/s, constant in a run."""
    speed = rng.uniform(10.0, 20.0, RUNS)[design.run - 1]
    return rng.normal(0.0, 0.01, speed.size) / speed


@dataclass(frozen=True)
class Cell:
    """A curve and a kind of data: design, noise of adhesion, slow level, errors of slip, and the
    steps to which adhesion and slip are rounded (0 for none).
    """

    name: str
    truth: Truth = BURCKHARDT
    design: Callable[[Random], Design] = sweeps
    noise: Callable[[Random, Design, Array], Array] = white
    level: Callable[[Random, Design], Array] = no_level
    slip_error: Callable[[Random, Design], Array] = slip_errors
    steps: tuple[float, float] = (0.0, 0.0)


_SLIP = partial(slip_errors, sd=0.0007, rho=0.8)
_LOG = Cell("log", design=one_log, noise=partial(correlated, rho=0.6))

#: Cells by name.
CELLS = {
    cell.name: cell
    for cell in (
        Cell("white"),
        Cell("ar50", noise=partial(correlated, rho=0.5)),
        Cell("ar95", noise=partial(correlated, rho=0.95)),
        Cell("run-levels", level=run_levels),
        Cell("slip-noise", slip_error=partial(slip_errors, sd=0.002)),
        Cell("slow", level=partial(slow_level, samples=100), slip_error=_SLIP),
        Cell(
            "slow-continued",
            level=partial(slow_level, samples=400, goes_on=True),
            slip_error=_SLIP,
        ),
        Cell(
            "rolling",
            design=partial(sweeps, rolling=40),
            noise=partial(white, sd=0.002),
            slip_error=wheel_errors,
        ),
        Cell("heavy-tails", noise=heavy_tailed),
        Cell("outliers", noise=with_outliers),
        Cell("heteroscedastic", noise=growing),
        Cell("quantised", steps=(0.02, 0.001)),
        _LOG,
        replace(_LOG, name="log-slow", level=partial(slow_level, samples=400)),
        *(Cell(f"curve-{name}", truth) for name, truth in STRANGERS.items()),
    )
}


def parts(cell: Cell, seed: int) -> Parts:
    """A draw of a cell, taken apart; the same for the same seed and name."""
    rng = np.random.default_rng([seed, *cell.name.encode()])
    design = cell.design(rng)
    clean = cell.truth.adhesion(design.slip)
    return Parts(
        design,
        clean,
        cell.level(rng, design),
        cell.noise(rng, design, clean),
        cell.slip_error(rng, design),
    )


def rounded(values: Array, step: float) -> Array:
    """To whole multiples of a step, or as they are where it is 0."""
    return np.round(values / step) * step if step else values


def draw(cell: Cell, seed: int) -> pd.DataFrame:
    """The points as they are measured: time_s, run, slip_ratio, adhesion."""
    made = parts(cell, seed)
    adhesion_step, slip_step = cell.steps
    return pd.DataFrame(
        {
            "time_s": made.design.time,
            "run": made.design.run,
            "slip_ratio": rounded(made.design.slip + made.slip_error, slip_step),
            "adhesion": rounded(made.clean * (1 + made.level) + made.noise, adhesion_step),
        }
    )
