"""The methods of Qian et al. 2024 at settings of what the paper does not print."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.identifiers.online import Sample
from adhesion_jax.identifiers.qp_qian2024 import ProgramRecursion, QuadraticProgram
from adhesion_jax.records import Known
from adhesion_jax.scenarios.rails import QIAN2024
from experiments.claims.claim import Numbers
from experiments.claims.paper import read_paper, values

PAPER = read_paper("qian2024")


#: Samples before and after the switch, and runs of a setting.
_HALF, _RUNS = 500, 64

#: Samples in which a slip that is not drawn anew at each of them goes up and down once.
_PERIOD = 100

#: An estimate without a peak counts as this much too high.
_NO_PEAK = 10.0

#: Tracked is what stays this near for ten samples, as in the tables of a campaign.
_TRACKED, _IN_A_ROW = 0.03, 10

#: Share and size of outliers, as in the option of a campaign.
_OUTLIERS, _TIMES = 0.03, 10.0

_TAPS = 5

_MOMENTS = {"p1": 30, "p2": 250, "mu_max": 230}


class Outcomes(NamedTuple):
    """Of each setting, our own first: [settings, variants] where not said otherwise."""

    readings: Mapping[str, Numbers]  # [settings], RMSE of Algorithm 1 as a share of the truth
    rmse: Numbers  # of mu_max before the switch, as a share
    rmse_outliers: Numbers
    delay: Numbers  # samples after it
    fluctuation: Numbers
    waving: Numbers  # [settings], the RMSE of Algorithm 1 where slip goes up and down slowly
    filtered: Numbers  # the same behind an FIR filter
    acts: Numbers  # [settings, 2], share of samples in which S acts: variances, deviations


Setting = Mapping[str, Float[Array, ""]]
#: Slip and adhesion of a run.
Pair = tuple[Float[Array, " samples"], Float[Array, " samples"]]
Signals = Callable[[Setting, PRNGKeyArray], Pair]


class _Run(NamedTuple):
    readings: Mapping[str, Float[Array, " variants"]]
    squares: Float[Array, " variants"]
    delay: Float[Array, " variants"]
    fluctuation: Float[Array, " variants"]


def outcomes(
    variants: Mapping[str, QuadraticProgram], seed: int, progress: Callable[[str], None]
) -> Outcomes:
    """Every setting on the same random numbers; each variant on the same data."""
    settings = PAPER.settings()
    numbers = {name: jnp.asarray(values(settings, name)) for name in PAPER.ranges}
    stacked = jax.tree.map(lambda *x: jnp.stack([*map(jnp.asarray, x)]), *variants.values())
    keys = jax.random.split(jax.random.key(seed), _RUNS)

    def over(signals: Signals, methods: QuadraticProgram) -> _Run:
        """[settings, runs, variants], one setting after the other to bound the memory."""
        one = jax.vmap(partial(_run, methods, signals), (None, 0))
        found: _Run = jax.jit(partial(jax.lax.map, lambda each: one(each, keys)))(numbers)
        return found

    def mean_square(squares: Array) -> Numbers:
        return np.sqrt(np.asarray(squares).mean(axis=1))

    plain, outlying = over(_random, stacked), over(partial(_random, outliers=_OUTLIERS), stacked)
    first = jax.tree.map(lambda x: x[-1:], stacked)
    waving, filtered = over(_wave, first), over(_filtered, first)
    progress("Qian 2024, settings")
    acting = jax.vmap(jax.vmap(partial(_acting, first), (None, 0)), (0, None))
    acts = np.asarray(jax.jit(acting)(numbers, keys[:8])).mean(axis=1)
    progress("Qian 2024, statistic")
    return Outcomes(
        {name: mean_square(x[..., -1] ** 2) for name, x in plain.readings.items()},
        mean_square(plain.squares),
        mean_square(outlying.squares),
        np.asarray(plain.delay).mean(axis=1),
        np.asarray(plain.fluctuation).mean(axis=1),
        mean_square(waving.squares)[:, 0],
        mean_square(filtered.squares)[:, 0],
        acts,
    )


def _curves(setting: Setting) -> tuple[Kiencke, Kiencke]:
    """Before and after the switch; both rise as steeply."""
    slope = setting["steepness"] * 2 * setting["largest"] / setting["best_slip"]

    def peaked(slip: Float[Array, ""], largest: Float[Array, ""]) -> Kiencke:
        return Kiencke(a0=slope, p1=slope / largest - 2 / slip, p2=slip**-2)

    later = setting["after"] * setting["largest"]
    return (
        peaked(setting["best_slip"], setting["largest"]),
        peaked(1.75 * setting["best_slip"], later),
    )


def _adhesion(
    setting: Setting, slip: Float[Array, " samples"], key: PRNGKeyArray, outliers: float
) -> Float[Array, " samples"]:
    noises, outlying = jax.random.split(key)
    before, after = _curves(setting)
    clean = jnp.where(jnp.arange(2 * _HALF) < _HALF, before(slip, {}), after(slip, {}))
    noise = setting["sigma"] * jax.random.normal(noises, slip.shape)
    is_outlier = jax.random.uniform(outlying, slip.shape) < outliers
    return clean + jnp.where(is_outlier, _TIMES, 1.0) * noise


def _random(setting: Setting, key: PRNGKeyArray, outliers: float = 0.0) -> Pair:
    """Slips drawn anew at every sample."""
    slips, noises = jax.random.split(key)
    slip = setting["slip_end"] * jax.random.uniform(slips, (2 * _HALF,))
    return slip, _adhesion(setting, slip, noises, outliers)


def _wave(setting: Setting, key: PRNGKeyArray) -> Pair:
    """Slips that go up and down, as a filter of the signals needs them."""
    turn = 2 * jnp.pi * jnp.arange(2 * _HALF) / _PERIOD
    slip = setting["slip_end"] * (1 - jnp.cos(turn)) / 2
    return slip, _adhesion(setting, slip, key, 0.0)


def _filtered(setting: Setting, key: PRNGKeyArray) -> Pair:
    weights = jnp.ones(_TAPS) / _TAPS
    slip, adhesion = (jnp.convolve(one, weights)[: 2 * _HALF] for one in _wave(setting, key))
    return slip, adhesion


def _known(setting: Setting) -> Known:
    start = Kiencke(a0=_curves(setting)[0].a0, p1=100.0, p2=50.0)
    return Known(curve=start, lower=QIAN2024.lower, upper=QIAN2024.upper)


def _method(method: QuadraticProgram, setting: Setting) -> QuadraticProgram:
    values = {field: getattr(method, field) for field in ("weight_falls", "eta_least")}
    return QuadraticProgram(
        **values,
        eta_most=method.eta_most,
        gain=setting["gain"],
        redistributes=method.redistributes,
        low=setting["low"],
        high=setting["low"] + setting["width"],
    )


def _followed(
    method: QuadraticProgram,
    setting: Setting,
    signals: Pair,
    seen: Callable[[ProgramRecursion], Float[Array, " values"]],
) -> Float[Array, "samples values"]:
    """`seen` of the recursion after every sample."""
    known, own = _known(setting), _method(method, setting)
    first = own.init(known, jax.random.key(0)).recursion

    def after(
        recursion: ProgramRecursion, sample: tuple[Array, Array]
    ) -> tuple[ProgramRecursion, Float[Array, " values"]]:
        recursion = own.step(known, recursion, Sample(jnp.asarray(True), *sample, ()))
        return recursion, seen(recursion)

    return jax.lax.scan(after, first, signals)[1]


def _run(methods: QuadraticProgram, given: Signals, setting: Setting, key: PRNGKeyArray) -> _Run:
    signals = given(setting, key)
    curves = _curves(setting)
    peaks = jnp.stack([curve.a0 / (curve.p1 + 2 * jnp.sqrt(curve.p2)) for curve in curves])
    truth = jnp.repeat(peaks, _HALF)

    def one(method: QuadraticProgram) -> _Run:
        p1, p2 = _followed(method, setting, signals, lambda state: state.x.array()).T
        largest = curves[0].a0 / (p1 + 2 * jnp.sqrt(p2))
        off = jnp.clip(jnp.nan_to_num(largest / truth - 1, nan=_NO_PEAK), -1.0, _NO_PEAK)
        values = {"p1": p1 / curves[0].p1 - 1, "p2": p2 / curves[0].p2 - 1, "mu_max": off}
        return _Run(
            {name: values[name][k - 1] for name, k in _MOMENTS.items()},
            off[_HALF - 1] ** 2,
            _delay(jnp.abs(off[_HALF:]) < _TRACKED),
            jnp.mean(jnp.abs(jnp.diff(largest[_HALF // 2 : _HALF]))) / truth[0],
        )

    return jax.vmap(one)(methods)


def _delay(near: Bool[Array, " samples"]) -> Float[Array, ""]:
    """The samples before the first of ten in a row that are near; all of them if none is."""
    count = jnp.cumsum(jnp.concatenate([jnp.zeros(1), near]))
    row = count[_IN_A_ROW:] - count[:-_IN_A_ROW] == _IN_A_ROW
    return jnp.where(jnp.any(row), jnp.argmax(row), _HALF).astype(float)


def _acting(methods: QuadraticProgram, setting: Setting, key: PRNGKeyArray) -> Float[Array, "2"]:
    """The shares of samples in which every element of S lies in the critical interval."""
    signals = _random(setting, key)
    method = jax.tree.map(lambda x: x[0], methods)
    sums = _followed(
        method, setting, signals, lambda state: jnp.stack([*jax.tree.leaves(state.normal.h)])
    )
    slip, adhesion = signals
    first, second = slip * adhesion, slip**2 * adhesion
    now = jnp.stack([first * first, first * second, second * second], axis=-1)[5:]
    past = [sums[5 - back : len(sums) - back] for back in range(1, 6)]
    triples = (jnp.stack([now, *past[:2]]), jnp.stack(past[2:]))
    gap = triples[0].mean(axis=0) - triples[1].mean(axis=0)
    shares = []
    for spread in (jnp.var, jnp.std):
        ratio = gap / (spread(triples[0], axis=0) + spread(triples[1], axis=0))
        within = (ratio > setting["low"]) & (ratio < setting["low"] + setting["width"])
        shares.append(jnp.mean(jnp.all(within, axis=-1)))
    return jnp.stack(shares)
