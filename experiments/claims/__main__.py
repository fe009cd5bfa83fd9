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
from experiments.claims import (
    fang2018,
    fang2018_slope,
    he2018,
    he2018_blocks,
    he2018_generations,
    hxd1f,
    qian2024,
    report,
    uyulan2018,
)
from experiments.claims.claim import Claim
from experiments.claims.traction import Found
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
        report.settings(self.folder / f"claims_{name}.png", found)
        if found.panels:
            draw(self.folder / f"claims_{name}_runs.png", found.panels)
        return [*found.claims]


def he2018_claims(work: Work) -> list[Claim]:
    runs, seed, progress = work.runs, work.seed, work.progress
    experiment = Config("he2018-1", ("ml-exact", "ml-de"), Options(), runs, seed)
    found = [*he2018.convergence_claims(experiment, progress)]
    many, methods = MANY * runs, ("ml-exact", "ml-de", *he2018_blocks.VARIANTS)
    experiment = Config("he2018-blocks", methods, Options(), many, seed)
    rows: list[pd.DataFrame] = []
    campaign = run_campaign(experiment, rows.append, progress)
    estimates = pd.concat(rows, ignore_index=True)
    blocks = he2018_blocks.as_blocks(estimates, build_scenario(experiment))
    random = np.random.default_rng(seed)
    found += he2018_blocks.scatter_claims(blocks, random)
    found += he2018_blocks.tracking_claims(campaign.tables, many)
    found += he2018_blocks.volatility_claims(campaign.tables, many)
    pairs = build_scenario(Config("he2018-blocks", options=Options(blocks=6)))
    needed = he2018_generations.count_generations(pairs, seed, many, progress)
    panels = he2018_generations.generation_panels(needed, pairs.rails)
    found += he2018_generations.generation_claims(panels, random)
    found += he2018_generations.innovation_claims(panels, random)
    found += he2018_generations.setting_claims(pairs, seed, progress)
    single = build_scenario(Config("single"))
    sized = he2018.consistency_table(single, seed, runs, progress)
    found += he2018.consistency_claims(sized)
    found += he2018.fact_claims(single, progress)
    goal = f"within {he2018_generations.ARRIVED_GAP:g} σ² of the optimum"
    report.generations(work.folder / "claims_generations.png", panels, GENERATIONS, goal)
    path = work.folder / "claims_consistency.png"
    report.consistency(path, sized, he2018.consistency_fits(sized))
    return found


def qian2024_claims(work: Work) -> list[Claim]:
    runs, seed, progress = work.runs, work.seed, work.progress
    over_settings = qian2024.outcomes(qian2024.variants(), seed, progress)
    found = [*qian2024.reading_claims(runs, seed, over_settings, progress)]
    factorial = qian2024.factorial_table(runs, seed, progress)
    found += qian2024.factorial_claims(factorial, over_settings)
    found += qian2024.other_claims(over_settings)
    report.factorial(work.folder / "claims_factorial.png", factorial, qian2024.FACTORS)
    known = {
        "Burckhardt, He et al. 2018, Fig. 1": RAILS,
        "Kiencke, Qian et al. 2024, Fig. 1": KIENCKE_RAILS,
    }
    report.curves(work.folder / "claims_curves.png", known)
    return found


def fang2018_claims(work: Work) -> list[Claim]:
    found = [*fang2018_slope.slope_claims(work.runs, work.seed, work.progress)]
    return found + work.drawn("fang2018", fang2018.control_claims(work.progress))


#: By the name of the option.
PAPERS: Mapping[str, Callable[[Work], list[Claim]]] = {
    "he2018": he2018_claims,
    "qian2024": qian2024_claims,
    "fang2018": fang2018_claims,
    "uyulan2018": lambda work: work.drawn("uyulan2018", uyulan2018.uyulan_claims(work.progress)),
    "hxd1f": lambda work: work.drawn("hxd1f", hxd1f.hxd1f_claims(work.progress)),
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
    names = ("claims.csv", *(f"claims_{name}.png" for name in _FIGURES))
    with written(out, names) as (stage, tell):
        with bar("part") as advance:
            work = Work(runs, seed, stage, advance)
            table = report.claims_table(claim for name in papers for claim in PAPERS[name](work))
        write_table(stage / "claims.csv", table)
        tell(report.claims_text(table))
        tell(f"\n{report.counts_text(table)}")


if __name__ == "__main__":
    run(main)
