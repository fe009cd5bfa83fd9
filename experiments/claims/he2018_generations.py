"""Eq. 17 of He et al. 2018: the generations until a search arrives at the optimum."""

from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray

from adhesion_jax.campaign.keys import noise_keys, solver_keys
from adhesion_jax.curves import Scalar
from adhesion_jax.identifiers.curve_fit import residual
from adhesion_jax.identifiers.ml_de import (
    CROSSOVER,
    GENERATIONS,
    POPULATION,
    ml_de,
    ml_de_eq16,
    ml_de_eq17,
)
from adhesion_jax.identifiers.ml_exact import burckhardt_sums
from adhesion_jax.optim import differential_evolution as de
from adhesion_jax.optim import variable_projection
from adhesion_jax.records import Known, Record
from adhesion_jax.scenarios import Scenario
from adhesion_jax.wording import plus_minus
from experiments.claims.claim import Claim, Numbers, values
from experiments.claims.he2018 import PAPER, over_runs
from experiments.claims.he2018_blocks import resamples, spread

#: Generations [runs, blocks] by (start, steady running or switch), then by method.
Panels = dict[tuple[str, str], dict[str, Numbers]]

#: A search has arrived where the excess is at most this many sigma^2.
ARRIVED_GAP = 1e-2


def generations_needed(
    objective: de.Objective,
    target: Float[Array, ""],
    population: Float[Array, "p members"],
    lower: Float[Array, " p"],
    upper: Float[Array, " p"],
    key: PRNGKeyArray,
    scale: Float[Array, ""],
) -> Int[Array, ""]:
    """Generations until the best member's objective is at most `target`.

    The search goes on whatever its spread; one more than `GENERATIONS` stands for "not within
    them".
    """
    settings = de.Settings(scale, CROSSOVER, reflect=False, tolerance=-1.0, target=target)
    found = de.minimise(objective, population, lower, upper, key, settings, GENERATIONS)
    return jnp.where(found.objective <= target, found.generations, GENERATIONS + 1)


def generations_of_run(
    known: Known,
    sigma: float,
    record: Record,
    key: PRNGKeyArray,
    plain: Scalar = ml_de.scale_low,
    radius: Scalar = ml_de_eq16.radius,
) -> Int[Array, "blocks starts methods"]:
    """For each block from the second: random or local start (Eq. 16), and with each scale factor:
    the constant one, that of Eq. 17 by the innovation of the block, by that of its last sample.

    theta(k-1) is the exact optimum of the block before. All searches of a start have the same
    data, the same initial population and the same random numbers.
    """
    sums = jax.vmap(lambda block: burckhardt_sums(known, block))(record)
    optimum = jax.vmap(variable_projection.minimise, in_axes=(0, None, None))(
        sums, known.lower, known.upper
    )
    theta = jnp.stack([optimum.a, optimum.nu, optimum.b], axis=-1)
    shares = jnp.stack([ml_de.local_share, ml_de_eq16.local_share])

    def one_block(
        block: Record,
        sums: variable_projection.Sums,
        previous: Float[Array, "3"],
        best: Float[Array, ""],
        key: PRNGKeyArray,
    ) -> Int[Array, "starts methods"]:
        innovation = jnp.abs(residual(known, block, previous))
        scales = jnp.stack(
            [
                jnp.asarray(plain),
                *map(ml_de_eq17.scale_factor, (jnp.mean(innovation), innovation[-1])),
            ]
        )

        def objective(x: Float[Array, "3"]) -> Float[Array, ""]:
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
                jnp.asarray(radius),
                ml_de_eq16.reflect,
                POPULATION,
            )
            return jax.vmap(
                lambda scale: generations_needed(
                    objective,
                    best + ARRIVED_GAP * sigma**2,
                    population,
                    known.lower,
                    known.upper,
                    search_key,
                    scale,
                )
            )(scales)

        return jax.vmap(one_start)(shares, jax.random.split(key, len(shares)))

    record_now, sums_now = jax.tree.map(lambda x: x[1:], (record, sums))
    keys = jax.random.split(key, len(theta) - 1)
    return jax.vmap(one_block)(record_now, sums_now, theta[:-1], optimum.objective[1:], keys)


def count_generations(
    scenario: Scenario, seed: int, runs: int, progress: Callable[[str], None]
) -> Numbers:
    """[runs, blocks, starts, methods] of `generations_of_run`; infinite where not arrived."""

    @jax.jit
    def tile(
        known: Known, noise: Key[Array, " runs"], solver: Key[Array, " runs"]
    ) -> Int[Array, "runs blocks 2 3"]:
        records = jax.vmap(scenario.draw, out_axes=scenario.run_axes)(noise)
        one_run = partial(generations_of_run, known, scenario.noise.sigma)
        return jax.vmap(one_run, in_axes=(scenario.run_axes, 0))(records, solver)

    def of_tile(chosen: Int[Array, " runs"]) -> Int[Array, "runs blocks 2 3"]:
        noise = noise_keys(seed, "claims-generations", chosen)
        solver = solver_keys(seed, "claims-generations", "ml-de", chosen)
        return tile(scenario.known, noise, solver)

    needed = over_runs(runs, of_tile, partial(progress, "generations")).astype(float)
    return np.where(needed > GENERATIONS, np.inf, needed)


