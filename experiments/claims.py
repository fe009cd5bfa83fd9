"""Hold the claims of published papers against what can be computed: claims.csv and its figures."""

import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import click
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Array, Float, Int, PRNGKeyArray
from numpy.typing import NDArray
from tqdm import tqdm

from adhesion_jax.campaign.config import Config, build_scenario
from adhesion_jax.campaign.keys import noise_keys, solver_keys
from adhesion_jax.campaign.monte_carlo import progress_steps, run_campaign
from adhesion_jax.campaign.store import staged, write_table
from adhesion_jax.campaign.tiles import TILE, tile_runs
from adhesion_jax.identifiers import IDENTIFIERS, identify
from adhesion_jax.identifiers.burckhardt_sums import burckhardt_sums
from adhesion_jax.identifiers.curve_fit import residual
from adhesion_jax.identifiers.ml_de import (
    CROSSOVER,
    GENERATIONS,
    POPULATION,
    DifferentialEvolutionMaximumLikelihood,
    ml_de,
    ml_de_eq16,
    ml_de_eq17,
)
from adhesion_jax.metrics.information import cramer_rao_bound, quantities, quantity_names
from adhesion_jax.metrics.moments import Moments
from adhesion_jax.optim import differential_evolution as de
from adhesion_jax.optim import variable_projection
from adhesion_jax.optim.box import on_bound
from adhesion_jax.report import claims as report
from adhesion_jax.report.claims import Claim
from adhesion_jax.scenarios import Known, Options, Record, Scenario
from adhesion_jax.scenarios.noise import draw_noise
from experiments.command import output_directory, run

Numbers = NDArray[np.float64]
Report = Callable[[str], None]

HE2018 = "He et al. 2018"

#: A parameter has converged where its RMSE stays within this share of the truth (our reading:
#: the paper shows single runs and gives no criterion).
CONVERGED = 0.05

#: The slip by which Experiment 1 says that each quantity has converged.
CONVERGED_BY = {"c1": 0.1, "c2": 0.1, "c3": 0.4, "mu_max": 0.4}

#: A search fails where its sum of squares exceeds the optimum by more sigma^2 than this.
FAILURE_GAP = 1.0

#: A search has arrived where the excess is at most this many sigma^2.
ARRIVED_GAP = 1e-2

#: Number of points in a block of the consistency experiment.
SIZES = (125, 250, 500, 1000, 2000, 4000, 8000)

_RESAMPLES = 400

#: Experiment 2, its ablations, Experiment 3, and what each is called in a sentence.
_VARIANTS = {
    "ml-de-eq16": "Eq. 16 alone",
    "ml-de-eq17": "Eq. 17 alone",
    "ml-de-he2018": "the modified algorithm",
}


# ------------------------------------------------------------------ Experiment 1: convergence


def slip_at_convergence(slip: Numbers, rmse: Numbers, rmse_error: Numbers) -> tuple[float, float]:
    """The slip from which a relative RMSE stays within `CONVERGED`, and its standard error.

    RMSE is taken as a power of the slip between two checkpoints. Infinite where it is still
    larger at the end; the first checkpoint where it never is.
    """
    above = np.flatnonzero(~(rmse <= CONVERGED))
    if above.size == 0:
        return float(slip[0]), 0.0
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


