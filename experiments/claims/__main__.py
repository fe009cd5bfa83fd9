"""Hold the claims of published papers against what can be computed: claims.csv and its figures."""

import time
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np
import pandas as pd
from tqdm import tqdm

from adhesion_jax.campaign.config import Config, build_scenario
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.command_line.command import SEED, Folder, run, start
from adhesion_jax.files import output_directory, staged, write_table
from adhesion_jax.identifiers.ml_de import GENERATIONS
from adhesion_jax.scenarios import Options
from experiments.claims import report
from experiments.claims.fang2018 import slope_claims, slope_config
from experiments.claims.fang2018_control import control_claims
from experiments.claims.he2018_consistency import (
    consistency_claims,
    consistency_fits,
    consistency_table,
)
from experiments.claims.he2018_convergence import convergence_claims
from experiments.claims.he2018_generations import (
    ARRIVED_GAP,
    count_generations,
    generation_claims,
    generation_panels,
)
from experiments.claims.he2018_tracking import (
    VARIANTS,
    as_blocks,
    scatter_claims,
    tracking_claims,
)
from experiments.claims.hxd1f import hxd1f_claims
from experiments.claims.qian2024 import (
    FACTORS,
    factorial_claims,
    factorial_table,
    reading_claims,
    reading_config,
)
from experiments.claims.uyulan2018 import uyulan_claims

#: The claims on traction control.
CONTROL = {
    "Uyulan 2018": uyulan_claims,
    "Fang 2018, control": control_claims,
    "HXD1F 2019": hxd1f_claims,
}


def configs(runs: int, seed: int) -> tuple[Config, Config]:
    """Experiment 1; Experiments 2 and 3 with the ablations."""
    return (
        Config("he2018-1", ("ml-exact", "ml-de"), Options(), runs, seed),
        Config("he2018-blocks", ("ml-exact", "ml-de", *VARIANTS), Options(), runs, seed),
    )


@click.command(context_settings={"show_default": True})
@click.option("--runs", type=click.IntRange(min=100), default=512)
@click.option("--seed", type=SEED, default=0)
@click.option("--out", type=Folder(), default=Path("out/claims"))
def main(runs: int, seed: int, out: Path) -> None:
    """Compute what the papers claim and say which claims are reproduced."""
    start()
    directory = output_directory(out)
    began = time.perf_counter()
    random = np.random.default_rng(seed)
    experiment_1, experiment_2 = configs(runs, seed)
    pairs = build_scenario(Config("he2018-blocks", options=Options(blocks=6)))
    figures = ("generations", "consistency", "factorial")
    own = ("claims.csv", *(f"claims_{name}.png" for name in figures))
    with staged(directory, own) as stage:
        with tqdm(unit="tile", disable=None) as bar:

            def stage_of(words: str) -> Callable[[str], None]:
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
            found += reading_claims(reading_config(runs, seed), stage_of("Qian 2024"))
            factorial = factorial_table(runs, seed, stage_of("factorial"))
            found += factorial_claims(factorial)
            found += slope_claims(slope_config(runs, seed), stage_of("Fang 2018"))
            for words, claims in CONTROL.items():
                found += claims(stage_of(words))
        table = report.claims_table(found)
        write_table(stage / "claims.csv", table)
        report.generations(
            stage / "claims_generations.png",
            panels,
            GENERATIONS,
            f"within {ARRIVED_GAP:g} σ² of the optimum",
        )
        report.factorial(stage / "claims_factorial.png", factorial, FACTORS)
        report.consistency(stage / "claims_consistency.png", sized, consistency_fits(sized))
    click.echo(report.claims_text(table))
    click.echo(f"\nWritten to {directory} in {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    run(main)
