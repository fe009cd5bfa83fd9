"""Fang et al. 2018: the slope of the adhesion curve by recursive least squares."""

import dataclasses
from collections.abc import Callable, Sequence
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


def slope_config(runs: int, seed: int) -> Config:
    return Config("fang2018-slope", ("rls-slope",), Options(), runs, seed)


def slope_claims(config: Config, progress: Callable[[str], None]) -> list[Claim]:
    """The slope follows the true one, on the steep rise and around the peak (Fig. 10)."""
    table = run_campaign(config, lambda _: None, progress).tables["checkpoints"]
    scenario = build_scenario(config)
    settings = PAPER.settings()
    squares = _squares(scenario, settings, jax.random.key(config.seed))
    truth = np.abs(scenario.quantities()["slope"])
    largest = table["truth"].abs().max()
    steep = table["truth"] > _STEEP * largest
    found = []
    for words, rows, moments in (
        ("around and behind the peak", table[~steep], truth <= _STEEP * largest),
        ("on the rise", table[steep], truth > _STEEP * largest),
    ):
        mean_square = float((rows["rmse"] ** 2).mean())
        rmse = np.sqrt(mean_square)
        # The checkpoints of a run are far apart in time, and nearly independent.
        error = np.sqrt(np.sum((rows["rmse"] * rows["rmse_se"]) ** 2)) / (len(rows) * rmse)
        bias = 100 * rows["bias"].abs().max() / largest
        drawn_rmse = 100 * np.sqrt(squares[:, moments].mean(axis=1)) / largest
        found.append(
            PAPER.judged(
                "slope",
                float(100 * rmse / largest),
                of_settings(drawn_rmse[1:] < _AGREEMENT),
                float(100 * error / largest),
                words=words,
                agreement=_AGREEMENT,
                moments=len(rows),
                bias=bias,
                best=drawn_rmse[1:].min(),
                median=np.median(drawn_rmse[1:]),
            )
        )
    return found


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