def median_with_error(x: Numbers, random: np.random.Generator) -> tuple[float, float]:
    """The median over all entries of [runs, ...]; its error by a bootstrap over runs."""
    medians = [float(np.median(x[chosen])) for chosen in resamples(len(x), random)]
    return float(np.median(x)), spread(medians)


def median_ratio(
    upper: Numbers, lower: Numbers, random: np.random.Generator
) -> tuple[float, float]:
    """Median over median, paired; its error by a bootstrap over runs.

    Infinite where only the upper one is, which no resampling need confirm.
    """
    ratio = float(np.median(upper)) / float(np.median(lower))
    if np.isinf(ratio):
        return ratio, 0.0
    resampled = [
        float(np.median(upper[chosen]) / np.median(lower[chosen]))
        for chosen in resamples(len(upper), random)
    ]
    return ratio, spread(resampled)


def generation_panels(needed: Numbers, rails: tuple[str, ...]) -> Panels:
    """Generations [runs, blocks] by start, by steady running or switch, and by method."""
    begins = np.array([rails[b] != rails[b - 1] for b in range(1, len(rails))])
    return {
        (start, where): {
            name: needed[..., chosen, i, method]
            for method, name in enumerate(("without Eq. 17", "with Eq. 17", "of one sample"))
        }
        for i, start in enumerate(("random start", "local start (Eq. 16)"))
        for chosen, where in ((~begins, "steady running"), (begins, "after a switch"))
    }


def generation_claims(panels: Panels, random: np.random.Generator) -> list[Claim]:
    """Eq. 17 speeds the search: median generations, and searches that never arrive."""
    found = []
    for (start, where), methods in panels.items():
        pair = [methods[name] for name in ("with Eq. 17", "without Eq. 17")]
        medians = [plus_minus(*median_with_error(x, random)) for x in pair]
        never = [100 * np.isinf(x) for x in pair]
        ratio, error = median_ratio(pair[0], pair[1], random)
        more = (never[0] - never[1]).mean(axis=1)
        more_error = float(more.std(ddof=1) / np.sqrt(len(more)))
        facts = {"start": start, "where": where, "gap": ARRIVED_GAP, "most": GENERATIONS}
        facts |= {"medians": medians, "never": [x.mean() for x in never]}
        found.append(PAPER.below("eq17_speed", ratio, error, len(more), **facts))
        lost = (float(more.mean()), more_error, len(more))
        found.append(PAPER.below("eq17_accuracy", *lost, **facts))
    return found


def innovation_claims(panels: Panels, random: np.random.Generator) -> list[Claim]:
    """The innovation of the block in Eq. 17, against that of its last sample (section 5)."""
    found = []
    for where in ("steady running", "after a switch"):
        panel = panels["local start (Eq. 16)", where]
        pair = [panel[name] for name in ("with Eq. 17", "of one sample")]
        ratio, error = median_ratio(pair[0], pair[1], random)
        facts = {"where": where, "never": [100 * np.isinf(x).mean() for x in pair]}
        runs = len(pair[0])
        found.append(PAPER.below("innovation", ratio, error, runs, most=GENERATIONS, **facts))
    return found


#: Runs of a setting, of five blocks each.
_RUNS = 8


def setting_claims(scenario: Scenario, seed: int, progress: Callable[[str], None]) -> list[Claim]:
    """The panels at settings of what is not printed, each with the same runs."""
    settings = PAPER.settings()
    noise = noise_keys(seed, "claims-generations", jnp.arange(_RUNS))
    solver = solver_keys(seed, "claims-generations", "ml-de", jnp.arange(_RUNS))
    plain, radius = (jnp.asarray(values(settings, name)) for name in ("plain", "radius"))

    @jax.jit
    def of_settings_drawn(known: Known) -> Int[Array, "settings runs blocks 2 3"]:
        records = jax.vmap(scenario.draw, out_axes=scenario.run_axes)(noise)
        one = partial(generations_of_run, known, scenario.noise.sigma)
        of_runs = jax.vmap(one, in_axes=(scenario.run_axes, 0, None, None))
        return jax.vmap(of_runs, in_axes=(None, None, 0, 0))(records, solver, plain, radius)

    needed = np.asarray(of_settings_drawn(scenario.known)).astype(float)
    progress("generations, settings")
    needed = np.where(needed > GENERATIONS, np.inf, needed)
    found = []
    for (start, where), methods in generation_panels(needed, scenario.rails).items():
        pair = [methods[name] for name in ("with Eq. 17", "without Eq. 17")]
        medians = [np.median(x, axis=(1, 2)) for x in pair]
        never = [100 * np.isinf(x).mean(axis=(1, 2)) for x in pair]
        ratio = medians[0] / np.where(np.isinf(medians[1]), np.nan, medians[1])
        facts = {"start": start, "where": where, "runs": _RUNS}
        for key, ours, (scheduled, constant) in (
            ("settings_speed", ratio, medians),
            ("settings_accuracy", never[0] - never[1], never),
        ):
            found.append(PAPER.over_settings(key, ours, scheduled < constant, **facts))
    return found
