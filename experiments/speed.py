"""Identifications per CPU-second of one core for every identifier, beside scipy in the same run."""

import time
from pathlib import Path

import click
import numpy as np
import pandas as pd
from scipy.optimize import differential_evolution
from tqdm import tqdm

from adhesion_jax.campaign.config import Config, build_scenario
from adhesion_jax.campaign.store import staged, write_table
from adhesion_jax.campaign.tiles import TILE, draw_tile, identify_tile
from adhesion_jax.identifiers import IDENTIFIERS
from adhesion_jax.identifiers.ml_de import CROSSOVER, GENERATIONS, POPULATION
from adhesion_jax.report.figures import speed_bars
from experiments.command import output_directory, run

#: The peer: scipy's vectorised differential evolution at the settings of `ml-de`, all generations.
PEER = "scipy-de"


@click.command()
@click.option("--repeats", type=click.IntRange(min=1), default=3, show_default=True)
@click.option("--seed", type=click.IntRange(min=0, max=2**32 - 1), default=0, show_default=True)
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("out/speed"), show_default=True
)
def main(repeats: int, seed: int, out: Path) -> None:
    """Time every identifier on the blocks of he2018-blocks; noise and compilation are excluded.

    The methods take turns, `repeats` times, so that a machine whose speed drifts is fair to all;
    the median is reported.
    """
    directory = output_directory(out)
    config = Config(seed=seed)
    blocks = len(build_scenario(config).rails)
    rates: dict[str, list[float]] = {name: [] for name in (PEER, *IDENTIFIERS)}
    compile_seconds = dict.fromkeys(rates, 0.0)
    with tqdm(total=(repeats + 1) * len(rates), unit="method") as bar:
        for turn in range(repeats + 1):
            for name in rates:
                bar.set_description(name)
                if name == PEER:
                    rate = _peer_rate(config, turn)
                else:
                    result = identify_tile(config, turn, name, IDENTIFIERS[name])
                    rate = TILE * blocks / result.seconds
                    compile_seconds[name] += result.compile_seconds
                if turn > 0:  # the first turn compiles and warms up
                    rates[name].append(rate)
                bar.update()
    median = {name: float(np.median(values)) for name, values in rates.items()}
    table = pd.DataFrame(
        {
            "identifier": list(rates),
            "identifications_per_cpu_second": list(median.values()),
            "lowest": [min(values) for values in rates.values()],
            "highest": [max(values) for values in rates.values()],
            "ratio_to_scipy_de": [value / median[PEER] for value in median.values()],
            "compile_seconds": list(compile_seconds.values()),
        }
    )
    with staged(directory, ("speed.csv", "speed.png")) as stage:
        write_table(stage / "speed.csv", table)
        speed_bars(stage / "speed.png", table)
    click.echo(table.to_string(index=False, float_format=lambda x: f"{x:,.4g}"))
    click.echo(f"\nwritten to {directory}")


def _peer_rate(config: Config, turn: int) -> float:
    """Rate of scipy on the first block of every rail of one run of the tile."""
    scenario = build_scenario(config)
    records = draw_tile(config, turn)
    slip = np.asarray(records.slip[0])[:, None]
    lower, upper = np.asarray(scenario.known.lower), np.asarray(scenario.known.upper)
    first_blocks = [group.blocks[0] for group in scenario.tables()["summary"]]
    random = np.random.default_rng(turn)
    seconds = 0.0
    for block in first_blocks:
        adhesion = np.asarray(records.adhesion[0, block])[:, None]

        def objective(x: np.ndarray, adhesion: np.ndarray = adhesion) -> np.ndarray:
            model = x[0] * (1 - np.exp(-x[1] * slip)) - x[2] * slip
            return np.sum((model - adhesion) ** 2, axis=0)

        population = random.uniform(lower, upper, (POPULATION, lower.size))
        began = time.process_time()
        differential_evolution(
            objective,
            list(zip(lower, upper, strict=True)),
            strategy="rand1bin",
            init=population,
            mutation=0.5,
            recombination=CROSSOVER,
            maxiter=GENERATIONS,
            tol=0,
            polish=False,
            updating="deferred",
            vectorized=True,
            rng=random,
        )
        seconds += time.process_time() - began
    return len(first_blocks) / seconds


if __name__ == "__main__":
    run(main)
