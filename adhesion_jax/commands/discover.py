"""Which physical effect a law lacks in measured data."""

import json
from collections.abc import Sequence
from pathlib import Path

import click
from tqdm import tqdm

from adhesion_jax.data import SHIPPED
from adhesion_jax.data.runs import matching, read_runs
from adhesion_jax.discovery.engine import discover
from adhesion_jax.files import output_directory, staged
from adhesion_jax.report.discovery.files import DISCOVERY_FILES, printed, write_discovery
from adhesion_jax.simulation.simulator import simulate, write_set


def main(
    train: tuple[str, ...],
    tests: tuple[str, ...],
    base: str,
    seed: int,
    planted: tuple[str, ...] | None,
    slip_noise: float | None,
    out: Path,
) -> None:
    """Write what a curve lacks in the runs, or in simulated ones where effects are planted."""
    output_directory(out)
    if planted is not None:
        write_set(out, simulate(planted, seed=seed))
        train, tests = (str(out / "train.csv.gz"),), (str(out / "test.csv.gz"),)
    with tqdm(total=100, unit="%", bar_format=_BAR, leave=False) as bar:

        def progress(words: str, share: float) -> None:
            bar.set_description_str(words)
            bar.update(100 * share - bar.n)

        progress("reading", 0.0)
        runs = read_runs(_paths(train))
        test = matching(runs, read_runs(_paths(tests))) if tests else None
        findings = discover(
            runs,
            test,
            base,
            seed,
            progress,
            source=", ".join(train),
            citation=_citation(train),
            slip_noise=slip_noise,
        )
        progress("writing the report", 0.97)
        with staged(out, DISCOVERY_FILES) as stage:
            write_discovery(stage, findings)
    click.echo(f"{printed(findings)}\n\nWritten to {out} in {findings.seconds:.0f} s")
    if planted is not None:
        truth = json.loads((out / "truth.json").read_text())
        click.echo(f"Planted: {', '.join(truth['effects']) or 'nothing'}")


_BAR = "{desc}: {percentage:3.0f} %|{bar}| {elapsed}<{remaining}"


def _paths(names: Sequence[str]) -> list[Path]:
    return [SHIPPED[name].path if name in SHIPPED else Path(name) for name in names]


def _citation(names: Sequence[str]) -> str:
    return " ".join(SHIPPED[name].citation for name in names if name in SHIPPED)