def convergence_claims(config: Config, progress: Report) -> list[Claim]:
    """c1 and c2 by slip .1, c3 and mu_max by .4, on the dry rail (Fig. 4 to 7)."""
    scenario = build_scenario(config)
    campaign = run_campaign(config, lambda _: None, progress)
    table = campaign.tables["checkpoints"]
    slip = np.asarray(scenario.draw(jax.random.key(0)).slip[0])
    table = table.assign(slip=slip[table["k"].to_numpy() - 1])
    found: list[Claim] = []
    for quantity, by in CONVERGED_BY.items():
        at = {
            name: rows.set_index("slip")
            for name, rows in table[table["quantity"] == quantity].groupby("identifier")
        }
        ours, exact = at["ml-de"], at["ml-exact"]
        relative = {name: rows["rmse"] / rows["truth"] for name, rows in at.items()}
        error = ours["rmse_se"] / ours["truth"]
        reached, reached_error = slip_at_convergence(
            ours.index.to_numpy(), relative["ml-de"].to_numpy(), error.to_numpy()
        )
        exact_reached, _ = slip_at_convergence(
            exact.index.to_numpy(),
            relative["ml-exact"].to_numpy(),
            (exact["rmse_se"] / exact["truth"]).to_numpy(),
        )
        slips = ours.index.to_numpy(dtype=float)
        place = float(slips[np.abs(slips - by).argmin()])
        percent = 100 * relative["ml-de"][place]
        bound = 100 * exact["crlb"][place] / exact["truth"][place]
        found.append(
            Claim(
                HE2018,
                f"Exp. 1: {quantity} has converged by slip {by:g} "
                f"(RMSE of ml-de stays within {100 * CONVERGED:g} %)",
                by,
                reached,
                reached_error,
                "slip (1)",
                report.verdict_below(reached, reached_error, by),
                f"The exact optimum is there from slip {exact_reached:.3g} (first estimate at "
                f"{slips[0]:.3g}); the noise is read as sigma = {scenario.sigma:g}, "
                f"for with variance {scenario.sigma:g} the bound on an unbiased estimate would "
                f"still be {bound * scenario.sigma**-0.5:.2g} % at slip {by:g}.",
            )
        )
        found.append(
            Claim(
                HE2018,
                f"Exp. 1: {quantity} at slip {by:g} is near its true value "
                f"(RMSE of ml-de below {100 * CONVERGED:g} %)",
                float("nan"),
                float(percent),
                float(100 * error[place]),
                "% of truth",
                report.verdict_below(float(percent), float(100 * error[place]), 100 * CONVERGED),
                f"The exact optimum has {100 * relative['ml-exact'][place]:.3g} %, the Cramér-Rao "
                f"bound of an estimate without a box is {bound:.3g} %; "
                f"{100 * exact['at_bound_share'][place]:.0f} % of the exact optima lie on the box "
                f"and {100 * ours['failure_share'][place]:.1f} % of the searches miss theirs.",
            )
        )
    return found


# ------------------------------------------------------- Experiments 2 and 3: scatter, tracking


class Blocks(NamedTuple):
    """Estimates of each identifier as arrays [runs, blocks], and the rail of each block."""

    rails: tuple[str, ...]
    values: Mapping[str, Mapping[str, Numbers]]
    failed: Mapping[str, NDArray[np.bool_]]  # the search missed the optimum

    def groups(self, switch: bool) -> list[list[int]]:
        """The blocks of each rail: those right after a switch, or those in steady running.

        The first of all blocks is neither: theta(k-1) is then no estimate but the start.
        """
        chosen = [b for b in range(1, len(self.rails)) if self._begins(b) == switch]
        named = {rail: [b for b in chosen if self.rails[b] == rail] for rail in self.rails}
        return [group for group in named.values() if group]

    def _begins(self, block: int) -> bool:
        return self.rails[block] != self.rails[block - 1]


def as_blocks(rows: pd.DataFrame, scenario: Scenario) -> Blocks:
    """From the estimates of a campaign, one row a run, identifier and block."""
    count = len(scenario.rails)

    def array(identifier: str, column: str) -> Numbers:
        chosen = rows.loc[rows["identifier"] == identifier, column]
        return chosen.to_numpy(dtype=float).reshape(-1, count)

    names = list(dict.fromkeys(rows["identifier"]))
    optimum = array("ml-exact", "objective")
    return Blocks(
        scenario.rails,
        {name: {q: array(name, q) for q in quantity_names(scenario.known.curve)} for name in names},
        {
            name: ~(array(name, "objective") - optimum <= FAILURE_GAP * scenario.sigma**2)
            for name in names
        },
    )


def standard_deviation(x: Numbers) -> float:
    return float(np.std(x, ddof=1))


def robust_deviation(x: Numbers) -> float:
    """The interquartile range, scaled to the standard deviation of a normal distribution."""
    low, high = np.percentile(x, [25, 75])
    return float((high - low) / 1.349)


