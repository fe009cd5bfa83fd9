"""Eq. 17 of He et al. 2018: the generations until a search arrives at the optimum."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray
from numpy.typing import NDArray

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
from experiments.claims.he2018_blocks import with_error

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
        scheduled = map(ml_de_eq17.scale_factor, (jnp.mean(innovation), innovation[-1]))
        scales = jnp.stack([jnp.asarray(plain), *scheduled])

        def objective(x: Float[Array, "3"]) -> Float[Array, ""]:
            return variable_projection.sum_of_squares(
                sums, x[0], x[1], x[2], known.lower[1], known.upper[1]
            )

        def one_start(share: Float[Array, ""], key: PRNGKeyArray) -> Int[Array, " methods"]:
            population_key, search_key = jax.random.split(key)
            box, near = (known.lower, known.upper), jnp.asarray(radius)
            population = de.local_plus_uniform(
                population_key, previous, *box, share, near, ml_de_eq16.reflect, POPULATION
            )
            goal = best + ARRIVED_GAP * sigma**2
            needed = partial(generations_needed, objective, goal, population, *box, search_key)
            return jax.vmap(needed)(scales)

        return jax.vmap(one_start)(shares, jax.random.split(key, len(shares)))

    record_now, sums_now = jax.tree.map(lambda x: x[1:], (record, sums))
    keys = jax.random.split(key, len(theta) - 1)
    return jax.vmap(one_block)(record_now, sums_now, theta[:-1], optimum.objective[1:], keys)


def _drawn(
    scenario: Scenario,
    known: Known,
    keys: tuple[Key[Array, " runs"], Key[Array, " runs"]],
    *of: Any,
) -> Int[Array, "runs blocks 2 3"]:
    """`generations_of_run` of runs by the keys of their noise and their searches, at a setting."""
    records = jax.vmap(scenario.draw, out_axes=scenario.run_axes)(keys[0])
    one_run = partial(generations_of_run, known, scenario.noise.sigma)
    over = (scenario.run_axes, 0, *(None for _ in of))
    return jax.vmap(one_run, in_axes=over)(records, keys[1], *of)


def _keys(
    seed: int, chosen: Int[Array, " runs"]
) -> tuple[Key[Array, " runs"], Key[Array, " runs"]]:
    name = "claims-generations"
    return noise_keys(seed, name, chosen), solver_keys(seed, name, "ml-de", chosen)


def _or_never(needed: np.ndarray) -> Numbers:
    """Infinite where the search has not arrived."""
    return np.where(needed > GENERATIONS, np.inf, needed.astype(float))


def count_generations(
    scenario: Scenario, seed: int, runs: int, progress: Callable[[str], None]
) -> Numbers:
    """[runs, blocks, starts, methods] of `generations_of_run`; infinite where not arrived."""
    tile = jax.jit(partial(_drawn, scenario))

    def of_tile(chosen: Int[Array, " runs"]) -> Int[Array, "runs blocks 2 3"]:
        return tile(scenario.known, _keys(seed, chosen))

    return _or_never(over_runs(runs, of_tile, partial(progress, "generations")))


def median_with_error(x: Numbers, random: np.random.Generator) -> tuple[float, float]:
    """The median over all entries of [runs, ...]; its error by a bootstrap over runs."""
    return with_error(lambda runs: float(np.median(x[runs])), len(x), random)


def median_ratio(
    upper: Numbers, lower: Numbers, random: np.random.Generator
) -> tuple[float, float]:
    """Median over median, paired; its error by a bootstrap over runs.

    Infinite where only the upper one is, which no resampling need confirm.
    """

    def ratio(runs: NDArray[np.intp]) -> float:
        return float(np.median(upper[runs])) / float(np.median(lower[runs]))

    whole = ratio(np.arange(len(upper)))
    return (whole, 0.0) if np.isinf(whole) else with_error(ratio, len(upper), random)


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


def generation_claims(panels: Panels, random: np.random.Generator) -> Iterator[Claim]:
    """Eq. 17 speeds the search: median generations, and searches that never arrive."""
    for (start, where), methods in panels.items():
        pair = [methods[name] for name in ("with Eq. 17", "without Eq. 17")]
        medians = [plus_minus(*median_with_error(x, random)) for x in pair]
        never = [100 * np.isinf(x) for x in pair]
        ratio, error = median_ratio(pair[0], pair[1], random)
        more = (never[0] - never[1]).mean(axis=1)
        more_error = float(more.std(ddof=1) / np.sqrt(len(more)))
        facts = {"start": start, "where": where, "gap": ARRIVED_GAP, "most": GENERATIONS}
        facts |= {"medians": medians, "never": [x.mean() for x in never]}
        yield PAPER.below("eq17_speed", ratio, error, len(more), **facts)
        yield PAPER.below("eq17_accuracy", float(more.mean()), more_error, len(more), **facts)


def innovation_claims(panels: Panels, random: np.random.Generator) -> Iterator[Claim]:
    """The innovation of the block in Eq. 17, against that of its last sample (section 5)."""
    for where in ("steady running", "after a switch"):
        panel = panels["local start (Eq. 16)", where]
        pair = [panel[name] for name in ("with Eq. 17", "of one sample")]
        never = [100 * np.isinf(x).mean() for x in pair]
        facts = {"where": where, "never": never, "most": GENERATIONS}
        yield PAPER.below(
            "innovation", *median_ratio(pair[0], pair[1], random), len(pair[0]), **facts
        )


#: Runs of a setting, of five blocks each.
_RUNS = 8


def setting_claims(
    scenario: Scenario, seed: int, progress: Callable[[str], None]
) -> Iterator[Claim]:
    """The panels at settings of what is not printed, each with the same runs."""
    settings, keys = PAPER.settings(), _keys(seed, jnp.arange(_RUNS))
    numbers = (jnp.asarray(values(settings, name)) for name in ("plain", "radius"))
    over = jax.jit(jax.vmap(partial(_drawn, scenario), in_axes=(None, None, 0, 0)))
    needed = _or_never(np.asarray(over(scenario.known, keys, *numbers)))
    progress("generations, settings")
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
            yield PAPER.over_settings(key, ours, scheduled < constant, **facts)
