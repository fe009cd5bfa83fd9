"""`adhesion simulate`: a whole log of a locomotive, of which the truth is known."""

from pathlib import Path

import click
from tqdm import tqdm

from adhesion_jax.command_line.command import (
    SEED,
    FiniteRange,
    Name,
    begin,
    command,
    listing,
    record,
)
from adhesion_jax.errors import InputError

_EFFECTS = ("none", "humidity", "falling_friction")


@command("simulate --hours 0.3 --events 3 --seed 1 --out log.csv")
@click.option(
    "--hours",
    type=FiniteRange(min=0, min_open=True, max=240),
    default=8.0,
    help="Length of the log; an hour has 360,000 rows.",
)
@click.option(
    "--events", type=click.IntRange(min=0), default=5, help="Number of slip events in it."
)
@click.option(
    "--effect",
    type=Name(_EFFECTS),
    default="none",
    help="What acts on adhesion beside slip: none, humidity or falling_friction.",
)
@click.option("--seed", type=SEED, default=0)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    default=Path("out/simulate/log.csv"),
    help="File for the log, .csv or .parquet.",
)
@listing(effects=_EFFECTS)
def main(hours: float, events: int, effect: str, seed: int, out: Path) -> None:
    """Write a simulated log of a locomotive, and the truth behind it.

    The log has speed of train and wheel, force and load of an axle, humidity and temperature at
    100 Hz. A .csv file is as a German spreadsheet exports it (semicolons, decimal commas, km/h and
    kN, date and time of day). The truth is written to the same name with the ending .truth.json.
    """
    begin()
    from adhesion_jax.files import METADATA, output_directory, staged
    from adhesion_jax.simulation.locomotive_log import (
        locomotive_log,
        truth_text,
        write_csv,
        write_parquet,
    )

    writers = {".csv": write_csv, ".parquet": write_parquet}
    if out.suffix not in writers:
        raise InputError(f"The ending of --out {out} is not known; name a .csv or .parquet file.")
    effects = () if effect == "none" else (effect,)
    drawn = locomotive_log(seed=seed, hours=hours, events=events, effects=effects)
    truth = out.with_suffix(".truth.json")
    with (
        staged(output_directory(out.parent), (out.name, truth.name, METADATA)) as stage,
        tqdm(total=drawn.rows, unit="row", unit_scale=True, leave=False, disable=None) as bar,
    ):
        for rows in writers[out.suffix](stage / out.name, drawn):
            bar.update(rows)
        (stage / truth.name).write_text(truth_text(drawn), encoding="utf-8")
    record(out.parent)
    click.echo(f"Written to {out}: {drawn.rows:,} rows, {events} slip events; truth in {truth}")