def scatter_ratio(
    upper: Numbers,
    lower: Numbers,
    groups: list[list[int]],
    scatter: Callable[[Numbers], float],
    random: np.random.Generator,
) -> tuple[float, float]:
    """Scatter of one method over that of another, [runs, blocks] each: geometric mean over rails.

    The standard error is a bootstrap over whole runs, the same ones for both methods.
    """

    def ratio(runs: NDArray[np.intp]) -> float:
        logs = [
            np.log(scatter(upper[runs][:, group]) / scatter(lower[runs][:, group]))
            for group in groups
        ]
        return float(np.exp(np.mean(logs)))

    count = len(upper)
    resampled = [ratio(random.integers(count, size=count)) for _ in range(_RESAMPLES)]
    return ratio(np.arange(count)), float(np.std(resampled, ddof=1))


def scatter_claims(blocks: Blocks, random: np.random.Generator) -> list[Claim]:
    """The modified algorithm scatters less (Fig. 13 to 17 against 8 to 12)."""
    found = []
    kinds = {"robust (interquartile)": robust_deviation, "standard deviation": standard_deviation}
    for switch, where in ((False, "in steady running"), (True, "in the block after a switch")):
        groups = blocks.groups(switch)
        together = [b for group in groups for b in group]
        missed = {name: 100 * failed[:, together].mean() for name, failed in blocks.failed.items()}
        for quantity in ("mu_max", "c3"):
            for kind, scatter in kinds.items():
                values = {name: x[quantity] for name, x in blocks.values.items()}

                def over(
                    upper: str,
                    lower: str,
                    values: dict[str, Numbers] = values,
                    groups: list[list[int]] = groups,
                    scatter: Callable[[Numbers], float] = scatter,
                ) -> tuple[float, float]:
                    return scatter_ratio(values[upper], values[lower], groups, scatter, random)

                ratio, error = over("ml-de-he2018", "ml-de")
                modified, modified_error = over("ml-de-he2018", "ml-exact")
                original, original_error = over("ml-de", "ml-exact")
                found.append(
                    Claim(
                        HE2018,
                        f"Exp. 3 against 2: {quantity} scatters less {where}, {kind}, "
                        "ml-de-he2018 over ml-de (below 1)",
                        float("nan"),
                        ratio,
                        error,
                        "ratio (1)",
                        report.verdict_below(ratio, error, 1.0),
                        f"Against the exact optimum the modified algorithm scatters "
                        f"{modified:.3f} ± {modified_error:.1g} times as much "
                        f"({_against_optimum(modified, modified_error)}), the unmodified one "
                        f"{original:.3f} ± {original_error:.1g} times "
                        f"({_against_optimum(original, original_error)}), and they miss it in "
                        f"{missed['ml-de-he2018']:.1f} % and {missed['ml-de']:.1f} % of the "
                        "blocks.",
                    )
                )
    return found


def _against_optimum(ratio: float, error: float) -> str:
    """What a scatter over that of the exact optimum means."""
    if ratio + report.STANDARD_ERRORS * error < 1:
        return "less than the noise of the data gives: it stops short, near its start"
    if ratio - report.STANDARD_ERRORS * error > 1:
        return "more: searches that do not arrive add to the noise"
    return "no difference is seen: the noise of the data explains it"


