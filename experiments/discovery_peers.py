"""Hold the discovery against what a user would try instead on the residual of a base curve."""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import click
import numpy as np
import pandas as pd
from tqdm import tqdm

from adhesion_jax import runtime
from adhesion_jax.discovery.simulated_base import rms
from adhesion_jax.discovery.study import Discover, is_right, removed_share
from adhesion_jax.errors import InputError
from adhesion_jax.files import staged, write_metadata, write_table
from adhesion_jax.report.discovery_peers import draw_peers, peers_text, summarised
from experiments.command import output_directory, run
from experiments.discovery_tables import discover_tables
from experiments.peer_features import fit_base
from experiments.peer_methods import PEERS, predicted
from experiments.peer_sets import PeerSet, is_right_column, simulated_sets, stored_sets

OWN_FILES = ("peer_sets.csv", "peers.csv", "peers.png", "metadata.json")

#: This project's own discovery, beside the peers.
THIS = "discovery"

Row = dict[str, object]


@click.command()
@click.option(
    "--simulated",
    type=click.IntRange(min=0),
    default=23,
    show_default=True,
    help="Simulated sets; about a third of them have nothing hidden.",
)
@click.option("--sets", type=click.Path(path_type=Path), help="Folder of stored sets to add.")
@click.option("--methods", help=f"Of {', '.join((THIS, *PEERS))}; by default all.")
@click.option("--seed", type=click.IntRange(min=0, max=2**32 - 1), default=0, show_default=True)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("out/discovery_peers"),
    show_default=True,
)
def main(simulated: int, sets: Path | None, methods: str | None, seed: int, out: Path) -> None:
    """Errors, names and false names of the discovery and of general methods on the same sets."""
    chosen = _chosen(methods)
    stored = stored_sets(sets) if sets else []
    if not simulated and not stored:
        raise InputError("There is no set to work on; give --simulated above 0 or --sets FOLDER.")
    directory = output_directory(out)
    began = time.perf_counter()
    rows: list[Row] = []
    with staged(directory, OWN_FILES) as stage:
        with tqdm(total=(simulated + len(stored)) * len(chosen), unit="fit") as bar:
            for part in (*stored, *simulated_sets(simulated, seed)):
                for row in compared(part, chosen, discover_tables, seed):
                    bar.set_description(f"{part.name} {row['method']}")
                    bar.update()
                    rows.append(row)
        table = pd.DataFrame(rows)
        summary = summarised(table)
        write_table(stage / "peer_sets.csv", table)
        write_table(stage / "peers.csv", summary)
        draw_peers(stage / "peers.png", table)
        metadata = {
            "config": {"simulated": simulated, "sets": len(stored), "seed": seed},
            "wall_seconds": time.perf_counter() - began,
            **runtime.describe(),
        }
        write_metadata(stage / "metadata.json", metadata)
    click.echo(peers_text(summary))
    click.echo(f"\nwritten to {directory} in {time.perf_counter() - began:.0f} s")


def compared(part: PeerSet, methods: Sequence[str], discover: Discover, seed: int) -> Iterator[Row]:
    """One row a method: errors on the test table before and after, names, seconds."""
    began = time.perf_counter()
    base = fit_base(part.train, part.test)
    base_seconds = time.perf_counter() - began
    measured = part.test["adhesion"].to_numpy(float)
    judge: Callable[[str], bool]
    for method in methods:
        began = time.perf_counter()
        if method == THIS:
            findings = discover(part.train, part.test, seed)
            assert findings.test is not None
            before, after = findings.test.before.value, findings.test.after.value
            names = tuple(found.name for found in (*findings.effects, *findings.unexplained))
            seconds = time.perf_counter() - began
            judge = partial(_names_effect, part.effects)
        else:
            answer = predicted(method, part.train, part.test, base)
            seconds = time.perf_counter() - began + base_seconds
            before, after = rms(measured - base.test), rms(measured - answer.adhesion)
            names = answer.named
            judge = partial(is_right_column, part.effects)
        right = [name for name in names if judge(name)]
        yield {
            "set": part.name,
            "planted": "+".join(part.effects) or "nothing",
            "method": method,
            "before": before,
            "after": after,
            "noise": part.rms_noise,
            "removed": removed_share(before, after, part.rms_noise) if part.effects else np.nan,
            # A tenth of a per cent is no harm that anyone would notice.
            "worse": after > 1.001 * before,
            "names": "|".join(names),
            "right_names": len(right),
            "false_names": len(names) - len(right),
            "seconds": seconds,
        }


def _names_effect(effects: Sequence[str], name: str) -> bool:
    return any(is_right(effect, name) for effect in (*effects, *_parts(effects)))


def _parts(effects: Sequence[str]) -> tuple[str, ...]:
    """A stored set may call by one name what the catalogue has two effects for."""
    return ("load_peak", "load_slope") if "load" in effects else ()


def _chosen(methods: str | None) -> tuple[str, ...]:
    known = (THIS, *PEERS)
    chosen = tuple(name.strip() for name in methods.split(",")) if methods else known
    for name in chosen:
        if name not in known:
            raise InputError(f"There is no method '{name}'; known are {', '.join(known)}.")
    if {*chosen} & {*PEERS} and not (find_spec("sklearn") and find_spec("pysindy")):
        raise InputError(
            "The peers need scikit-learn and pysindy, which are not installed; run "
            "pip install -e '.[peers]' -c constraints.txt."
        )
    return chosen


if __name__ == "__main__":
    run(main)
