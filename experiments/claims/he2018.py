"""He et al. 2018: Experiment 1, the consistency of Eq. 15, and what the text says beside them."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray
from scipy.stats import qmc

from adhesion_jax.campaign.job import Config, build_scenario
from adhesion_jax.campaign.keys import noise_keys
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.campaign.tiles import TILE, tile_runs
from adhesion_jax.identifiers import IDENTIFIERS, identify
from adhesion_jax.metrics.information import cramer_rao_bound, quantities, quantity_names
from adhesion_jax.metrics.moments import Moments
from adhesion_jax.optim.box import on_bound
from adhesion_jax.records import Record
from adhesion_jax.scenarios import Scenario
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rails import RAILS, peak_of
from experiments.claims.claim import (
    DRAWS,
    READ_OFF,
    Claim,
    Numbers,
    below,
    equal,
    of_settings,
    read_paper,
)

PAPER = read_paper("he2018")

#: A parameter has converged where its RMSE stays within this share of the truth (our reading:
#: the paper shows single runs and gives no criterion).
CONVERGED = PAPER.claims["near_truth"]["below"] / 100

#: The slip by which Experiment 1 says that each quantity has converged.
CONVERGED_BY = {"c1": 0.1, "c2": 0.1, "c3": 0.4, "mu_max": 0.4}


def slip_at_convergence(slip: Numbers, rmse: Numbers, rmse_error: Numbers) -> tuple[float, float]:
    """The slip from which a relative RMSE stays within `CONVERGED`, and its standard error.

    RMSE is taken as a power of the slip between two checkpoints. Infinite where it is still
    larger at the end. Where it never is, the first checkpoint, without an error: the crossing
    may lie anywhere before.
    """
    above = np.flatnonzero(~(rmse <= CONVERGED))
    if above.size == 0:
        return float(slip[0]), float("nan")
    i = int(above[-1])
    if i == len(slip) - 1:
        return float("inf"), 0.0
    steps = np.log(rmse[i : i + 2] / CONVERGED)
    power = (steps[1] - steps[0]) / np.log(slip[i + 1] / slip[i])
    crossing = slip[i] * np.exp(-steps[0] / power)
    weight = steps / (steps[0] - steps[1])  # of the other end's error in log RMSE
    relative = rmse_error[i : i + 2] / rmse[i : i + 2]
    error = crossing * np.hypot(weight[1] * relative[0], weight[0] * relative[1]) / abs(power)
    return float(crossing), float(error)


def convergence_claims(config: Config, progress: Callable[[str], None]) -> Iterator[Claim]:
    """c1 and c2 by slip .1, c3 and mu_max by .4, on the dry rail (Fig. 4 to 7)."""
    scenario = build_scenario(config)
    table = run_campaign(config, lambda _: None, progress).tables["checkpoints"]
    slip, sigma = np.asarray(scenario.draw(jax.random.key(0)).slip[0]), scenario.noise.sigma
    table = table.assign(slip=slip[table["k"].to_numpy() - 1])
    for name in ("rmse", "rmse_se"):
        table[f"{name}_share"] = table[name] / table["truth"]
    for quantity, by in CONVERGED_BY.items():
        rows = table[table["quantity"] == quantity].set_index("slip")
        ours, exact = (rows[rows["identifier"] == name] for name in ("ml-de", "ml-exact"))
        (reached, reached_error), (exact_reached, _) = (
            slip_at_convergence(
                one.index.to_numpy(), one["rmse_share"].to_numpy(), one["rmse_se_share"].to_numpy()
            )
            for one in (ours, exact)
        )
        slips = ours.index.to_numpy(dtype=float)
        place = float(slips[np.abs(slips - by).argmin()])
        censored = np.isnan(reached_error)
        first = "It is so at the first estimate, and may be so before. " if censored else ""
        bound = 100 * exact["crlb"][place] / exact["truth"][place]
        told = {"quantity": quantity, "by": by, "percent": 100 * CONVERGED, "bound": bound}
        verdict = below(reached, float(np.nan_to_num(reached_error)), by, config.runs)
        facts = {"exact_reached": exact_reached, "first": slips[0], "sigma": sigma, "printed": by}
        facts |= {"censored": first, "with_variance": bound * sigma**-0.5}
        yield PAPER.judged("converged", reached, verdict, reached_error, **told, **facts)
        facts = {"exact": 100 * exact["rmse_share"][place]}
        facts |= {"on_box": 100 * exact["at_bound_share"][place]}
        facts |= {"missed": 100 * ours["failure_share"][place], **told}
        percent, error = 100 * ours["rmse_share"][place], 100 * ours["rmse_se_share"][place]
        yield PAPER.below("near_truth", percent, error, config.runs, **facts)
    # The relative RMSE of c3 over that of c1 and c2, at the last estimate.
    last = table[(table["identifier"] == "ml-de") & (table["k"] == table["k"].max())]
    share = last.set_index("quantity")["rmse_share"]
    part = last.set_index("quantity")["rmse_se"] / last.set_index("quantity")["rmse"]
    other = max(("c1", "c2"), key=share.__getitem__)
    ratio = float(share[other] / share["c3"])
    error = ratio * float(np.hypot(part[other], part["c3"]))
    yield PAPER.below("largest_error", ratio, error, config.runs, share=100 * share)


# ------------------------------------------------------------------------------------- consistency


def over_runs(
    runs: int,
    compute: Callable[[Int[Array, " runs"]], Float[Array, "..."] | Int[Array, "..."]],
    advance: Callable[[], None],
) -> np.ndarray:
    """`compute` of the run numbers of each tile, joined; `advance` is called after each tile."""
    parts = []
    for number in range(-(-runs // TILE)):
        parts.append(np.asarray(compute(jnp.asarray(tile_runs(number)))))
        advance()
    return np.concatenate(parts)[:runs]


#: Number of points in a block of the consistency experiment.
SIZES = (125, 250, 500, 1000, 2000, 4000, 8000)


class Fit(NamedTuple):
    """A power law fitted to RMSE against the number of points."""

    slope: float
    slope_error: float


def power_law(points: Numbers, rmse: Numbers, rmse_error: Numbers) -> Fit:
    """The slope of the line log RMSE = constant + slope log n by least squares.

    Weighted with the errors of log RMSE. The RMSEs are independent of each other, so the slope's
    error follows from theirs alone.
    """
    line, covariance = np.polyfit(
        np.log(points), np.log(rmse), 1, w=rmse / rmse_error, cov="unscaled"
    )
    return Fit(float(line[0]), float(np.sqrt(covariance[0, 0])))


def consistency_table(
    scenario: Scenario,
    seed: int,
    runs: int,
    progress: Callable[[str], None],
    sizes: tuple[int, ...] = SIZES,
) -> pd.DataFrame:
    """RMSE, its error and the bound of the exact optimum on blocks of different sizes.

    The noise of the sizes is independent, and so are their errors. One row a size and quantity.
    """
    # All are as long as the largest, because the solver takes longer to compile than to run.
    blocks = [np.pad(np.linspace(0.0, 0.2, points), (0, max(sizes) - points)) for points in sizes]
    slip = jnp.asarray(np.stack(blocks))
    mask = jnp.asarray(np.arange(max(sizes)) < np.array(sizes)[:, None])
    curve, known, sigma = RAILS[scenario.rails[0]], scenario.known, scenario.noise.sigma
    clean = curve(slip, {})

    @jax.jit
    def tile(noise: Key[Array, " runs"]) -> Float[Array, "runs sizes values"]:
        def one_run(key: PRNGKeyArray) -> Float[Array, "sizes values"]:
            adhesion = clean + Noise(sigma).draw(key, clean.shape)
            estimate = identify(
                IDENTIFIERS["ml-exact"], known, Record(slip, adhesion, mask, mask, {}), key
            )
            return jnp.stack(list(estimate.values.values()), axis=-1)

        return jax.vmap(one_run)(noise)

    def of_tile(chosen: Int[Array, " runs"]) -> Float[Array, "runs sizes values"]:
        return tile(noise_keys(seed, "claims-consistency", chosen))

    estimates = over_runs(runs, of_tile, partial(progress, "consistency"))
    truth = np.asarray(quantities(curve, known))
    free = estimates[..., : len(known.curve.free)]
    on_box = np.asarray(on_bound(jnp.asarray(free), known.lower, known.upper)).any(axis=-1)
    moments = Moments.of(
        {"squared_error": (estimates - truth) ** 2, "on_box": on_box.astype(float)}
    )
    rmse = np.sqrt(moments.mean("squared_error"))
    bounds = jax.vmap(lambda slip, mask: cramer_rao_bound(curve, slip, mask, {}, sigma, known))
    names = quantity_names(known.curve)
    return pd.DataFrame(
        {
            "points": np.repeat(sizes, len(names)),
            "quantity": np.tile(names, len(sizes)),
            "truth": np.tile(truth, len(sizes)),
            "rmse": rmse.ravel(),
            "rmse_se": (moments.standard_error("squared_error") / (2 * rmse)).ravel(),
            "crlb": np.ravel(jax.jit(bounds)(slip, mask)),
            "at_bound_share": np.repeat(moments.mean("on_box"), len(names)),
        }
    )


def consistency_fits(table: pd.DataFrame) -> dict[str, Fit]:
    return {
        quantity: power_law(
            *(rows[column].to_numpy(dtype=float) for column in ("points", "rmse", "rmse_se"))
        )
        for quantity in CONVERGED_BY
        for rows in [table[table["quantity"] == quantity]]
    }


def consistency_claims(table: pd.DataFrame) -> Iterator[Claim]:
    """The estimate converges to the truth (Eq. 15); its RMSE then falls as n^(-1/2)."""
    expected = PAPER.claims["consistency"]["printed"]
    for quantity, fit in consistency_fits(table).items():
        rows = table[table["quantity"] == quantity]
        ends = rows.iloc[[0, -1]]
        share = 100 * (ends["rmse"] / ends["truth"]).to_numpy()
        facts = {"quantity": quantity, "share": share, "points": ends["points"].to_numpy()}
        facts |= {"ratio": (ends["rmse"] / ends["crlb"]).to_numpy()}
        facts |= {"on_box": 100 * rows["at_bound_share"].max()}
        verdict = equal(fit.slope, fit.slope_error, expected)
        yield PAPER.judged("consistency", fit.slope, verdict, fit.slope_error, **facts)


# -------------------------------------------------------------------------- beside the experiments


#: Of the factors of Eq. 4 that are left out: c4 in s/m, slip, speed in m/s, c5 in 1/kN², load of a
#: wheel in kN. c5 is that of a car at one end.
_FACTOR = ((0.001, 0.0, 1.0, 1e-8, 50.0), (0.05, 0.2, 33.0, 1.5e-4, 150.0))

#: Runs of the experiment with a switch in the growing sequence.
_SWITCHED = 64


def fact_claims(scenario: Scenario, progress: Callable[[str], None]) -> Iterator[Claim]:
    dry, *others = (peak_of(RAILS[rail])[1] for rail in ("dry", "common", "wet"))
    for rail, largest in zip(("common", "wet"), others, strict=True):
        yield PAPER.near("water", 100 * (1 - largest / dry), READ_OFF, rail=rail)
    yield PAPER.judged("humidity")
    yield _left_out()
    yield PAPER.judged("real_time", 20 * 300 * 500 / 1e6)
    yield _switched(scenario, progress)


def _left_out() -> Claim:
    """The factor exp(-c4 l V) (1 - c5 F^2) of Eq. 4."""
    low, high = map(np.array, _FACTOR)
    share = qmc.Sobol(len(low), rng=0).random(DRAWS)
    c4, slip, speed, c5, load = (low + (high - low) * share).T
    c5 = low[3] * (high[3] / low[3]) ** share[:, 3]
    factor = np.exp(-c4 * slip * speed) * (1 - c5 * load**2)
    verdict = of_settings(np.abs(factor - 1) < 0.05)
    return PAPER.judged("factors", float(np.median(factor)), verdict, least=factor.min())


def _switched(scenario: Scenario, progress: Callable[[str], None]) -> Claim:
    """Experiment 1 on a rail that gets common in the middle of its one growing sequence."""
    known, sigma = scenario.known, scenario.noise.sigma
    slip = jnp.linspace(0.0, 0.5, 500)
    half = jnp.arange(500) < 250
    clean = jnp.where(half, RAILS["dry"](slip, {}), RAILS["common"](slip, {}))
    mask = jnp.ones(500, dtype=bool)

    @jax.jit
    @jax.vmap
    def largest(key: jax.Array) -> jax.Array:
        adhesion = clean + sigma * jax.random.normal(key, clean.shape)
        record = Record(slip[None], adhesion[None], mask[None], mask[None], {})
        return identify(IDENTIFIERS["ml-exact"], known, record, key).values["mu_max"][-1]

    found = np.asarray(largest(jax.random.split(jax.random.key(0), _SWITCHED)))
    progress("switched rail")
    truth = peak_of(RAILS["common"])[1]
    off = 100 * np.abs(found / truth - 1)
    error = float(off.std(ddof=1) / np.sqrt(_SWITCHED))
    return PAPER.below("switched", float(off.mean()), error, _SWITCHED)
