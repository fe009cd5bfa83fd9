"""Simulated sets of runs with planted effects, on which a discovery can be tested."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float
from scipy.optimize import brentq
from scipy.signal import lfilter

from adhesion_jax.curves import Curve
from adhesion_jax.errors import InputError
from adhesion_jax.inference.noise import RunNoise
from experiments.campaigns.base import conditions_of, misfit, on_runs, rms
from experiments.campaigns.plantable import PLANTABLE, Bend, CleanRuns, Form, OpenEffect, Planted
from experiments.campaigns.runs import BASE_CURVES, DRAWN, Runs, draw_curve, draw_runs

#: The columns that every table has, in their order.
TABLE_COLUMNS = (
    *("time_s", "run", "vehicle_speed_mps", "slip_ratio", "slip_velocity_mps", "adhesion"),
    *("normal_load_N", "temperature_C", "relative_humidity_pct", "position_m"),
    *("curvature_per_m", "sanding", "rail_age_days"),
)

#: Share of the runs that is held out.
_TEST = 0.3


class SetNoise(NamedTuple):
    """e(k) = r e(k-1) + w(k) of standard deviation sigma, on top of a factor 1 + N(0, s) a run."""

    sigma: float = 0.007  # of adhesion
    autocorrelation: float = 0.4  # from point to point
    run_scatter: float = 0.005  # relative, from run to run


class SimulatedSet(NamedTuple):
    """A training and a test table, one row per point, and the truth behind them."""

    train: pd.DataFrame
    test: pd.DataFrame
    truth: tuple[str, ...]  # the planted effects
    parameters: Mapping[str, Mapping[str, float]]  # of each of them
    noise: SetNoise
    base: str
    curve: Curve  # the base law without effects
    visible: float  # rms of the misfit of the refitted base to the clean training data, over sigma
    test_rms_noise: float
    test_rms_effect: float  # of clean adhesion less the base law at the measured slip
    clean: np.ndarray  # test adhesion without noise, [rows of test]


def simulate(
    effects: Sequence[str] = (),
    *,
    seed: int,
    base: str = "auto",
    operational: bool = False,
    strength: float | None = None,
    noise: SetNoise = SetNoise(),  # noqa: B008  (an immutable tuple)
    runs: int = 40,
    points: int = 200,
    forms: Mapping[str, Form] = MappingProxyType({}),
) -> SimulatedSet:
    """A set of runs at 10 Hz, 30 % of the runs held out at random.

    `strength` is the 95th percentile of the change of |adhesion| that each effect alone makes,
    over that of |adhesion| itself; by default it is drawn from .15 to .3 for each. An effect that
    cannot become so strong is as strong as it can be. `base` "auto" takes the families in turn by
    seed. `forms` are planted in the place of the effects of their names, or besides. Equal
    arguments give equal tables, and excitation, weather and noise depend on the seed and the sizes
    alone. InputError for what is not known.
    """
    _check(effects, base, strength, noise, runs, points)
    chance = [np.random.default_rng((seed, stream)) for stream in range(5)]
    family = BASE_CURVES[seed % len(BASE_CURVES)] if base == "auto" else base
    truth = draw_runs(runs, points, operational, chance[0])
    extra = _extra_columns(effects, truth, seed)
    truth = truth._replace(columns={**truth.columns, **extra})
    conditions = conditions_of(truth)
    law = draw_curve(family, np.random.default_rng((seed, 1)))
    curve = on_runs(law, conditions)
    clean_runs = CleanRuns(truth.slip, truth.columns, conditions, curve, chance[1])
    plans: dict[str, Form] = {**{name: partial(_of_catalogue, name) for name in effects}, **forms}
    planted = {name: _planted(of, name, strength, seed, clean_runs) for name, of in plans.items()}
    clean, slip = _applied(tuple(planted.values()), truth.slip, curve)
    adhesion = noisy(clean, noise, chance[2])
    table = table_of(truth.columns, slip, adhesion)
    table["vehicle_speed_mps"] *= 1 + 1e-3 * chance[3].standard_normal(len(table))
    kept = [*TABLE_COLUMNS, *extra]
    held_out = chance[4].permutation(runs)[: max(round(_TEST * runs), 1)]
    is_test = np.isin(np.arange(runs), held_out)
    rows = np.repeat(is_test, points)
    return SimulatedSet(
        train=table.loc[~rows, kept].reset_index(drop=True),
        test=table.loc[rows, kept].reset_index(drop=True),
        truth=tuple(effects),
        parameters={name: effect.parameters for name, effect in planted.items()},
        noise=noise,
        base=family,
        curve=law,
        visible=misfit(law, slip, clean, conditions, ~is_test) / noise.sigma,
        test_rms_noise=rms((adhesion - clean)[is_test]),
        test_rms_effect=rms((clean - curve(slip))[is_test]),
        clean=clean[is_test].ravel(),
    )


def _check(
    effects: Sequence[str],
    base: str,
    strength: float | None,
    noise: SetNoise,
    runs: int,
    points: int,
) -> None:
    for what, asked, known in (
        ("way to plant", effects, PLANTABLE),
        ("base curve", (base,), ("auto", *DRAWN)),
    ):
        _known(what, asked, known)
    if len(set(effects)) < len(effects):
        raise InputError("An effect can be planted only once; name each once.")
    if not (noise.sigma > 0 and 0 <= noise.autocorrelation < 1 and noise.run_scatter >= 0):
        raise InputError(
            "Noise needs a sigma above 0, an autocorrelation from 0 to below 1 and a run scatter "
            "of at least 0."
        )
    if strength is not None and not 0 < strength <= 1:
        raise InputError(f"A strength of {strength:g} is not between 0 and 1.")
    if runs < 4 or points < 20:
        raise InputError("A campaign needs at least 4 runs of at least 20 points.")


def _known(what: str, asked: Iterable[str], known: Collection[str]) -> None:
    for name in asked:
        if name not in known:
            raise InputError(f"There is no {what} '{name}'; known are {', '.join(known)}.")


def _extra_columns(effects: Sequence[str], truth: Runs, seed: int) -> Mapping[str, np.ndarray]:
    """The columns that the table has only because these effects need them."""
    extra: dict[str, np.ndarray] = {}
    for name in effects:
        own = np.random.default_rng((seed, 10, *name.encode()))
        extra |= PLANTABLE[name].extra(truth.columns, own)
    return extra


def _planted(form: Form, name: str, strength: float | None, seed: int, runs: CleanRuns) -> Planted:
    """An effect on the runs, seeded by its name, so that it does not depend on the others."""
    own = np.random.default_rng((seed, 9, *name.encode()))
    wanted = own.uniform(0.15, 0.3) if strength is None else strength
    return _of_strength(form(runs._replace(generator=own)), wanted, runs.slip, runs.curve)


def _of_catalogue(name: str, runs: CleanRuns) -> OpenEffect:
    planting = PLANTABLE[name]
    if planting.is_noise:
        return planting.form(runs)
    return planting.form(runs._replace(phase=runs.generator.uniform(0, 2 * np.pi)))


def _of_strength(plan: OpenEffect, strength: float, slip: np.ndarray, curve: Bend) -> Planted:
    """The effect at the smallest amount that has the strength, or else at its limit."""
    scale = np.quantile(np.abs(curve(slip)), 0.95)

    def excess(amount: float) -> float:
        clean, measured = _applied((plan.make(amount),), slip, curve)
        return float(np.quantile(np.abs(clean - curve(measured)), 0.95) / scale - strength)

    upper = 0.01 * plan.limit
    while upper < plan.limit and excess(upper) < 0:
        upper = min(2.5 * upper, plan.limit)
    if excess(upper) <= 0:
        return plan.make(upper)
    return plan.make(float(brentq(excess, 0.0, upper, rtol=1e-3, xtol=1e-9 * plan.limit)))


def _applied(
    planted: Sequence[Planted], slip: np.ndarray, curve: Bend
) -> tuple[np.ndarray, np.ndarray]:
    """Adhesion of the true slip under all effects, from the contact outwards; the slip measured."""
    inner_first = sorted(planted, key=lambda effect: effect.order)
    bent = slip
    for effect in reversed(inner_first):
        bent = effect.before(bent)
    adhesion = curve(bent)
    measured = slip
    for effect in inner_first:
        adhesion = effect.after(adhesion)
        measured = effect.measured(measured)
    return adhesion, measured


def noisy(clean: np.ndarray, noise: SetNoise, generator: np.random.Generator) -> np.ndarray:
    """Clean adhesion [runs, points] with its noise."""
    own = RunNoise(noise.sigma, noise.autocorrelation, run_scatter=noise.run_scatter)
    return clean + noise_of_runs(own, clean, generator)


def noise_of_runs(
    noise: RunNoise, mean: Float[np.ndarray, "*sets runs rows"], generator: np.random.Generator
) -> Float[np.ndarray, "*sets runs rows"]:
    """A residual of each run whose curve is `mean`, without what the noise of the slip makes."""
    e = noise.sigma * _autoregressive(noise.autocorrelation, mean.shape, generator)
    level = noise.run_scatter * generator.standard_normal((*mean.shape[:-1], 1))
    if noise.slow_level:
        slow = float(np.exp(-1 / noise.slow_rows))
        level = level + noise.slow_level * _autoregressive(slow, mean.shape, generator)
    return e + level * mean


def _autoregressive(
    r: float, shape: tuple[int, ...], generator: np.random.Generator
) -> Float[np.ndarray, "*sets runs rows"]:
    """Of variance 1, stationary from its first row, with the correlation r^|lag|."""
    fresh = generator.standard_normal(shape)
    fresh[..., 1:] *= np.sqrt(1 - r**2)
    found: np.ndarray = lfilter([1.0], [1.0, -r], fresh, axis=-1)
    return found


def table_of(
    columns: Mapping[str, np.ndarray], slip: np.ndarray, adhesion: np.ndarray
) -> pd.DataFrame:
    """What is measured, one row a point."""
    arrays = {
        **columns,
        "slip_ratio": slip,
        "slip_velocity_mps": slip * columns["vehicle_speed_mps"],
        "adhesion": adhesion,
    }
    table = pd.DataFrame({name: values.ravel() for name, values in arrays.items()})
    return table.astype({name: int for name in ("run", "sanding") if name in table})
