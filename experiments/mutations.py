"""Change numbers of the package, one at a time, to see whether the tests that guard them fail."""

import os
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Mapping
from multiprocessing.pool import ThreadPool
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import NamedTuple

import click
from tqdm import tqdm

from adhesion_jax.keeping import VARIABLE
from adhesion_jax.report.page import Table
from adhesion_jax.report.rendering import in_columns

ROOT = Path(__file__).parents[1]


class Mutation(NamedTuple):
    file: str
    text: str  # stands in the file once
    becomes: str
    test: str  # fails then
    why: str  # it matters


def mutations() -> Mapping[str, Mutation]:
    """Those of tests/mutations.toml, by name."""
    listed = tomllib.loads((ROOT / "tests" / "mutations.toml").read_text(encoding="utf-8"))
    return {name: Mutation(**one) for name, one in listed.items()}


def copied(folder: Path) -> Path:
    """The folder with a copy of the tree, to change and to test in."""
    left_out = shutil.ignore_patterns(".*", "__pycache__", "out", "build", "*.egg-info")
    return Path(shutil.copytree(ROOT, folder, ignore=left_out))


def status_of(copy: Path, tests: Iterable[str]) -> int:
    """The exit status of pytest in a copy of the tree: 0 all pass, 1 one fails, else none ran."""
    environment = {
        **{name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"},
        "PYTHONPATH": str(copy),
        VARIABLE: str(copy / "out" / "kept"),
        "JAX_COMPILATION_CACHE_DIR": str(copy / "out" / "compiled"),
    }
    command = [sys.executable, "-m", "pytest", "-n0", "-p", "no:cacheprovider", "-m", "", *tests]
    return subprocess.run(command, cwd=copy, env=environment, capture_output=True).returncode


def outcome(copy: Path, mutation: Mutation) -> str:
    """`killed` if the test fails in a copy that is changed so, `survived` if it passes.

    `stale` if the text does not stand there once, or the test did not run.
    """
    changed = copy / mutation.file
    source = changed.read_text(encoding="utf-8")
    if source.count(mutation.text) != 1:
        return "stale"
    try:
        _write(changed, source.replace(mutation.text, mutation.becomes))
        return {0: "survived", 1: "killed"}.get(status_of(copy, [mutation.test]), "stale")
    finally:
        _write(changed, source)


def _write(module: Path, source: str) -> None:
    """Python knows the bytecode of a module by time and size alone, which may stay the same."""
    module.write_text(source, encoding="utf-8")
    for bytecode in module.parent.glob(f"__pycache__/{module.stem}.*.pyc"):
        bytecode.unlink()


@click.command()
@click.option(
    "--only", multiple=True, type=click.Choice([*mutations()]), help="This one; may recur."
)
@click.option("--workers", type=click.IntRange(min=1), default=1, help="Tests side by side.")
def main(only: tuple[str, ...], workers: int) -> None:
    """Change numbers of the package one at a time, and tell which their tests do not see.

    Ends with status 1 where a test passes in spite of the change that it guards against.
    """
    chosen = {name: one for name, one in mutations().items() if not only or name in only}
    with TemporaryDirectory() as folder:
        copies = [Path(folder) / str(number) for number in range(workers)]
        copied(copies[0])
        click.echo("Without a change", err=True)
        if status_of(copies[0], dict.fromkeys(one.test for one in chosen.values())):
            raise click.ClickException("One of the tests fails, or is not there, without a change.")
        free: SimpleQueue[Path] = SimpleQueue()
        for copy in copies:
            if copy != copies[0]:
                shutil.copytree(copies[0], copy)
            free.put(copy)

        def found(mutation: Mutation) -> str:
            copy = free.get()
            try:
                return outcome(copy, mutation)
            finally:
                free.put(copy)

        with ThreadPool(workers) as pool:
            outcomes = [*tqdm(pool.imap(found, chosen.values()), total=len(chosen), disable=None)]
    rows = [
        (name, result, mutation.test.rpartition("/")[2])
        for (name, mutation), result in zip(chosen.items(), outcomes, strict=True)
    ]
    click.echo(in_columns(Table(("mutation", "outcome", "test"), rows)))
    sys.exit(any(result != "killed" for result in outcomes))


if __name__ == "__main__":
    main()