def tracking_claims(tables: Mapping[str, pd.DataFrame]) -> list[Claim]:
    """The modified algorithm tracks a switch faster: delay, and failures in the first block."""
    columns = {
        ("summary", "delay_blocks"): (1.0, "blocks", "mu_max is tracked sooner after a switch"),
        ("switches", "failure_share"): (
            100.0,
            "% points",
            "fewer searches miss the optimum in the block after a switch",
        ),
    }
    found = []
    for (table, column), (factor, unit, claim) in columns.items():
        rows = tables[table]
        rows = rows[(rows["quantity"] == "mu_max") & rows["delay_blocks"].notna()]
        means, errors = {}, {}
        for name, of_method in rows.groupby("identifier"):
            # The switches of a run have their own noise: independent of each other.
            means[name] = factor * of_method[column].mean()
            errors[name] = factor * np.sqrt((of_method[f"{column}_se"] ** 2).sum()) / len(of_method)
        for name, words in _VARIANTS.items():
            difference = means[name] - means["ml-de"]
            error = float(np.hypot(errors[name], errors["ml-de"]))
            found.append(
                Claim(
                    HE2018,
                    f"Exp. 3 against 2: {claim}, {name} minus ml-de (below 0)",
                    float("nan"),
                    float(difference),
                    error,
                    unit,
                    report.verdict_below(float(difference), error, 0.0),
                    f"Mean over the switches: {words} {means[name]:.3g} ± {errors[name]:.1g}, the "
                    f"unmodified algorithm {means['ml-de']:.3g} ± {errors['ml-de']:.1g}, the exact "
                    f"optimum {means['ml-exact']:.3g} ± {errors['ml-exact']:.1g} "
                    f"({unit.removesuffix(' points')}), the best that a search can do.",
                )
            )
    return found


# -------------------------------------------------------------- Eq. 17: generations to a gap


def scale_factor(
    method: DifferentialEvolutionMaximumLikelihood, innovation: Float[Array, ""]
) -> Float[Array, ""]:
    """F(k) of He et al. 2018, Eq. 17, of a method; constant where its gain is zero."""
    return method.scale_low + method.scale_gain * jax.nn.sigmoid(10 * innovation - 2)


def generations_needed(
    objective: de.Objective,
    target: Float[Array, ""],
    population: Float[Array, "p members"],
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
    key: PRNGKeyArray,
    settings: de.Settings,
) -> Int[Array, ""]:
    """Generations until the best member's objective is at most `target`.

    The search goes on to `GENERATIONS` whatever its spread; one more than that stands for
    "not within them".
    """
    seed = jax.random.bits(key, (2,), jnp.uint32)

    def generation(state: de.State, _: None) -> tuple[de.State, Float[Array, ""]]:
        state = de.update(state, objective, lower, upper, seed, settings)
        return state, jnp.min(state.objective)

    first = de.init(objective, population)
    _, rest = jax.lax.scan(generation, first, length=GENERATIONS)
    arrived = jnp.append(jnp.min(first.objective), rest) <= target
    return jnp.where(jnp.any(arrived), jnp.argmax(arrived), GENERATIONS + 1)


def _settings(scale: Float[Array, ""]) -> de.Settings:
    return de.Settings(scale, jnp.asarray(CROSSOVER), jnp.asarray(False), jnp.asarray(0.0))


def generations_of_run(
    known: Known, sigma: float, record: Record, key: PRNGKeyArray
) -> Int[Array, "blocks starts methods"]:
    """For each block from the second: random or local start (Eq. 16), without and with Eq. 17.

    theta(k-1) is the exact optimum of the block before. With and without Eq. 17 the search has
    the same data, the same initial population and the same random numbers.
    """
    sums = jax.vmap(lambda block: burckhardt_sums(known, block))(record)
    optimum = jax.vmap(variable_projection.minimise, in_axes=(0, None, None))(
        sums, known.lower, known.upper
    )
    theta = jnp.stack([optimum.a, optimum.nu, optimum.b], axis=-1)
    shares = jnp.stack([ml_de.local_share, ml_de_eq16.local_share])
    methods = jax.tree.map(lambda *x: jnp.stack(x), ml_de, ml_de_eq17)

    def one_block(
        block: Record,
        sums: variable_projection.Sums,
        previous: Float[Array, "3"],
        best: Float[Array, ""],
        key: PRNGKeyArray,
    ) -> Int[Array, "starts methods"]:
        innovation = jnp.mean(jnp.abs(residual(known, block, previous)))

        def objective(x: Float[Array, "3 members"]) -> Float[Array, " members"]:
            return variable_projection.sum_of_squares(
                sums, x[0], x[1], x[2], known.lower[1], known.upper[1]
            )

        def one_start(share: Float[Array, ""], key: PRNGKeyArray) -> Int[Array, " methods"]:
            population_key, search_key = jax.random.split(key)
            population = de.local_plus_uniform(
                population_key,
                previous,
                known.lower,
                known.upper,
                share,
                ml_de_eq16.radius,
                POPULATION,
            )
            return jax.vmap(
                lambda method: generations_needed(
                    objective,
                    best + ARRIVED_GAP * sigma**2,
                    population,
                    known.lower,
                    known.upper,
                    search_key,
                    _settings(scale_factor(method, innovation)),
                )
            )(methods)

        return jax.vmap(one_start)(shares, jax.random.split(key, len(shares)))

    record_now, sums_now = jax.tree.map(lambda x: x[1:], (record, sums))
    keys = jax.random.split(key, len(theta) - 1)
    return jax.vmap(one_block)(record_now, sums_now, theta[:-1], optimum.objective[1:], keys)


