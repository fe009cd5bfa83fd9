"""Partial dependence of adhesion on a column, by an effect or by the curve, with a 95 % band."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from adhesion_jax.curves import BASES
from adhesion_jax.curves.bent import BELOW_EFFECTS
from adhesion_jax.data.columns import unit_of
from adhesion_jax.discovery.model.fitting import (
    changes_of,
    covariance,
    nearly_fitted,
    quantile,
    size_of,
)
from adhesion_jax.discovery.model.packing import Model, pack
from adhesion_jax.discovery.model.problem import Data, Problem, label_of
from adhesion_jax.discovery.search.state import AT_THE_ORIGIN, Accepted, Selection, slots_of
from adhesion_jax.discovery.search.trials import is_worth
from adhesion_jax.discovery.types import BRAKING, Dependence
from adhesion_jax.effects import Labels, Memory, ShapeTerm
from adhesion_jax.effects.dynamic import Dynamic
from adhesion_jax.linear_algebra import eigh

#: Number of values of a column that are shown.
_GRID = 80

#: Effects with a memory are shown only if runs have at least this number of points.
_FEWEST_POINTS = 20

#: Seconds after a step that are shown.
_SECONDS = 10.0

#: Number of slips, quantiles of those measured, of which the dependence of a curve is shown at one.
_SLIPS = 17

#: Adhesion changes about most where it changes by at least this share of the largest change.
_ABOUT_MOST = 0.9

#: Share of the largest adhesion below which braking is not compared with traction: the ratio of two
#: adhesions that are nearly nought says nothing.
_LITTLE = 0.1

#: Factors on adhesion are clipped to this size.
_LARGEST = 1e6

#: Steps of the parameters by which a factor is differentiated, in standard errors.
_STEP = 1e-5

#: Largest half width of the band of the logarithm of a factor.
_WIDEST = 14.0

#: Number of draws of the parameters for a band.
_DRAWS = 200

#: Conditions that are functions of a measured column of another name.
_FUNCTIONS = {"temperature_C", "lateral_measure"}

#: What an effect without a memory has of these is the time of the campaign.
_TIMES = ("time_s", "run")


def dependences(state: Selection, seed: int) -> tuple[Dependence, ...]:
    """The dependences of the curve on the columns that it needs, and of every effect on its own.

    Only columns that vary are shown, and of the curve braking where it surely differs. An effect
    with a memory is shown over the time since a step of its driver instead, if the runs are long
    enough to show it.
    """
    flat = state.setting.problem.flat
    needed = [name for name in BASES[state.base].NEEDS if name in flat]
    if not state.accepted and not needed and state.setting.problem.branches == 1:
        return ()
    spread = _spread(state, seed)
    found = [_of_curve(state, column, spread.drawn) for column in needed]
    found += _of_braking(state, spread)
    slots = slots_of(state.accepted)
    for number, effect in enumerate(state.accepted):
        parts = [slot for slot, place in enumerate(slots) if place[0] == number]
        in_time = [part for part in effect.parts if isinstance(part, Dynamic)]
        if in_time:
            if state.setting.problem.points.shape[1] >= _FEWEST_POINTS:
                driver = in_time[0].FACTS.driven_by
                found.append(_after_step(state, effect.name, driver, parts, spread))
            continue
        calendar = state.setting.problem.calendar.column
        rests_on = [calendar if name in _TIMES else name for name in effect.covariates]
        columns = [name for name in rests_on if name in flat and name != "slip_ratio"]
        for column in columns or ["slip_ratio"]:
            if column in flat:
                found.append(_over(state, effect, column, parts, spread))
    return tuple(found)


def _model(state: Selection) -> Model:
    fitted = state.fitted
    size, values = size_of(fitted.base, fitted.effects), fitted.base_values.tolist()
    return pack(state.setting.problem, fitted.base, values, fitted.effects, size)


#: A factor over a grid, and the ends of its band.
_Banded = tuple[np.ndarray, np.ndarray, np.ndarray]


class _Spread(NamedTuple):
    """Parameters of the whole model in which a dependence is computed for its band."""

    drawn: np.ndarray  # [1 + draws, flat]: as fitted, then drawn in the ranges of the fit
    #: [1 + free, flat]: as fitted, then a small step away along a direction of their covariance.
    near: np.ndarray
    quantile: float  # of the 95 % intervals of the parameters


def _spread(state: Selection, seed: int) -> _Spread:
    fitted, model = state.fitted, _model(state)
    free, places = len(fitted.places), list(fitted.places)
    values, vectors = eigh(covariance(fitted))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    noise = np.random.default_rng([seed, 23]).standard_normal((_DRAWS, free))
    drawn, near = (np.tile(fitted.values, (1 + count, 1)) for count in (_DRAWS, free))
    moved = drawn[1:, places] + noise @ root.T
    drawn[1:, places] = np.clip(moved, model.lower[:free], model.upper[:free])
    near[1:, places] += _STEP * root.T
    return _Spread(drawn, near, quantile(fitted))


def _over(
    state: Selection, effect: Accepted, column: str, parts: Sequence[int], spread: _Spread
) -> Dependence:
    """The dependence on a column, the others at their medians unless they are functions of it.

    What acts on the shape of the curve is shown where adhesion is largest, of the slips at which it
    changes about most: an offset changes it alike at all. One of labels has no values between them,
    and one with a memory has each value for a whole run.
    """
    problem = state.setting.problem
    shape = problem.points.shape
    values = problem.flat[column]
    of_labels = (part for part in effect.parts if isinstance(part, Labels))
    named = [float(code) for code in range(len(problem.named.get(column, ())))]
    labels = next((part.values() for part in of_labels if part.column == column), named)
    steady = not labels and any(isinstance(part, Memory) for part in effect.parts)
    count = shape[0] if steady else min(_GRID, shape[0] * shape[1])
    grid = np.array(labels) if labels else np.linspace(values.min(), values.max(), count)
    order = np.argsort(values, kind="stable")

    def laid(values: np.ndarray) -> np.ndarray:
        """The values of the grid in the places of the points, [runs, points]."""
        return np.resize(values, shape[::-1]).T if steady else np.resize(values, shape)

    moved = {column: laid(grid)}
    stands_for = {name: label_of(name, problem.measured) for name in _FUNCTIONS}
    stands_for["campaign_time"] = problem.calendar.column
    for condition in stands_for.keys() & problem.flat.keys():
        if stands_for[condition] == column:
            by_grid = np.interp(grid, values[order], problem.flat[condition][order])
            moved[condition] = laid(by_grid)
    slip = np.nan
    acts_on = {getattr(part, "acts_on", "level") for part in effect.parts}
    if acts_on != {"level"} and column not in ("slip_ratio", "slip_velocity_mps"):

        def change(slip: float) -> tuple[float, float, float]:
            columns = {**moved, "slip_ratio": np.full(shape, slip)}
            adhesion = at_medians(state, parts, spread.near[:1], columns)
            return float(np.ptp(adhesion)), float(np.abs(adhesion).mean()), slip

        changes = [change(slip) for slip in _slips(problem)]
        much = _ABOUT_MOST * max(changes)[0]
        slip = max((one for one in changes if one[0] >= much), key=lambda one: one[1])[2]
        moved["slip_ratio"] = np.full(shape, slip)
    factors = _factors(state, parts, spread.near, moved)
    factors = (factors[:, :, 0] if steady else factors.reshape(len(factors), -1))[:, : grid.size]
    names = tuple(problem.name_of(column, label) for label in labels)
    shown = Dependence(effect.name, column, unit_of(column), grid, *_of_steps(factors, spread))
    return shown._replace(labels=names, at_slip=slip)


def _slips(problem: Problem) -> list[float]:
    """Quantiles of the sizes of the slips measured, without the few largest and smallest.

    Few points have these, and hardly any value of a column: a law says there what no point shows.
    """
    sizes = np.abs(np.asarray(problem.data.slip)[problem.points > 0])
    return [float(one) for one in np.quantile(sizes, np.linspace(0.02, 0.98, _SLIPS))]


def _of_curve(state: Selection, column: str, draws: np.ndarray) -> Dependence:
    """The dependence of the curve alone, relative to the least value of the column.

    The slip is the one at which adhesion changes most, of some quantiles of those measured.
    """
    problem = state.setting.problem
    shape, values = problem.points.shape, problem.flat[column]
    grid = np.linspace(values.min(), values.max(), min(_GRID, shape[0] * shape[1]))

    def factors(slip: float, draws: np.ndarray) -> np.ndarray:
        columns = {column: np.resize(grid, shape), "slip_ratio": np.full(shape, slip)}
        adhesion = at_medians(state, (), draws, columns).reshape(len(draws), -1)[:, : grid.size]
        return _ratio(adhesion, adhesion[:, :1])

    slip = max(_slips(problem), key=lambda one: abs(factors(one, draws[:1])[0, -1] - 1))
    banded = _of_draws(factors(slip, draws))
    shown = Dependence(state.base, column, unit_of(column), grid, *banded)
    return shown._replace(at_slip=slip)


def _of_braking(state: Selection, spread: _Spread) -> list[Dependence]:
    """The curve of braking relative to that of traction, over the slips that both reach.

    Both with what the law adds to the adhesion and to the slip at the medians of all columns, which
    a curve that differs in braking may answer. None unless it predicts runs left out better than
    one curve for both, as surely as a plain column must. Of 200 simulated campaigns without a
    difference it was told in 3.
    """
    setting, fitted = state.setting, state.fitted
    problem = setting.problem
    if problem.branches == 1:
        return []
    alike = setting._replace(problem=problem._replace(branches=1))
    both = fitted.base_values[: len(BASES[state.base].free) + BELOW_EFFECTS].tolist()
    shared = nearly_fitted(alike, state.base, both, fitted.effects)
    if not is_worth(shared, fitted, generic=True):
        return []
    slip = np.asarray(problem.data.slip)[problem.points > 0]
    shape, reach = problem.points.shape, min(slip.max(), -slip.min())
    count = min(_GRID, shape[0] * shape[1])
    grid = reach * np.arange(1, count + 1) / count
    parts = [
        slot
        for slot, part in enumerate(fitted.effects)
        if isinstance(part, ShapeTerm) and part.acts_on in AT_THE_ORIGIN
    ]
    traction, braking = (
        at_medians(
            state, parts, spread.near, {"slip_ratio": np.resize(side * grid, shape)}
        ).reshape(len(spread.near), -1)[:, :count]
        for side in (1.0, -1.0)
    )
    much = np.minimum(traction[0], -braking[0]) > _LITTLE * np.abs(traction[0]).max()
    if not much.any():
        return []
    grid = grid[much]
    factor, low, high = _of_steps(_ratio(-braking, traction)[:, much], spread)
    surest = int(np.argmax(np.abs(np.log(factor)) / np.maximum(np.log(high / low), 1e-12)))
    shown = Dependence(BRAKING, "slip_ratio", "1", grid, factor, low, high)
    return [shown._replace(at_slip=float(grid[surest]), told=surest)]


def _after_step(
    state: Selection, name: str, driver: str, parts: Sequence[int], spread: _Spread
) -> Dependence:
    """The dependence on time after the slip steps from a fifth of its median to its median.

    Another driver than the slip steps from nothing to one. It lasts no longer than in the data.
    """
    shape = state.setting.problem.points.shape
    grid = np.linspace(0.0, min(_SECONDS, _longest(state.setting.problem, driver)), shape[1])
    slip = float(np.median(state.setting.problem.flat["slip_ratio"]))
    columns = {
        "time_s": np.tile(grid, (shape[0], 1)),
        "slip_ratio": np.tile(np.where(grid > 0, slip, 0.2 * slip), (shape[0], 1)),
    }
    columns.setdefault(driver, np.tile(np.where(grid > 0, 1.0, 0.0), (shape[0], 1)))
    banded = _of_steps(_factors(state, parts, spread.near, columns)[:, 0], spread)
    return Dependence(name, f"time since a step of {driver}", "s", grid, *banded)


def _longest(problem: Problem, driver: str) -> float:
    """The most seconds for which a driver stays above half of its largest value in a run."""
    conditions = {**problem.data.conditions, "slip_ratio": np.abs(problem.data.slip)}
    inside, values = problem.points > 0, np.asarray(conditions[driver])
    acts = np.pad(inside & (values > 0.5 * values[inside].max()), ((0, 0), (1, 1)))
    time = np.asarray(conditions["time_s"])
    run, first = np.nonzero(acts[:, 1:] & ~acts[:, :-1])
    _, last = np.nonzero(acts[:, :-1] & ~acts[:, 1:])
    return float(np.max(time[run, last - 1] - time[run, first], initial=0.0)) or _SECONDS


def _factors(
    state: Selection,
    parts: Sequence[int],
    parameters: np.ndarray,
    columns: Mapping[str, np.ndarray],
) -> np.ndarray:
    """Adhesion with the parts over adhesion without any effect, [rows, runs, points]."""
    return _ratio(*(at_medians(state, some, parameters, columns) for some in (parts, ())))


def at_medians(
    state: Selection,
    parts: Sequence[int],
    parameters: np.ndarray,
    columns: Mapping[str, np.ndarray],
) -> np.ndarray:
    """Adhesion with those parts alone, of each row of parameters, [rows, runs, points].

    The columns are those given, [runs, points], and all others at their medians.
    """
    data, model = _at(state, columns), _model(state)
    kind = np.zeros_like(model.kind)
    kind[list(parts)] = model.kind[list(parts)]
    models = [model._replace(values=values, kind=kind) for values in parameters]
    return np.asarray(changes_of(models, data, np.zeros(data.slip.shape)))


def _ratio(adhesion: np.ndarray, other: np.ndarray) -> np.ndarray:
    """One adhesion over another, of a limited size."""
    # Parameters that the data do not determine may be so far out that a factor overflows.
    with np.errstate(invalid="ignore", over="ignore"):
        factors = adhesion / np.where(other == 0, 1.0, other)
    return np.clip(np.where(np.isfinite(factors), factors, _LARGEST), -_LARGEST, _LARGEST)


def _at(state: Selection, columns: Mapping[str, np.ndarray]) -> Data:
    """Data of the usual shape with the given columns, all others at their medians."""
    problem = state.setting.problem
    inside = problem.points > 0

    def constant(values: np.ndarray) -> np.ndarray:
        return np.full(problem.points.shape, float(np.median(np.asarray(values)[inside])))

    slip = columns.get("slip_ratio", constant(np.abs(problem.data.slip)))
    conditions = {
        name: columns.get(name, constant(values))
        for name, values in problem.data.conditions.items()
    }
    speed = conditions["vehicle_speed_mps"]
    if "slip_velocity_mps" in columns:
        slip = columns["slip_velocity_mps"] / np.maximum(speed, 1e-9)
    follows = {**columns, "slip_velocity_mps": slip * speed}
    stacked = [
        follows[name] if name in follows else constant(problem.data.columns[place])
        for place, name in enumerate(problem.columns)
    ]
    stacked += [np.ones(problem.points.shape)] * (len(problem.data.columns) - len(stacked))
    return Data(slip, problem.data.adhesion, problem.data.span, conditions, np.stack(stacked))


def _of_draws(factors: np.ndarray) -> _Banded:
    """The factor as fitted, the first row, and the ends of its band by those drawn."""
    low, high = np.nanquantile(factors[1:], [0.025, 0.975], axis=0)
    return factors[0], low, high


def _of_steps(factors: np.ndarray, spread: _Spread) -> _Banded:
    """The factor as fitted, and the ends of its band by those of small steps (delta method).

    The logarithm of the factor is taken to be linear in the parameters. Those of several parts of
    an effect may be far less certain than what the parts do together: drawn values of them would
    not cancel as those of the fit do.
    """
    factor = factors[0]
    slopes = (factors[1:] - factor) / (_STEP * np.where(factor == 0, 1.0, factor))
    wide = np.exp(np.minimum(spread.quantile * np.sqrt((slopes**2).sum(axis=0)), _WIDEST))
    return (
        factor,
        np.minimum(factor / wide, factor * wide),
        np.maximum(factor / wide, factor * wide),
    )
