"""From a campaign to findings: what the law lacks, how sure that is, and what it is worth."""

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor

import jax
import jax.numpy as jnp
import numpy as np

from adhesion_jax.curves import CURVES
from adhesion_jax.data.runs import RunSet
from adhesion_jax.discovery.bases import FAMILIES, bic, first_fits
from adhesion_jax.discovery.conditions import calendar_of
from adhesion_jax.discovery.findings import Findings
from adhesion_jax.discovery.fitting import Fitted, Setting, squares
from adhesion_jax.discovery.judgement import doubtful, vetoed
from adhesion_jax.discovery.library import library_of
from adhesion_jax.discovery.noise import white_noise
from adhesion_jax.discovery.problem import Problem, prepare
from adhesion_jax.discovery.scans import torsion
from adhesion_jax.discovery.screening import compile_changes
from adhesion_jax.discovery.selection import search
from adhesion_jax.discovery.state import Selection, settled, with_noise
from adhesion_jax.discovery.summary import summarise
from adhesion_jax.errors import InputError
from adhesion_jax.records import Record

#: Share of the runs that no effect is selected on: it must raise their likelihood too.
_HELD_OUT = 0.25

#: How often is searched anew without what the held-out runs reject.
_SEARCHES = 3

#: Effects under which the sum of squared errors is more than so many times larger are none.
_WORSE = 1.01

#: Effects whose imperfect form leaves lines in the spectrum of time.
_LIKE_TORSION = ("slip_noise", "rail_joint", "wheel_order")

#: A campaign of more points is thinned: they would say no more of effects, only take longer.
_POINTS = 8_000


def _silent(_words: str, _share: float) -> None:
    """Where nobody looks."""


def discover(
    runs: RunSet,
    test: RunSet | None = None,
    base: str = "auto",
    seed: int = 0,
    progress: Callable[[str, float], None] = _silent,
    source: str = "",
    citation: str = "",
) -> Findings:
    """What effects the runs show that an adhesion curve alone does not.

    `base` names a curve, or auto for the choice by BIC. `test` is never used for fitting.
    `progress` is told what is done, and which share of the whole that is.
    """
    began = time.perf_counter()
    bases = _bases(runs, base)
    whole = with_run_order(runs)
    warnings = list(runs.warnings)
    thinned, thinning = _thinned(whole)
    warnings += thinning
    problem = prepare(thinned, calendar_of(thinned), runs.blocks)
    held_out = _held_out(problem, seed)
    progress("fitting the base curves", 0.05)
    selected_on = np.where(held_out[:, None], 0.0, problem.points)
    setting, fits = _started(problem, selected_on, bases)
    entries = library_of(problem)
    for _ in range(_SEARCHES):
        state = search(setting, fits, entries, seed, progress)
        progress("judging what was found", 0.75)
        doubts: Sequence[str] = ()
        if base == "auto" and bases != ("level",):
            state, doubts = doubtful(state)
        state, rejected = vetoed(state, held_out, seed)
        warnings += [word for word in (*doubts, *rejected.values()) if word not in warnings]
        if not rejected:
            break
        # What was rejected may have stood in the way of its like.
        entries = tuple(entry for entry in entries if entry.name not in rejected)
    noisy = any(effect.name in _LIKE_TORSION for effect in state.accepted)
    line = None if noisy else torsion(state.setting, state.fitted)
    progress("fitting all runs", 0.85)
    final = _on_all_runs(problem, state)
    plain = final
    if final.accepted:
        plain = settled(Setting(problem, final.setting.noise, final.setting.level), fits, (), ())
        if squares(final.setting, final.fitted) > _WORSE * squares(plain.setting, plain.fitted):
            names = " and ".join(effect.name for effect in final.accepted)
            warnings.append(
                f"{names} would explain how neighbouring points differ, but not lower the error of "
                "adhesion; this is not counted as an effect."
            )
            line = None
            final = plain._replace(ranking=final.ranking, thresholds=final.thresholds)
    progress("measuring the errors", 0.92)
    return summarise(
        runs=runs,
        record=whole,
        test=None if test is None else with_run_order(test),
        test_rows=None if test is None else test.rows,
        plain=plain,
        final=final,
        line=line,
        warnings=warnings,
        seed=seed,
        source=source,
        citation=citation,
        began=began,
    )


def _bases(runs: RunSet, base: str) -> tuple[str, ...]:
    sizes = np.abs(np.asarray(runs.record.slip)[np.asarray(runs.record.mask)])
    if np.ptp(sizes) < 1e-6 * max(float(sizes.max()), 1e-300):
        return ("level",)
    known = runs.record.conditions
    if base == "auto":
        return tuple(
            name for name in FAMILIES if "polach" not in name or "vehicle_speed_mps" in known
        )
    if base not in CURVES:
        raise InputError(f"--base {base} is not known; name one of {', '.join(CURVES)}, or auto.")
    missing = [name for name in CURVES[base].NEEDS if name not in known]
    if missing:
        raise InputError(
            f"--base {base} needs the column {' and '.join(missing)}; add it or name another curve."
        )
    return (base,)


def with_run_order(runs: RunSet) -> Record:
    """The record with the order of its runs as a condition: by their numbers, if they are some."""
    try:
        order = np.array([float(name) for name in runs.names])
    except ValueError:
        order = np.arange(len(runs.names), dtype=float)
    shape = runs.record.slip.shape
    column = jnp.broadcast_to(jnp.asarray(order)[:, None], shape)
    return runs.record._replace(conditions={**runs.record.conditions, "run_order": column})


def _thinned(record: Record) -> tuple[Record, list[str]]:
    points = int(np.asarray(record.mask).sum())
    every = -(-points // _POINTS)
    if every == 1:
        return record, []
    return jax.tree.map(lambda column: column[:, ::every], record), [
        f"Of {points} points every {every}. was used to find effects, and all to measure errors; "
        "effects that act within a few samples may be missed."
    ]


def _held_out(problem: Problem, seed: int) -> np.ndarray:
    """Which runs are held out, drawn at random, [runs]."""
    runs = problem.points.shape[0]
    chosen = np.random.default_rng([seed, 7]).permutation(runs)[: round(_HELD_OUT * runs)]
    return np.isin(np.arange(runs), chosen)


def _started(
    problem: Problem, weight: np.ndarray, bases: Sequence[str]
) -> tuple[Setting, Mapping[str, Fitted]]:
    """Every base curve alone, under the noise that the best of them leaves."""
    adhesion = np.asarray(problem.data.adhesion)
    inside = weight > 0
    sigma = 0.1 * float(np.sqrt(np.mean(adhesion[inside] ** 2)))
    white = Setting(problem, white_noise(weight, max(sigma, 1e-12)), adhesion)
    with ThreadPoolExecutor(1) as pool:
        # Compiling the two programs is most of a first search: let them be compiled side by side.
        compiled = pool.submit(compile_changes, white, bases[0])
        fits = first_fits(white, bases)
        compiled.result()
    best = min(fits.values(), key=bic)
    return with_noise(white, best), fits


def _on_all_runs(problem: Problem, state: Selection) -> Selection:
    """The same effects, fitted to all runs."""
    noise = state.setting.noise._replace(weight=problem.points)
    setting = Setting(problem, noise, state.fitted.adhesion)
    final = settled(setting, state.fits, state.accepted, state.ranking)
    return final._replace(thresholds=state.thresholds)
