"""Online identifiers over a whole log, sample by sample, and what is kept of their estimates."""

import dataclasses
from collections.abc import Callable, Mapping
from time import perf_counter
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Bool, Float, Int

from adhesion_jax import runtime
from adhesion_jax.curves import SLIP_LIMIT, Curve, with_free_values
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.identifiers.base import Estimate, Identifier, State, Status
from adhesion_jax.identifiers.of_numpy import complain
from adhesion_jax.measured.fall import BELOW, Fall, Window, empty, extended, fall_of
from adhesion_jax.measured.log import Log
from adhesion_jax.programs import kept
from adhesion_jax.records import Known, Record

#: Samples of one call of a program. The last call is filled up with samples that are not fresh, so
#: that one program serves every log; the state is carried, so that memory does not grow.
CHUNK = 4096

#: Most checkpoints that are chosen beforehand, evenly over the samples used.
CHECKPOINTS = 4000

#: Most resets, and again most changes of status, that are kept between two checkpoints.
_MARKS = 4

#: The start that a method is told: a peak of this adhesion at this share of the largest slip.
_START_ADHESION, _START_SHARE = 0.3, 0.1

#: The box: a peak at a slip down to this share of the largest one, and down to this adhesion.
_LEAST_SHARE, _LEAST_ADHESION = 0.005, 0.01

#: Range of an initial slope that a method looks for itself, as a factor in either direction.
_SLOPES = 100.0

#: What is told after each sample (`_chunk`).
_TOLD = (
    "mu_max",
    "mu_max_se",
    "mu_max_by_slope",
    "slip_opt",
    "slip_opt_se",
    "slip_opt_by_slope",
    "status",
    "changed",
    "reset",
    "resets",
    "skipped",
    *Fall._fields,
)

#: The relative standard errors of a curve whose form is right.
NO_FORM = {"mu_max": 0.0, "slip_opt": 0.0}

#: Half the width of a 95 % band in standard errors.
QUANTILE = 1.96

#: A fall is taken for real from this number of its standard errors on: thousands of checkpoints
#: are judged. With 3.5 and with 3 no limit of the force was taken for a peak in 120 simulated logs.
_SURE = 3.0

#: Largest correlation of consecutive errors by which standard errors are widened.
_MOST_ALIKE = 0.999


class Followed(NamedTuple):
    """One method over a log.

    `estimates` has a row a checkpoint, a reset and a change of status, in the order of the samples:
    `sample` (of the log, from 0), mu_max and slip_opt with their standard errors, `status`, `reset`
    (whether the past was given up at this sample), `resets` and `skipped`, both counted up to it,
    `at_least`, whether the samples that the estimate rests on show no fall of adhesion beyond the
    peak (`measured.fall`), and `reached`, the adhesion that they surely have.
    The standard errors are those of the method times `widening`, as most take the noise as
    independent; in quadrature come what the uncertainty of the initial slope and what the form of
    the curve make.
    """

    estimates: pd.DataFrame
    resets: int
    skipped: int  # samples that are not finite
    trusted: int  # samples after which the status is TRUSTED
    #: Of the errors of prediction of consecutive samples, from their signs, which a switch of the
    #: rail does not rule; 0 of a method without a curve.
    correlation: float
    #: sqrt((1 + correlation)/(1 - correlation)), or 1 of a method that knows of the correlation.
    widening: float
    seconds_per_sample: float  # of the program, while others run beside it


class _Tally(NamedTuple):
    """What is counted while a log is followed."""

    status: Int[Array, ""]  # after the last sample; -1 before the first one
    error: Float[Array, ""]  # of the prediction of the last sample
    pairs: Int[Array, ""]  # of consecutive samples
    alike: Int[Array, ""]  # pairs whose errors have one sign, less those whose have two
    resets: Int[Array, ""]
    skipped: Int[Array, ""]
    trusted: Int[Array, ""]
    ages: Int[Array, " lanes"]  # samples since the last reset of each lane
    by_slope: Float[Array, "2"]  # relative differences of the lanes, of mu_max and of slip_opt


_Carry = tuple[State, _Tally, Window]


