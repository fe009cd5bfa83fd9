"""A whole log of a locomotive, of which the truth is known."""

from collections.abc import Mapping
from pathlib import Path

import click
from tqdm import tqdm

from adhesion_jax.commands.record import record
from adhesion_jax.errors import InputError
from adhesion_jax.files import METADATA, output_directory, staged
from adhesion_jax.simulation.locomotive_log import (
    locomotive_log,
    truth_text,
    write_csv,
    write_parquet,
)

_WRITERS = {".csv": write_csv, ".parquet": write_parquet}


def main(
    hours: float, events: int, effect: str, seed: int, out: Path, asked: Mapping[str, object]
) -> None:
    """Write the log and its truth, both or neither."""
    if out.suffix not in _WRITERS:
        raise InputError(f"The ending of --out {out} is not known; name a .csv or .parquet file.")
    effects = () if effect == "none" else (effect,)
    drawn = locomotive_log(seed=seed, hours=hours, events=events, effects=effects)
    truth = out.with_suffix(".truth.json")
    with (
        staged(output_directory(out.parent), (out.name, truth.name, METADATA)) as stage,
        tqdm(total=drawn.rows, unit="row", unit_scale=True, leave=False, disable=None) as bar,
    ):
        for rows in _WRITERS[out.suffix](stage / out.name, drawn):
            bar.update(rows)
        (stage / truth.name).write_text(truth_text(drawn), encoding="utf-8")
    record(out.parent, asked)
    click.echo(f"Written to {out}: {drawn.rows:,} rows, {events} slip events; truth in {truth}")