def count_generations(scenario: Scenario, seed: int, runs: int, progress: Report) -> Numbers:
    """[runs, blocks, starts, methods] of `generations_of_run`; infinite where not arrived."""

    @jax.jit
    def tile(noise: PRNGKeyArray, solver: PRNGKeyArray) -> Int[Array, "runs blocks 2 2"]:
        records = jax.vmap(scenario.draw, out_axes=scenario.run_axes)(noise)
        one_run = partial(generations_of_run, scenario.known, scenario.sigma)
        return jax.vmap(one_run, in_axes=(scenario.run_axes, 0))(records, solver)

    parts = []
    for number in range(_tiles(runs)):
        chosen = jnp.asarray(tile_runs(number))
        noise = noise_keys(seed, "claims-generations", chosen)
        solver = solver_keys(seed, "claims-generations", "ml-de", chosen)
        parts.append(np.asarray(tile(noise, solver)))
        progress("generations")
    needed = np.concatenate(parts)[:runs].astype(float)
    return np.where(needed > GENERATIONS, np.inf, needed)


def median_with_error(x: Numbers, random: np.random.Generator) -> tuple[float, float]:
    """The median over all entries of [runs, ...]; its error by a bootstrap over runs."""
    runs = len(x)
    medians = [float(np.median(x[random.integers(runs, size=runs)])) for _ in range(_RESAMPLES)]
    return float(np.median(x)), _spread(medians)


def _spread(resampled: list[float]) -> float:
    return float(np.std(resampled, ddof=1)) if np.isfinite(resampled).all() else float("nan")


def median_ratio(
    upper: Numbers, lower: Numbers, random: np.random.Generator
) -> tuple[float, float]:
    """Median over median, paired; its error by a bootstrap over runs.

    Infinite where only the upper one is, which no resampling need confirm.
    """
    runs = len(upper)
    ratio = float(np.median(upper)) / float(np.median(lower))
    if np.isinf(ratio):
        return ratio, 0.0
    resampled = []
    for _ in range(_RESAMPLES):
        chosen = random.integers(runs, size=runs)
        resampled.append(float(np.median(upper[chosen]) / np.median(lower[chosen])))
    return ratio, _spread(resampled)


Panels = dict[tuple[str, str], dict[str, Numbers]]


def generation_panels(needed: Numbers, rails: tuple[str, ...]) -> Panels:
    """Generations [runs, blocks] by start, by steady running or switch, and by method."""
    begins = np.array([rails[b] != rails[b - 1] for b in range(1, len(rails))])
    return {
        (start, where): {
            "without Eq. 17": needed[:, chosen, i, 0],
            "with Eq. 17": needed[:, chosen, i, 1],
        }
        for i, start in enumerate(("random start", "local start (Eq. 16)"))
        for chosen, where in ((~begins, "steady running"), (begins, "after a switch"))
    }


