"""`adhesion traction`: a published traction control system on its plant."""

from pathlib import Path
from typing import Any

import click

from adhesion_jax.command_line.catalogue import catalogue
from adhesion_jax.command_line.command import (
    SEED,
    File,
    FiniteRange,
    Name,
    begin,
    command,
    in_shards,
    out_folder,
)
from adhesion_jax.command_line.listing import listing
from adhesion_jax.command_line.record import record
from adhesion_jax.options import MOST_RUNS

NAMES = catalogue().names


@command(
    "traction --system hxd1f",
    "traction --system fang2018 --runs 0 --controller rate-feedback --out out/eq8",
)
@click.option(
    "--system", type=Name(NAMES["systems"]), required=True, help=f"{', '.join(NAMES['systems'])}."
)
@click.option(
    "--plant",
    type=File(NAMES["plants"], f"name a TOML file or {', '.join(NAMES['plants'])}"),
    help=f"A TOML file, or a plant that ships: {', '.join(NAMES['plants'])}.",
)
@click.option(
    "--observer",
    type=Name(NAMES["observers"], "observer"),
    help=f"Instead of the paper's: {', '.join(NAMES['observers'])}, FILE.py:NAME.",
)
@click.option(
    "--seeker",
    type=Name(NAMES["seekers"], "seeker"),
    help=f"Instead of the paper's: {', '.join(NAMES['seekers'])}, FILE.py:NAME.",
)
@click.option(
    "--controller",
    type=Name(NAMES["controllers"], "controller"),
    help=f"Instead of the paper's: {', '.join(NAMES['controllers'])}, FILE.py:NAME.",
)
@click.option("--runs", type=click.IntRange(0, MOST_RUNS), default=32)
@click.option("--seed", type=SEED, default=0)
@click.option("--step", type=FiniteRange(min=1e-6, max=1.0), help="Of the plant, in s.")
@click.option("--animate", is_flag=True, help="The operating point as a moving picture, too.")
@in_shards
@out_folder("traction")
@listing(
    systems=NAMES["systems"],
    plants=NAMES["plants"],
    observers=NAMES["observers"],
    seekers=NAMES["seekers"],
    controllers=NAMES["controllers"],
)
def main(
    system: str,
    observer: Any,
    seeker: Any,
    controller: Any,
    workers: int | None,
    out: Path,
    **asked: Any,
) -> None:
    """Run a published control system on its plant: its table, its figures and its metrics.

    Every scenario of the paper runs once without noise and `--runs` times with noise. With an
    observer, a seeker or a controller named, it takes the place of the paper's own.
    """
    observer, seeker, controller = begin(observer, seeker, controller)
    from adhesion_jax.library.traction import traction_control
    from adhesion_jax.runtime import CORES

    found = traction_control(
        system,
        observer=observer,
        seeker=seeker,
        controller=controller,
        workers=workers or CORES,
        out=out,
        **asked,
    )
    record(out)
    click.echo(f"{found}\n\nWritten to {out} in {found.seconds:.0f} s")
