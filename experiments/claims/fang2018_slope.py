"""Fang et al. 2018: the slope of the adhesion curve by recursive least squares."""

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.campaign.job import Config, build_scenario
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.identifiers.online import OnlineState
from adhesion_jax.identifiers.rls_slope import RecursiveSlope
from adhesion_jax.records import Record
from adhesion_jax.scenarios import Options, Scenario
from adhesion_jax.scenarios.noise import Noise
from experiments.claims.claim import Claim, Numbers, Setting, of_settings, read_paper, values

PAPER = read_paper("fang2018_slope")

#: "Good agreement" of two lines in a figure, read as this share of the largest slope, in per cent.
_AGREEMENT = 5.0

#: The steep part of the rise: where the slope is above this share of its largest value.
_STEEP = 0.3

#: Runs of a setting. A setting has hundreds of moments, so that few runs tell its RMSE.
_RUNS = 16


def slope_claims(runs: int, seed: int, progress: Callable[[str], None]) -> Iterator[Claim]:
    """The slope follows the true one, on the steep rise and around the peak (Fig. 10)."""
    config = Config("fang2018-slope", ("rls-slope",), Options(), runs, seed)
    table = run_campaign(config, lambda _: None, progress).tables["checkpoints"]
    scenario = build_scenario(config)
    squares = _squares(scenario, PAPER.settings(), jax.random.key(seed))
    truth, largest = np.abs(scenario.quantities()["slope"]), table["truth"].abs().max()
    steep, steep_moments = table["truth"] > _STEEP * largest, truth > _STEEP * largest
    for words, rows, moments in (
        ("around and behind the peak", table[~steep], ~steep_moments),
        ("on the rise", table[steep], steep_moments),
    ):
        rmse = np.sqrt(float((rows["rmse"] ** 2).mean()))
        # The checkpoints of a run are far apart in time, and nearly independent.
        error = np.sqrt(np.sum((rows["rmse"] * rows["rmse_se"]) ** 2)) / (len(rows) * rmse)
        others = 100 * np.sqrt(squares[1:, moments].mean(axis=1)) / largest
        facts = {"words": words, "agreement": _AGREEMENT, "moments": len(rows)}
        facts |= {"bias": 100 * rows["bias"].abs().max() / largest}
        facts |= {"best": others.min(), "median": np.median(others)}
        ours, its_error = (float(100 * one / largest) for one in (rmse, error))
        yield PAPER.judged("slope", ours, of_settings(others < _AGREEMENT), its_error, **facts)


def _squares(scenario: Scenario, settings: Sequence[Setting], key: PRNGKeyArray) -> Numbers:
    """Mean square errors over runs, [settings, blocks]; every setting has the same runs."""
    keys = jax.random.split(key, _RUNS)
    quiet, given = dataclasses.replace(scenario, noise=Noise(0.0)), scenario.noise.sigma
    truth = jnp.asarray(scenario.quantities()["slope"])

    @partial(jax.vmap, in_axes=(0, None))
    @partial(jax.vmap, in_axes=(None, 0))
    def error(setting: dict[str, Array], key: PRNGKeyArray) -> Float[Array, " blocks"]:
        clean, record = quiet.draw(key), scenario.draw(key)
        noise = setting["sigma"] / given * (record.adhesion - clean.adhesion)
        record = record._replace(adhesion=clean.adhesion + noise)
        method = RecursiveSlope(setting["gamma"], setting["time_constant"])

        def after(state: OnlineState, block: Record) -> tuple[OnlineState, Float[Array, ""]]:
            state = method.update(state, block)
            return state, state.recursion.theta

        _, found = jax.lax.scan(after, method.init(scenario.known, key), record)
        return (found - truth) ** 2

    numbers = {name: jnp.asarray(values(settings, name)) for name in PAPER.ranges}
    return np.asarray(jax.jit(error)(numbers, keys)).mean(axis=1)
