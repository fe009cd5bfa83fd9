"""Run a published traction control system on its plant and judge it."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from adhesion_jax import runtime
from adhesion_jax.campaign.store import read_all
from adhesion_jax.campaign.traction import WHOLE, Named, added, metrics_of
from adhesion_jax.library.traction import aligned, traction_control

#: The figures that are told on the way.
_TOLD = ("utilisation", "utilisation_se", "tracking_rms", "slip_energy_share", "torque_variation")


def main(out: Path, workers: int | None, **asked: Any) -> None:
    """Write what a control system does: its table, its figures and its metrics."""
    found = traction_control(out=out, workers=workers or runtime.CORES, **asked)
    click.echo(f"{found}\n\nWritten to {out} in {found.seconds:.0f} s")


def tell_stored(record: Mapping[str, Any], folder: Path) -> None:
    """Print the figures of those runs that are there of the job of a record."""
    cases = [Named(**case) for case in record["cases"]]
    metrics = metrics_of(cases, added(read_all(folder, record["name"], record["shards"])))
    shown = metrics[metrics["segment"] == WHOLE]
    columns = ["scenario", "method", "noise", *_TOLD, "status"]
    click.echo("\nmeans over the finished runs, of the whole run each")
    click.echo(aligned(shown[columns]))
