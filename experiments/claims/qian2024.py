"""Qian et al. 2024: accuracy at three moments, Algorithm 1 against 2, and which change does it.

The paper draws its curves without their parameters, and prints neither its noise nor the gain and
the critical interval of its method: each claim is judged over settings of these.
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import product
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from adhesion_jax.campaign.job import Config
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.identifiers.online import Sample
from adhesion_jax.identifiers.qp_qian2024 import ProgramRecursion, QuadraticProgram, variant
from adhesion_jax.records import Known
from adhesion_jax.scenarios import Options
from adhesion_jax.scenarios.rails import QIAN2024
from experiments.claims.claim import Claim, Numbers, of_settings, read_paper, values
from experiments.claims.traction import changed

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

#: Quantity, samples seen, and the paper's error in per cent.
READINGS = (("p1", 30, 1.0), ("p2", 250, 1.0), ("mu_max", 230, 0.1))


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
    low, high = setting["low"], setting["low"] + setting["width"]
    return changed(method, gain=setting["gain"], low=low, high=high)


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
            {name: values[name][k - 1] for name, k, _ in READINGS},
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


# ------------------------------------------------------------------------------------- the claims

#: The three things in which Algorithm 1 differs from 2: the setting of 2, that of 1.
FACTORS = {
    "weight": ("1", "(2-eta)/2"),
    "eta from": ("0.971", "0.251"),
    "redistribution": ("no", "yes"),
}

#: The outcomes, by column of the table of variants.
OUTCOMES = {
    "rmse": "RMSE of mu_max before the switch",
    "delay": "mean delay after the switch",
    "rmse_outliers": "RMSE of mu_max before the switch, 3 % outliers",
}


def variants() -> dict[str, QuadraticProgram]:
    """All eight combinations of the factors; a name has 1 where the setting is Algorithm 1's."""
    found = {}
    for weight, low, shared in product((0, 1), repeat=3):
        name = f"qp-{weight}{low}{shared}"
        found[name] = variant(bool(weight), (0.971, 0.251)[low], 1.0, bool(shared))
    return found


def reading_claims(
    runs: int, seed: int, drawn: Outcomes, progress: Callable[[str], None]
) -> Iterator[Claim]:
    """The errors that are printed for three moments, against Algorithm 1 and the bound."""
    config = Config("qian2024", ("qp-qian2024-1", "riv"), Options(), runs, seed)
    table = run_campaign(config, lambda _: None, progress).tables["checkpoints"]
    for quantity, k, percent in READINGS:
        rows = table[(table["quantity"] == quantity) & (table["k"] == k)].set_index("identifier")
        share = 100 * rows[["rmse", "rmse_se", "crlb"]].div(rows["truth"], axis=0)
        ours, error, bound = map(float, share.loc["qp-qian2024-1"].to_numpy())
        peer = share["rmse"].to_dict()["riv"]
        others = 100 * drawn.readings[quantity][1:]
        facts = {"quantity": quantity, "k": k, "bound": bound, "peer": peer}
        facts |= {"median": np.median(others), "printed": percent}
        yield PAPER.judged("reading", ours, of_settings(others < percent), error, **facts)


def factorial_table(runs: int, seed: int, progress: Callable[[str], None]) -> pd.DataFrame:
    """A row for each variant: its settings, and each outcome with its standard error.

    On the switching stream, without outliers and with.
    """
    rows = pd.DataFrame(list(product((0, 1), repeat=3)), columns=list(FACTORS))
    rows.insert(0, "variant", list(variants()))
    for options, suffix in ((Options(), ""), (Options(outliers=_OUTLIERS), "_outliers")):
        config = Config("qian2024-switch", tuple(variants()), options, runs, seed)
        campaign = run_campaign(config, lambda _: None, progress, identifiers=variants())
        summary = campaign.tables["summary"].query("quantity == 'mu_max'")
        dry = summary[summary["rail"] == "dry"].set_index("identifier").loc[rows["variant"]]
        tracking = campaign.tables["tracking"].query("rail == 'common'")
        tracking = tracking.set_index("identifier").loc[rows["variant"]]
        for error in ("", "_se"):
            rows[f"rmse{suffix}{error}"] = (dry[f"rmse{error}"] / dry["truth"]).to_numpy()
            rows[f"delay{suffix}{error}"] = tracking[f"delay_mean{error}"].to_numpy()
    return rows


def factorial_claims(table: pd.DataFrame, drawn: Outcomes) -> Iterator[Claim]:
    """Algorithm 1 against 2, then the three changes one by one.

    The effect of a change is the ratio of an outcome with the setting of 1 to that with 2's, a
    geometric mean over the settings of the other two. Its error takes the variants as independent;
    they see the same noise, so it is rather too large.
    """
    first, second = table.iloc[-1], table.iloc[0]
    for outcome, words in OUTCOMES.items():
        ratio = float(first[outcome] / second[outcome])
        error = ratio * float(
            np.hypot(*(row[f"{outcome}_se"] / row[outcome] for row in (first, second)))
        )
        values = getattr(drawn, outcome)
        told = (_number(outcome, row[outcome]) for row in (first, second))
        facts = {"words": words, **dict(zip(("first", "second"), told, strict=True))}
        yield _smaller("algorithms", ratio, values[:, -1] / values[:, 0], error, **facts)
    half = len(table) / 2
    for factor, (before, after) in FACTORS.items():
        sign = np.where(table[factor] == 1, 1.0, -1.0)
        for outcome, words in OUTCOMES.items():
            relative = table[f"{outcome}_se"] / table[outcome]
            ratio = float(np.exp(np.sum(sign * np.log(table[outcome])) / half))
            error = ratio * float(np.sqrt(np.sum(relative**2))) / half
            ratios = np.exp(np.log(getattr(drawn, outcome)) @ (sign / half))
            facts = {"factor": factor, "before": before, "after": after, "words": words}
            yield _smaller("factor", ratio, ratios, error, **facts)


def other_claims(drawn: Outcomes) -> list[Claim]:
    """The fluctuation of the estimate, the filter that is announced, and S as printed."""
    fluctuation, filtered = drawn.fluctuation, drawn.filtered / drawn.waving
    calmer, acts = fluctuation[:, -1] / fluctuation[:, 0], 100 * drawn.acts
    deviations, share = acts[0, 1], 100 * np.mean(acts[1:, 1] > 0)
    variances = acts[:, 0]
    facts = {"deviations": deviations, "share": share}
    return [
        _smaller("fluctuation", calmer[0], calmer),
        _smaller("filter", filtered[0], filtered),
        PAPER.over_settings("redistribution", variances, variances > 0, **facts),
    ]


def _smaller(
    key: str, ratio: float, drawn: Numbers, error: float = np.nan, **facts: object
) -> Claim:
    """Whether a ratio is below 1 in the settings drawn, whatever it is at ours with many runs."""
    low, high = np.quantile(drawn[1:], (0.1, 0.9))
    return PAPER.judged(key, ratio, of_settings(drawn[1:] < 1), error, low=low, high=high, **facts)


def _number(outcome: str, value: float) -> str:
    return f"{value:.3g} samples" if outcome.startswith("delay") else f"{100 * value:.3g} %"