def known_of(initial_slope: float, slip_limit: float) -> Known:
    """What a method is told: Kiencke's curve with a0 known, a neutral start and a wide box.

    Of the log itself it holds nothing but a0: the start is a peak of adhesion .3 at a tenth of the
    largest slip (1, or 10 m/s), the box has the peak between .5 % of the largest slip and that
    slip, at an adhesion of at least .01.
    """
    lower = np.array([-2 / slip_limit, slip_limit**-2])
    upper = np.array([initial_slope / _LEAST_ADHESION, (_LEAST_SHARE * slip_limit) ** -2])
    at = _START_SHARE * slip_limit
    start = np.clip([initial_slope / _START_ADHESION - 2 / at, at**-2], lower, upper)
    curve = Kiencke(a0=initial_slope, p1=float(start[0]), p2=float(start[1]))
    return Known(curve, lower, upper, slip_limit=slip_limit, by_sample=True)


def _told(method: Identifier, known: Known) -> Known:
    """What is told to a method, which may be one that finds the initial slope as well.

    That begins at the one known, and looks for it between a hundredth of it and a hundred times it.
    """
    curve = known.curve
    assert isinstance(curve, Kiencke)
    free = dataclasses.replace(
        known,
        curve=dataclasses.replace(curve, free=("a0", *curve.free)),
        lower=np.append(curve.a0 / _SLOPES, known.lower),
        upper=np.append(curve.a0 * _SLOPES, known.upper * [_SLOPES, 1.0]),
    )
    return known if method.accepts(known) is None or method.accepts(free) else free


def refusal(method: Identifier) -> str | None:
    """None, or the reason why a method cannot follow a log."""
    return method.accepts(_told(method, known_of(40.0, SLIP_LIMIT)))


def follow_log(
    methods: Mapping[str, Identifier],
    log: Log,
    slopes: Float[np.ndarray, " lanes"],
    form: Mapping[str, float] = NO_FORM,
    report: Callable[[int], object] = runtime.silent,
) -> dict[str, Followed]:
    """Every method over the samples used, by name; `report` is told how many more are done.

    `slopes` are the initial slope and, where it is uncertain, one standard error below and above
    it. `form` has the relative standard errors that the form of the curve makes.
    """

    def followed(method: Identifier) -> Followed:
        lanes = [_told(method, known_of(value, log.slip_limit)) for value in slopes.tolist()]
        known = jax.tree.map(lambda *values: np.stack([np.asarray(v) for v in values]), *lanes)
        return _follow(method, known, log, form, report)

    with runtime.threads() as pool:
        return dict(zip(methods, pool.map(followed, methods.values()), strict=True))


def _follow(
    method: Identifier,
    known: Known,
    log: Log,
    form: Mapping[str, float],
    report: Callable[[int], object],
) -> Followed:
    checkpoints = np.unique(np.linspace(0, log.used.size - 1, CHECKPOINTS).astype(int))
    structure = jax.tree.structure(jax.eval_shape(_carried, method, known))
    leaves = _begun(method, known)
    told: list[dict[str, np.ndarray]] = []
    seconds = 0.0
    for begin in range(0, log.used.size, CHUNK):
        carry = jax.tree.unflatten(structure, leaves)
        chosen = log.used[begin : begin + CHUNK]
        columns = (
            log.slip[chosen],
            log.adhesion[chosen],
            np.ones(chosen.size, bool),
            log.starts[begin : begin + CHUNK],
        )
        filled = [np.pad(column, (0, CHUNK - chosen.size)) for column in columns]
        arguments = (method, known, carry, *filled, np.array(log.time is not None))
        _chunk.ready(*arguments)  # loaded or compiled before the clock runs
        clock = perf_counter()
        leaves, more = jax.block_until_ready(_chunk(*arguments))
        complain()
        seconds += perf_counter() - clock
        count = chosen.size
        made = dict(zip(_TOLD, np.asarray(more)[:count].T, strict=True))
        told.append(_rows({"sample": begin + np.arange(count), **made}, checkpoints))
        report(count)

    tally: _Tally = jax.tree.unflatten(structure, leaves)[1]
    rows = _rows(
        {name: np.concatenate([one[name] for one in told]) for name in told[0]}, checkpoints
    )
    # Of Gaussian errors the mean product of signs is 2/pi times the arc sine of the correlation
    # (Blomqvist 1950, Ann. Math. Statist. 21:593-600).
    share = float(tally.alike) / max(float(tally.pairs), 1.0)
    correlation = float(np.sin(np.pi / 2 * share))
    held = min(max(correlation, 0.0), _MOST_ALIKE)
    alike = float(np.sqrt((1 + held) / (1 - held)))
    widening = 1.0 if method.KNOWS_MEMORY else alike
    return Followed(
        _table(rows, log, widening, form, alike),
        int(tally.resets),
        int(tally.skipped),
        int(tally.trusted),
        correlation,
        widening,
        seconds / (CHUNK * len(told)),
    )


