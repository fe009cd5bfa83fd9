"""Which adhesion curve measured points follow."""

from pathlib import Path

import click
import pandas as pd

from adhesion_jax.curves import CURVES
from adhesion_jax.data import SHIPPED, check_curve, read_measured, to_record
from adhesion_jax.errors import InputError
from adhesion_jax.files import output_directory, staged, write_table
from adhesion_jax.measured.fit import fit_all, missing_columns
from adhesion_jax.measured.residual import residual_structure
from adhesion_jax.report.measured.figure import draw_measured
from adhesion_jax.report.measured.words import curve_rows, printed_table, verdict


def main(file: str, curve: str, out: Path) -> None:
    """Write what the measured points of a file, or of a set that ships, say of a curve, or all."""
    shipped = SHIPPED.get(file)
    measured = read_measured(shipped.path if shipped else Path(file))._replace(name=file)
    check_curve(measured)
    record = to_record(measured)
    chosen = CURVES if curve == "all" else {curve: CURVES[curve]}
    not_fitted = {
        name: missing for name in chosen if (missing := missing_columns(chosen[name], record))
    }
    if curve in not_fitted:
        raise InputError(
            f"{file} lacks the column {' and '.join(not_fitted[curve])}, which the curve {curve} "
            "needs; add it or name another curve."
        )
    output_directory(out)

    fits = fit_all(chosen, record, measured.slip == "slip_velocity_mps")
    best = min(fits, key=lambda name: fits[name].bic)
    runs = measured.table["run"] if "run" in measured.table else pd.Series(0, measured.table.index)
    residuals = {
        name: residual_structure(fit, record, pd.factorize(runs)[0]) for name, fit in fits.items()
    }
    citation = shipped.citation if shipped else ""
    words = verdict(measured, citation, fits, not_fitted, residuals[best])
    with staged(out, ("curves.csv", "verdict.txt", "curves.png")) as stage:
        write_table(stage / "curves.csv", curve_rows(fits, not_fitted))
        (stage / "verdict.txt").write_text(words + "\n")
        draw_measured(stage / "curves.png", Path(file).name, fits, residuals)
    click.echo(f"{printed_table(fits)}\n\n{words}\n\nWritten to {out}")
