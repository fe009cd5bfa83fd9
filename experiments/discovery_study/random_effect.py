"""Effects drawn at random: smooth functions of columns, of no form that a catalogue has."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from experiments.campaigns.base import conditions_of, on_runs
from experiments.campaigns.plantable import Bend, CleanRuns, OpenEffect, Planted, unchanged
from experiments.campaigns.runs import BASE_CURVES, draw_curve, draw_runs
from experiments.campaigns.simulator import SimulatedSet, simulate

#: Columns that a random effect can rest on.
RANDOM_COLUMNS = (
    *("vehicle_speed_mps", "normal_load_N", "temperature_C", "relative_humidity_pct"),
    *("position_m", "curvature_per_m", "rail_age_days"),
)

#: The part of the curve that it changes: its level, its slip scale, its fall beyond the peak.
ACTS_ON = ("level", "slip", "fall")

#: Largest slip at which the peak is searched, which is the largest slip of the excitation.
_SLIP_END = 0.16

#: Each of two columns has at least this share of the variance of the function, by total effect.
_NOTABLE = 0.25

#: Number of cosines whose sum is the function; with this many it is close to a Gaussian process.
_FEATURES = 200


class RandomEffect(NamedTuple):
    """The columns and the part of the curve that they act on; the function itself is drawn."""

    columns: tuple[str, ...]  # one or two of RANDOM_COLUMNS
    acts_on: str


def simulate_random(
    effect: RandomEffect,
    *,
    seed: int,
    base: str = "auto",
    runs: int = 40,
    points: int = 200,
    **others: Any,
) -> SimulatedSet:
    """A simulated set with the effect, "random" among its parameters; see `simulate`.

    One that acts on the fall has Burckhardt's curve for its base where the base does not fall.
    """
    if effect.acts_on == "fall":
        family = BASE_CURVES[seed % len(BASE_CURVES)] if base == "auto" else base
        drawn = draw_runs(runs, points, False, np.random.default_rng((seed, 0)))
        law = draw_curve(family, np.random.default_rng((seed, 1)))
        falls = has_peak(on_runs(law, conditions_of(drawn)), drawn.slip.shape)
        base = family if falls else "burckhardt"
    forms = {"random": partial(random_plan, effect)}
    return simulate(seed=seed, base=base, runs=runs, points=points, forms=forms, **others)


def random_plan(effect: RandomEffect, runs: CleanRuns) -> OpenEffect:
    """The effect on the runs, g = amount f with the extremes of f at +-1.

    level: mu exp(g); slip: mu(slip exp(g)); fall: mu_max - (mu_max - mu) exp(g) beyond the peak.
    """
    slip = runs.slip
    points = np.stack([runs.columns[name].ravel() for name in effect.columns], axis=1)
    function, scales = smooth_function(points, runs.generator)
    f = function.reshape(slip.shape)
    known = {
        f"length_scale_{name}": float(scale)
        for name, scale in zip(effect.columns, scales, strict=True)
    }

    def planted(amount: float, before: Bend = unchanged, after: Bend = unchanged) -> Planted:
        return Planted(0, before, after, unchanged, {"amount": amount, **known})

    match effect.acts_on:
        case "level":
            return OpenEffect(
                lambda amount: planted(amount, after=lambda mu: mu * np.exp(amount * f)), 1.5
            )
        case "slip":
            return OpenEffect(
                lambda amount: planted(amount, before=lambda slip: slip * np.exp(amount * f)), 2.0
            )
        case _:
            where, height = peak_on_grid(runs.curve, slip.shape)
            beyond = np.abs(slip) > where

            def fallen(mu: np.ndarray, amount: float) -> np.ndarray:
                fall = np.maximum(height - np.abs(mu), 0.0)
                changed = np.sign(mu) * (height - fall * np.exp(amount * f))
                return np.where(beyond, changed, mu)

            return OpenEffect(
                lambda amount: planted(amount, after=lambda mu: fallen(mu, amount)),
                _steepest(runs.curve(slip), height, f, beyond),
            )


def smooth_function(
    points: np.ndarray, generator: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """A random smooth function of columns [points, columns]: its values, its length scales.

    A Gaussian process by random Fourier features, f(u) = sum w cos(omega u + b) with u the columns
    over their ranges and omega ~ N(0, 1/length^2), lengths drawn from .3 to 1.5 ranges. Of two
    columns it is joint or a sum, by chance, and drawn until each has a notable share of the
    variance. The median over the points is 0, the largest size 1.
    """
    unit = (points - points.min(axis=0)) / np.ptp(points, axis=0)
    count = unit.shape[1]
    while True:
        scales = generator.uniform(0.3, 1.5, count)
        frequency = generator.standard_normal((count, _FEATURES)) / scales[:, None]
        if generator.random() < 0.5:
            # Each cosine depends on one column: f is then a sum of functions of one column each.
            frequency *= np.arange(count)[:, None] == np.arange(_FEATURES) % count
        phase = generator.uniform(0, 2 * np.pi, _FEATURES)
        weight = generator.standard_normal(_FEATURES)

        def function(at: np.ndarray) -> np.ndarray:
            return np.cos(at @ frequency + phase) @ weight  # noqa: B023  (called at once)

        mixed = np.stack([generator.permutation(column) for column in unit.T], axis=1)
        values = function(mixed)
        if all(
            total_effect(function, mixed, values, place, generator) >= _NOTABLE
            for place in range(count)
        ):
            break
    centred = function(unit) - np.median(function(unit))
    return centred / np.max(np.abs(centred)), scales


def total_effect(
    function: Bend,
    points: np.ndarray,
    values: np.ndarray,
    place: int,
    generator: np.random.Generator,
) -> float:
    """Share of the variance of f that is gone once all columns but one are known.

    E[(f(u) - f(u'))^2]/(2 Var f), u' with that column drawn anew; Jansen 1999. The columns of
    `points` are independent, and `values` are f there.
    """
    other = points.copy()
    other[:, place] = generator.permutation(points[:, place])
    return float(np.mean((values - function(other)) ** 2) / (2 * np.var(values)))


def peak_on_grid(curve: Bend, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Slip and adhesion of the largest adhesion of traction under the conditions of each point."""
    grid = np.arange(0.0005, _SLIP_END, 0.0005)
    adhesion = np.stack([curve(np.full(shape, slip)) for slip in grid])
    return grid[np.argmax(adhesion, axis=0)], adhesion.max(axis=0)


def has_peak(curve: Bend, shape: tuple[int, ...]) -> bool:
    """Whether at every point the curve falls again before the excitation ends."""
    where, _ = peak_on_grid(curve, shape)
    return bool(where.max() < 0.9 * _SLIP_END)


def _steepest(adhesion: np.ndarray, height: np.ndarray, f: np.ndarray, beyond: np.ndarray) -> float:
    """The largest amount that leaves a third of the adhesion at every point; not above 4."""
    size = np.abs(adhesion)
    grows = beyond & (f > 0) & (size < height)
    room = np.log((height - size / 3)[grows] / (height - size)[grows]) / f[grows]
    return float(min(room.min(initial=4.0), 4.0))
