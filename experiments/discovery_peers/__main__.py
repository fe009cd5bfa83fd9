"""Hold the discovery against what a user would try instead on the residual of a base curve."""

import time
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from itertools import chain
from pathlib import Path

import click
import numpy as np
import pandas as pd

from adhesion_jax.command_line.command import SEED, Folder, Names, run, start
from adhesion_jax.errors import InputError
from adhesion_jax.files import write_table
from experiments.campaigns.base import rms
from experiments.command import bar, written
from experiments.discovery_peers.features import fit_base, in_runs
from experiments.discovery_peers.methods import PEERS, predicted
from experiments.discovery_peers.report import THIS, draw_peers, peers_text, summarised
from experiments.discovery_peers.sets import PeerSet, random_sets, simulated_sets, stored_sets
from experiments.discovery_study.judging import Discover, counted, discovered
from experiments.study import removed_share

OWN_FILES = ("peer_sets.csv", "peers.csv", "peers.png", "metadata.json")

METHODS = (THIS, *PEERS)

Row = dict[str, object]


@click.command(context_settings={"show_default": True})
@click.option(
    "--simulated",
    type=click.IntRange(min=0),
    default=23,
    help="Simulated sets; about a third of them have nothing hidden.",
)
@click.option(
    "--random",
    type=click.IntRange(min=0),
    default=0,
    help="Simulated sets with an effect that is a random smooth function of one or two columns.",
)
@click.option("--sets", type=click.Path(path_type=Path), help="Folder of stored sets to add.")
@click.option("--methods", type=Names(METHODS), default=METHODS, help="Names divided by commas.")
@click.option("--seed", type=SEED, default=0)
@click.option("--out", type=Folder(), default=Path("out/discovery_peers"))
def main(
    simulated: int,
    random: int,
    sets: Path | None,
    methods: tuple[str, ...],
    seed: int,
    out: Path,
) -> None:
    """Errors, names and false names of the discovery and of general methods on the same sets."""
    if {*methods} & {*PEERS} and not (find_spec("sklearn") and find_spec("pysindy")):
        raise InputError(
            "The peers need scikit-learn and pysindy, which are not installed; run "
            "pip install -e '.[peers]' -c constraints.txt."
        )
    start()
    stored = stored_sets(sets) if sets else []
    if not (simulated or random or stored):
        raise InputError("There is no set to work on; give --simulated above 0 or --sets FOLDER.")
    rows: list[Row] = []
    config = {"simulated": simulated, "random": random, "sets": len(stored), "seed": seed}
    with written(out, OWN_FILES, config) as (stage, tell):
        total = (len(stored) + simulated + random) * len(methods)
        parts = chain(stored, simulated_sets(simulated, seed), random_sets(random, seed))
        with bar("fit", total) as advance:
            for part in parts:
                for row in compared(part, methods, discovered, seed):
                    advance(f"{part.name} {row['method']}")
                    rows.append(row)
        table = pd.DataFrame(rows)
        write_table(stage / "peer_sets.csv", table)
        write_table(stage / "peers.csv", summarised(table))
        draw_peers(stage / "peers.png", table)
        tell(peers_text(table))


def compared(part: PeerSet, methods: Sequence[str], discover: Discover, seed: int) -> Iterator[Row]:
    """One row for each method: errors on the test table before and after, names, seconds."""
    train, test = in_runs(part.train), in_runs(part.test)
    began = time.perf_counter()
    base = fit_base(train, test)
    base_seconds = time.perf_counter() - began
    measured = part.test["adhesion"].to_numpy(float)
    for method in methods:
        began = time.perf_counter()
        if method == THIS:
            findings = discover(part.train, part.test, seed)
            seconds = time.perf_counter() - began
            assert findings.test is not None
            before, after = findings.test.before.value, findings.test.after.value
            claims = (*findings.effects, *findings.unexplained)
            names = tuple(claim.name for claim in claims)
            hits = [
                [one.is_named_by(claim, counted(claim)) for one in part.hidden] for claim in claims
            ]
        else:
            answer = predicted(method, train, test, base)
            seconds = time.perf_counter() - began + base_seconds
            before, after = rms(measured - base.test), rms(measured - answer.adhesion)
            names = answer.named
            hits = [[name.startswith(one.columns) for one in part.hidden] for name in names]
        right = sum(any(hit) for hit in hits)
        yield {
            "set": part.name,
            "planted": part.planted,
            "method": method,
            "before": before,
            "after": after,
            "noise": part.rms_noise,
            "removed": removed_share(before, after, part.rms_noise)
            if part.hidden and part.scored
            else np.nan,
            # A tenth of a per cent is no harm that anyone would notice.
            "worse": after > 1.001 * before,
            "names": "|".join(names),
            "hidden": len(part.hidden),
            "named": sum(any(of_one) for of_one in zip(*hits, strict=True)),
            "right_names": right,
            "false_names": len(names) - right,
            "seconds": seconds,
        }


if __name__ == "__main__":
    run(main)