def generation_claims(panels: Panels, random: np.random.Generator) -> list[Claim]:
    """Eq. 17 speeds the search: median generations, and searches that never arrive."""
    found = []
    for (start, where), methods in panels.items():
        plain, scheduled = methods["without Eq. 17"], methods["with Eq. 17"]
        medians = [median_with_error(x, random) for x in (scheduled, plain)]
        never = [100 * np.isinf(x) for x in (scheduled, plain)]
        ratio, error = median_ratio(scheduled, plain, random)
        words = [f"{value:.4g} ± {se:.1g}" for value, se in medians]
        found.append(
            Claim(
                HE2018,
                f"Eq. 17 speeds convergence: median generations with over without, {start}, "
                f"{where} (below 1)",
                float("nan"),
                ratio,
                error,
                "ratio (1)",
                report.verdict_below(ratio, error, 1.0),
                f"Generations to {ARRIVED_GAP:g} sigma^2 above the optimum: medians {words[0]} "
                f"with and {words[1]} without Eq. 17, where a search that does not arrive in "
                f"{GENERATIONS} counts as longer than all others "
                f"({never[0].mean():.1f} % with, {never[1].mean():.1f} % without).",
            )
        )
        difference = (never[0] - never[1]).mean(axis=1)
        more, more_error = _mean_with_error(difference)
        found.append(
            Claim(
                HE2018,
                f"Eq. 17 raises accuracy: searches short of the optimum after {GENERATIONS} "
                f"generations, with minus without, {start}, {where} (below 0)",
                float("nan"),
                more,
                more_error,
                "% points",
                report.verdict_below(more, more_error, 0.0),
                f"More than {ARRIVED_GAP:g} sigma^2 above it remain {never[0].mean():.2f} % with "
                f"and {never[1].mean():.2f} % without Eq. 17, on the same data from the same "
                "initial populations.",
            )
        )
    return found