def _rows(
    told: Mapping[str, np.ndarray], checkpoints: Int[np.ndarray, " checkpoints"]
) -> dict[str, np.ndarray]:
    """What is kept: the checkpoints, and the first few marks after each of them."""
    keep = np.isin(told["sample"], checkpoints)
    for mark in ("reset", "changed"):
        places = np.flatnonzero(told[mark])
        interval = np.searchsorted(checkpoints, told["sample"][places])
        rank = np.arange(places.size) - np.searchsorted(interval, interval)
        keep[places[rank < _MARKS]] = True
    return {name: column[keep] for name, column in told.items()}


def _table(
    rows: Mapping[str, np.ndarray],
    log: Log,
    widening: float,
    form: Mapping[str, float],
    alike: float,
) -> pd.DataFrame:
    """The estimates with `at_least`, where no fall is sure, and `reached`, the adhesion had surely.

    Errors of estimates are `widening` times those of independent noise, and those of `Fall`, of
    which `rows` has all fields, `alike` times. `reached` is 0 with too few samples, and where it
    lies above the band of a trusted estimate: the rail had it before, and has it no more.
    """

    def error(name: str) -> np.ndarray:
        noise, slope = widening * rows[f"{name}_se"], rows[f"{name}_by_slope"]
        with np.errstate(invalid="ignore"):  # an estimate may be infinite
            return np.sqrt(noise**2 + slope**2 + (form[name] * rows[name]) ** 2)

    of_peak = error("mu_max")
    reached = np.fmax(rows["reached"] - BELOW * alike * rows["reached_se"], 0.0)
    before = reached > rows["mu_max"] + QUANTILE * of_peak
    return pd.DataFrame(
        {
            "sample": log.used[rows["sample"]],
            "mu_max": rows["mu_max"],
            "mu_max_se": of_peak,
            "slip_opt": rows["slip_opt"],
            "slip_opt_se": error("slip_opt"),
            "reset": rows["reset"] > 0,
            **{name: rows[name].astype(int) for name in ("status", "resets", "skipped")},
            "at_least": ~(rows["fall"] > _SURE * alike * rows["fall_se"]),
            "reached": np.where(before & (rows["status"] == Status.TRUSTED), 0.0, reached),
        }
    )


def as_told(estimates: pd.DataFrame) -> pd.DataFrame:
    """The estimates as a reader is to take them.

    Where adhesion does not fall, mu_max is the adhesion that was reached, the largest adhesion
    being at least that, or NaN where too few samples show any; it has no standard error, and
    slip_opt is not known.
    """
    bare, reached = estimates["at_least"], estimates["reached"]
    unknown = {
        name: estimates[name].mask(bare) for name in ("mu_max_se", "slip_opt", "slip_opt_se")
    }
    known = estimates["mu_max"].mask(bare, reached.where(reached > 0))
    return estimates.assign(mu_max=known, **unknown)


def _carried(method: Identifier, known: Known) -> _Carry:
    """What is carried before any sample; states [lanes]."""
    states = jax.vmap(method.init, in_axes=(0, None))(known, jax.random.key(0))
    none = jnp.int32(0)
    ages, by_slope = jnp.zeros(known.lower.shape[:1], jnp.int32), jnp.zeros(2)
    tally = _Tally(jnp.int32(-1), jnp.zeros(()), none, none, none, none, none, ages, by_slope)
    return states, tally, empty()


# A curve in what a kept program returns would not be read again, so both return leaves.
@kept()
def _begun(method: Identifier, known: Known) -> list[Array]:
    return jax.tree.leaves(_carried(method, known))


