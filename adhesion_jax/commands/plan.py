"""How far the slip must go, and how many samples it takes, to know the peak."""

from pathlib import Path

import click
from tqdm import tqdm

from adhesion_jax.curves import CURVES, Law
from adhesion_jax.effects.saved import load_law
from adhesion_jax.files import output_directory, staged, write_table
from adhesion_jax.library.identify import Identification, identify
from adhesion_jax.library.plan import PLAN_FILES, plan
from adhesion_jax.measured.saved import load_curve
from adhesion_jax.report.plan.words import checked
from adhesion_jax.studies.plan import check_plan


def main(
    log: str | None,
    rail: str | None,
    curves: str | None,
    law: str | None,
    curve: str | None,
    conditions: tuple[tuple[str, float], ...],
    check: int | None,
    seed: int,
    out: Path,
    **asked: object,
) -> None:
    """Write the plan for a rail, a curve, a law or a log, and where asked what simulations say."""
    output_directory(out)
    source = _source(log, rail, curves, law, curve)
    found = plan(source, conditions=dict(conditions), **asked)  # type: ignore[arg-type]
    with staged(out, PLAN_FILES) as stage:
        found.write(stage)
        words = f"{found}"
        if check is not None:
            with tqdm(total=100, unit="%", bar_format=_BAR, leave=False) as bar:

                def progress(words: str, share: float) -> None:
                    bar.set_description_str(words)
                    bar.update(100 * share - bar.n)

                table = check_plan(found.plan, check, seed, progress)
            write_table(stage / "check.csv", table)
            words += f"\n\n{checked(table, check)}"
    click.echo(f"{words}\n\nWritten to {out}")


_BAR = "{desc}: {percentage:3.0f} %|{bar}| {elapsed}<{remaining}"


def _source(
    log: str | None, rail: str | None, curves: str | None, law: str | None, curve: str | None
) -> str | Law | Identification:
    if log is not None:
        return identify(log, CURVES if curve is None else curve)
    if curves is not None:
        return load_curve(Path(curves), curve)[1]
    if law is not None:
        return load_law(law)
    assert rail is not None
    return rail