def _tiles(runs: int) -> int:
    return -(-runs // TILE)


def _mean_with_error(x: Numbers) -> tuple[float, float]:
    return float(x.mean()), float(x.std(ddof=1) / np.sqrt(len(x)))


# --------------------------------------------------------------------- Eq. 15: consistency


def sized_blocks(sizes: tuple[int, ...], slip_max: float) -> tuple[Numbers, NDArray[np.bool_]]:
    """Slip and mask of a block of each size, all as long as the largest: [sizes, points].

    One shape for all sizes, because the solver takes longer to compile than to run.
    """
    slip, mask = np.zeros((2, len(sizes), max(sizes)))
    for i, points in enumerate(sizes):
        slip[i, :points] = np.linspace(0.0, slip_max, points)
        mask[i, :points] = 1
    return slip, mask.astype(bool)


def consistency_table(
    scenario: Scenario,
    seed: int,
    runs: int,
    progress: Report,
    sizes: tuple[int, ...] = SIZES,
    slip_max: float = 0.2,
) -> pd.DataFrame:
    """RMSE, its error and the bound of the exact optimum on blocks of different sizes.

    The noise of the sizes is independent, and so are their errors. One row a size and quantity.
    """
    slip, mask = map(jnp.asarray, sized_blocks(sizes, slip_max))
    curve, known, sigma = scenario.truth[0], scenario.known, scenario.sigma
    clean = curve(slip, {})

    @jax.jit
    def tile(noise: PRNGKeyArray) -> Float[Array, "runs sizes values"]:
        def one_run(key: PRNGKeyArray) -> Float[Array, "sizes values"]:
            adhesion = clean + draw_noise(key, clean.shape, sigma, 0.0)
            estimate = identify(
                IDENTIFIERS["ml-exact"], known, Record(slip, adhesion, mask, {}), key
            )
            return jnp.stack(list(estimate.values.values()), axis=-1)

        return jax.vmap(one_run)(noise)

    parts = []
    for number in range(_tiles(runs)):
        keys = noise_keys(seed, "claims-consistency", jnp.asarray(tile_runs(number)))
        parts.append(np.asarray(tile(keys)))
        progress("consistency")
    estimates = np.concatenate(parts)[:runs]
    truth = np.asarray(quantities(curve))
    free = estimates[..., : len(known.curve.free)]
    on_box = np.asarray(on_bound(jnp.asarray(free), known.lower, known.upper)).any(axis=-1)
    moments = Moments.of(
        {"squared_error": (estimates - truth) ** 2, "on_box": on_box.astype(float)}
    )
    rmse = np.sqrt(moments.mean("squared_error"))
    bounds = jax.vmap(lambda slip, mask: cramer_rao_bound(curve, slip, mask, {}, sigma))
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


def consistency_fits(table: pd.DataFrame) -> dict[str, report.Fit]:
    return {
        quantity: report.power_law(
            *(rows[column].to_numpy(dtype=float) for column in ("points", "rmse", "rmse_se"))
        )
        for quantity in CONVERGED_BY
        for rows in [table[table["quantity"] == quantity]]
    }


def consistency_claims(table: pd.DataFrame) -> list[Claim]:
    """The estimate converges to the truth (Eq. 15); its RMSE then falls as n^(-1/2)."""
    found = []
    for quantity, fit in consistency_fits(table).items():
        rows = table[table["quantity"] == quantity]
        ends = rows.iloc[[0, -1]]
        share = 100 * (ends["rmse"] / ends["truth"]).to_numpy()
        found.append(
            Claim(
                HE2018,
                f"Eq. 15, consistency: slope of log RMSE of {quantity} over log points, "
                "exact optimum (-1/2 by asymptotic theory)",
                -0.5,
                fit.slope,
                fit.slope_error,
                "1",
                report.verdict_equal(fit.slope, fit.slope_error, -0.5),
                f"RMSE falls from {share[0]:.3g} to {share[1]:.3g} % of the truth from "
                f"{ends['points'].iloc[0]} to {ends['points'].iloc[1]} points, "
                f"{(ends['rmse'] / ends['crlb']).iloc[0]:.3f} and "
                f"{(ends['rmse'] / ends['crlb']).iloc[1]:.3f} times the Cramér-Rao bound; at most "
                f"{100 * rows['at_bound_share'].max():.1f} % of the runs touch the box.",
            )
        )
    return found


# ------------------------------------------------------------------------------ the command


def configs(runs: int, seed: int) -> tuple[Config, Config]:
    """Experiment 1; Experiments 2 and 3 with the ablations."""
    return (
        Config("he2018-1", ("ml-exact", "ml-de"), Options(), runs, seed),
        Config("he2018-blocks", ("ml-exact", "ml-de", *_VARIANTS), Options(), runs, seed),
    )


@click.command()
@click.option("--runs", type=click.IntRange(min=2), default=512, show_default=True)
@click.option("--seed", type=click.IntRange(min=0, max=2**32 - 1), default=0, show_default=True)
@click.option("--out", type=click.Path(path_type=Path), default=Path("results"), show_default=True)
def main(runs: int, seed: int, out: Path) -> None:
    """Compute what the papers claim and say which claims are reproduced."""
    directory = output_directory(out)
    began = time.perf_counter()
    random = np.random.default_rng(seed)
    experiment_1, experiment_2 = configs(runs, seed)
    pairs = build_scenario(Config("he2018-blocks", options=Options(blocks=6)))
    steps = sum(map(progress_steps, (experiment_1, experiment_2))) + 2 * _tiles(runs)
    with staged(directory) as stage:
        with tqdm(total=steps, unit="tile") as bar:

            def stage_of(words: str) -> Report:
                bar.set_description(words)

                def advance(_: str) -> None:
                    bar.update()

                return advance

            found = convergence_claims(experiment_1, stage_of("convergence"))
            rows: list[pd.DataFrame] = []
            campaign = run_campaign(experiment_2, rows.append, stage_of("scatter"))
            blocks = as_blocks(pd.concat(rows, ignore_index=True), build_scenario(experiment_2))
            found += scatter_claims(blocks, random)
            found += tracking_claims(campaign.tables)
            needed = count_generations(pairs, seed, runs, stage_of("generations"))
            panels = generation_panels(needed, pairs.rails)
            found += generation_claims(panels, random)
            single = build_scenario(Config("single"))
            sized = consistency_table(single, seed, runs, stage_of("consistency"))
            found += consistency_claims(sized)
        table = report.claims_table(found)
        write_table(stage / "claims.csv", table)
        report.generations(
            stage / "claims_generations.png",
            panels,
            GENERATIONS,
            f"within {ARRIVED_GAP:g} σ² of the optimum",
        )
        report.consistency(stage / "claims_consistency.png", sized, consistency_fits(sized))
    click.echo(report.claims_text(table))
    click.echo(f"\nwritten to {directory} in {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    run(main)