@kept()
def _chunk(
    method: Identifier,
    known: Known,
    carry: _Carry,
    slip: Float[Array, " samples"],
    adhesion: Float[Array, " samples"],
    fresh: Bool[Array, " samples"],
    starts: Bool[Array, " samples"],
    in_time: Bool[Array, ""],
) -> tuple[list[Array], Float[Array, "samples told"]]:
    """The leaves of what is carried, and what is told after each sample, in the order of _TOLD.

    It is one array, since the loop takes longer with one for each. The first lane has the initial
    slope itself, the others, if any, lie one standard error of it below and above: `_by_slope` is
    half their difference, relative to the estimate as it was when all lanes rested on the same
    samples, for each gives up the past by itself. Of samples that are not `in_time` the slip tells
    nothing of its noise.
    """
    first = jax.tree.map(lambda leaf: leaf[0], known)

    def step(carry: _Carry, sample: tuple[Array, ...]) -> tuple[_Carry, Float[Array, " told"]]:
        (state, tally, window), (slip, adhesion, fresh, start) = carry, sample
        predicted = _prediction(first.curve, jax.vmap(method.estimate)(state), slip)
        record = Record(slip[None], adhesion[None], fresh[None], fresh[None], {})
        state = jax.vmap(method.update, in_axes=(0, None))(state, record)
        now = jax.vmap(method.estimate)(state)
        after = _counted(tally, now, adhesion - predicted, start)
        slip_opt, limit = now.values["slip_opt"][0], first.slip_limit
        past = slip_opt, now.forgetting[0], now.reset[0], start | ~in_time
        longer = extended(window, slip, adhesion, *past, limit)
        tally, window = jax.tree.map(
            lambda new, old: jnp.where(fresh, new, old), (after, longer), (tally, window)
        )
        told = {
            **_value("mu_max", now, after.by_slope[0]),
            **_value("slip_opt", now, after.by_slope[1]),
            "status": now.status[0],
            "changed": (after.status != carry[1].status) & (carry[1].status >= 0),
            "reset": now.reset[0],
            "resets": tally.resets,
            "skipped": tally.skipped,
            **fall_of(window, slip_opt, limit)._asdict(),
        }
        return (state, tally, window), jnp.stack([jnp.asarray(told[name], float) for name in _TOLD])

    carry, told = jax.lax.scan(step, carry, (slip, adhesion, fresh, starts))
    return jax.tree.leaves(carry), told


def _prediction(curve: Curve, now: Estimate, slip: Float[Array, ""]) -> Float[Array, ""]:
    """The adhesion that the first lane expects at this slip; NaN of a method without a curve."""
    if not set(curve.free) <= set(now.values):
        return jnp.asarray(jnp.nan)
    return with_free_values(curve, jnp.stack([now.values[name][0] for name in curve.free]))(
        slip, {}
    )


def _counted(
    tally: _Tally, now: Estimate, error: Float[Array, ""], start: Bool[Array, ""]
) -> _Tally:
    error = jnp.where(jnp.isfinite(error), error, 0.0)
    both = jnp.where(start, 0.0, jnp.sign(error) * jnp.sign(tally.error)).astype(jnp.int32)
    ages = jnp.where(now.reset, 0, tally.ages + 1)
    apart = jnp.stack([_apart(now.values[name]) for name in ("mu_max", "slip_opt")])
    return _Tally(
        now.status[0].astype(jnp.int32),
        error,
        tally.pairs + jnp.abs(both),
        tally.alike + both,
        tally.resets + now.reset[0],
        tally.skipped + now.skipped[0],
        tally.trusted + (now.status[0] == Status.TRUSTED.value),
        ages,
        jnp.where(jnp.all(ages == ages[0]), apart, tally.by_slope),
    )


def _apart(value: Float[Array, " lanes"]) -> Float[Array, ""]:
    """Half the difference of the lanes of a larger and of a smaller slope, over the estimate."""
    return (value[2] - value[1]) / (2 * value[0]) if value.size > 1 else jnp.zeros(())


def _value(name: str, now: Estimate, by_slope: Float[Array, ""]) -> dict[str, Float[Array, ""]]:
    """The value, the standard error that the method has, and that by the initial slope."""
    value, place = now.values[name][0], list(now.values).index(name)
    return {
        name: value,
        f"{name}_se": jnp.sqrt(now.covariance[0, place, place]),
        f"{name}_by_slope": by_slope * value,
    }
