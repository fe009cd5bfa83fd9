"""Hold the claims of published papers against what can be computed: claims.csv and its figures."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import click
import numpy as np
import pandas as pd

from adhesion_jax.campaign.job import Config, build_scenario
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.command_line.command import SEED, Folder, run, start
from adhesion_jax.files import write_table
from adhesion_jax.identifiers.ml_de import GENERATIONS
from adhesion_jax.report.traction.panels import draw
from adhesion_jax.scenarios import Options
from adhesion_jax.scenarios.rails import KIENCKE_RAILS, RAILS
from experiments.claims import report
from experiments.claims.claim import Claim
from experiments.claims.fang2018 import control_claims
from experiments.claims.fang2018_slope import slope_claims, slope_config
from experiments.claims.he2018 import (
    consistency_claims,
    consistency_fits,
    consistency_table,
    convergence_claims,
    fact_claims,
)
from experiments.claims.he2018_blocks import (
    VARIANTS,
    as_blocks,
    scatter_claims,
    tracking_claims,
    volatility_claims,
)
from experiments.claims.he2018_generations import (
    ARRIVED_GAP,
    count_generations,
    generation_claims,
    generation_panels,
    innovation_claims,
    setting_claims,
)
from experiments.claims.hxd1f import hxd1f_claims
from experiments.claims.qian2024 import (
    FACTORS,
    factorial_claims,
    factorial_table,
    other_claims,
    outcomes,
    reading_claims,
    reading_config,
    variants,
)
from experiments.claims.traction import Found
from experiments.claims.uyulan2018 import uyulan_claims
from experiments.command import bar, written

#: Where a search is held against another the effects are small: so many times the runs.
MANY = 5


class Work(NamedTuple):
    """What the claims of a paper are computed with, and where their figures go."""

    runs: int
    seed: int
    folder: Path
    progress: Callable[[str], None]

    def drawn(self, name: str, found: Found) -> list[Claim]:
        report.settings(self.folder / f"claims_{name}.png", found.cloud)
        if found.panels:
            draw(self.folder / f"claims_{name}_runs.png", found.panels)
        return [*found.claims]


def he2018(work: Work) -> list[Claim]:
    runs, seed, progress = work.runs, work.seed, work.progress
    experiment = Config("he2018-1", ("ml-exact", "ml-de"), Options(), runs, seed)
    found = convergence_claims(experiment, progress)
    many = MANY * runs
    experiment = Config("he2018-blocks", ("ml-exact", "ml-de", *VARIANTS), Options(), many, seed)
    rows: list[pd.DataFrame] = []
    campaign = run_campaign(experiment, rows.append, progress)
    blocks = as_blocks(pd.concat(rows, ignore_index=True), build_scenario(experiment))
    random = np.random.default_rng(seed)
    found += scatter_claims(blocks, random)
    found += tracking_claims(campaign.tables, many)
    found += volatility_claims(campaign.tables, many)
    pairs = build_scenario(Config("he2018-blocks", options=Options(blocks=6)))
    panels = generation_panels(count_generations(pairs, seed, many, progress), pairs.rails)
    found += generation_claims(panels, random)
    found += innovation_claims(panels, random)
    found += setting_claims(pairs, seed, progress)
    single = build_scenario(Config("single"))
    sized = consistency_table(single, seed, runs, progress)
    found += consistency_claims(sized)
    found += fact_claims(single, progress)
    goal = f"within {ARRIVED_GAP:g} σ² of the optimum"
    report.generations(work.folder / "claims_generations.png", panels, GENERATIONS, goal)
    path = work.folder / "claims_consistency.png"
    report.consistency(path, sized, consistency_fits(sized))
    return found


def qian2024(work: Work) -> list[Claim]:
    over_settings = outcomes(variants(), work.seed, work.progress)
    found = reading_claims(reading_config(work.runs, work.seed), over_settings, work.progress)
    factorial = factorial_table(work.runs, work.seed, work.progress)
    found += factorial_claims(factorial, over_settings)
    found += other_claims(over_settings)
    report.factorial(work.folder / "claims_factorial.png", factorial, FACTORS)
    known = {
        "Burckhardt, He et al. 2018, Fig. 1": RAILS,
        "Kiencke, Qian et al. 2024, Fig. 1": KIENCKE_RAILS,
    }
    report.curves(work.folder / "claims_curves.png", known)
    return found


def fang2018(work: Work) -> list[Claim]:
    found = slope_claims(slope_config(work.runs, work.seed), work.progress)
    return found + work.drawn("fang2018", control_claims(work.progress))


#: By the name of the option.
PAPERS: Mapping[str, Callable[[Work], list[Claim]]] = {
    "he2018": he2018,
    "qian2024": qian2024,
    "fang2018": fang2018,
    "uyulan2018": lambda work: work.drawn("uyulan2018", uyulan_claims(work.progress)),
    "hxd1f": lambda work: work.drawn("hxd1f", hxd1f_claims(work.progress)),
}

_FIGURES = (
    *("generations", "consistency", "factorial", "curves"),
    *("fang2018", "fang2018_runs", "uyulan2018", "uyulan2018_runs", "hxd1f"),
)


@click.command(context_settings={"show_default": True})
@click.option("--paper", type=click.Choice([*PAPERS]), help="One paper alone.  [default: all]")
@click.option("--runs", type=click.IntRange(min=100), default=1024)
@click.option("--seed", type=SEED, default=0)
@click.option("--out", type=Folder(), default=Path("out/claims"))
def main(paper: str | None, runs: int, seed: int, out: Path) -> None:
    """Compute what the papers claim and say which claims hold, and what they rest on."""
    start()
    papers = PAPERS if paper is None else [paper]
    with written(out, ("claims.csv", *(f"claims_{name}.png" for name in _FIGURES))) as stage:
        with bar("part") as advance:
            work = Work(runs, seed, stage, advance)
            table = report.claims_table(claim for name in papers for claim in PAPERS[name](work))
        write_table(stage / "claims.csv", table)
        click.echo(report.claims_text(table))
        click.echo(f"\n{report.counts_text(table)}")


if __name__ == "__main__":
    run(main)
