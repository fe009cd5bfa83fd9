"""`adhesion status`: how far a job in shards is, and what its finished runs tell."""

from pathlib import Path

import click

from adhesion_jax.command_line.command import begin, command


@command("status out/montecarlo", cls=click.Command)
@click.argument("folder", type=click.Path(path_type=Path), default=Path("out/montecarlo"))
def main(folder: Path) -> None:
    """Say how far the job in FOLDER is, and what its finished runs tell."""
    begin()
    from adhesion_jax.library.status import status

    click.echo(status(folder))
