"""`traction_leaderboard`: methods of slip control on equal terms, one's own among them."""

import time
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from adhesion_jax import runtime
from adhesion_jax.campaign.cluster import pool_of
from adhesion_jax.campaign.store import Arrays, read_all, write_rows
from adhesion_jax.campaign.traction import WHOLE
from adhesion_jax.errors import InputError
from adhesion_jax.files import METADATA, output_directory, write_metadata, write_table
from adhesion_jax.leaderboard import judging, tuning
from adhesion_jax.leaderboard.disturbances import ALL, disturbances, over_all, with_worst
from adhesion_jax.leaderboard.judging import PEAKS, SEEDS, Judging, shown_of
from adhesion_jax.leaderboard.table import COLUMNS, Known, board_of, table_of, with_rows
from adhesion_jax.leaderboard.terms import (
    OPTIMA,
    SAMPLED,
    STEP,
    Field,
    Grid,
    Versions,
    timing_of,
    versions_of,
)
from adhesion_jax.leaderboard.tuning import TRIPLES, Tuned, Tuning, tuned
from adhesion_jax.library.reading import own_parts, parts_named
from adhesion_jax.library.results import aligned, recorded, steps_told, text_html
from adhesion_jax.library.shards import check_numbers, compute, extended, opened_for, step_of
from adhesion_jax.measured.rails import rails_of_curves, rails_of_law
from adhesion_jax.report.leaderboard.figures import FIGURES_OF, Judged, rail_map, trade
from adhesion_jax.report.leaderboard.page import leaderboard_page, robust_page
from adhesion_jax.report.rendering import write_page
from adhesion_jax.runtime import as_in_commands
from adhesion_jax.traction.entrants import ENTRANTS, Entrant, box, sought
from adhesion_jax.traction.families import FAMILIES, Family
from adhesion_jax.traction.loop import Terms
from adhesion_jax.traction.plants.reading import PlantFile, read_plant, shipped
from adhesion_jax.traction.seekers.given import TrueOptimum
from adhesion_jax.traction.sensors import Sensors
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import terms_of
from adhesion_jax.wording import listed

#: The system whose train, demand, noise and start all methods share.
SYSTEM = "hxd1f"

#: The seed of the rails that methods are tuned on.
TUNING_SEED = 2026

#: The tracks that methods are judged on: by rails, or under disturbances that they do not know.
TRACKS = ("nominal", "robust")

#: All that may be written.
LEADERBOARD_FILES = (
    *("leaderboard.csv", "robustness.csv", "segments.parquet", "curves.csv", METADATA),
    *("report.html", "robustness.png", *(f"{name}.png" for name in FIGURES_OF)),
)

#: The columns that a terminal has room for.
_TOLD = (
    *("rails", "method", "rank", "utilisation", "utilisation_se", "worst", "never95", "t95_median"),
    *("utility_1_share", "torque_variation", "slip_energy_share", "remark"),
)


@dataclass(frozen=True, eq=False, repr=False)
class Leaderboard(Judged):
    """Methods of slip control, as they were judged on rails that they were not tuned on.

    Attributes:
        table: a row a method and family of rails; `columns` tells what each column is.
        segments: a row for each run and segment: figures, true peak, and the one identified.
        courses: three runs of each method and family, the best, the median and the worst.
        plant: the parameters of the train.
        told: what was asked for and what it took.
        seconds: by the clock.
    """

    plant: PlantFile
    told: Mapping[str, Any]
    seconds: float

    @property
    def columns(self) -> Mapping[str, tuple[str, str]]:
        """Unit and meaning of each column of the table."""
        return COLUMNS

    @property
    def curves(self) -> pd.DataFrame:
        """The peak that a method has identified at the end of a segment, beside the true one."""
        names = ["rails", "method", "seed", "run", "segment", *PEAKS]
        parts = self.segments[self.segments["segment"] != WHOLE]
        return parts.loc[np.isfinite(parts["found_slip"]), names].reset_index(drop=True)

    @as_in_commands
    def plot(self) -> Figure:
        """What a method uses of the rail, against what it takes; or under each disturbance."""
        return rail_map(self) if self._robust else trade(self)

    @property
    def _robust(self) -> bool:
        return bool(self.told["track"] == TRACKS[1])

    def write(self, folder: str | PathLike[str]) -> None:
        """The tables, figures, report and metadata that the command writes, but for the runs."""
        path = output_directory(Path(folder))
        figures, file = FIGURES_OF, "leaderboard.csv"
        if self._robust:
            figures, file = {"robustness": rail_map}, "robustness.csv"
        write_table(path / file, self.table)
        write_table(path / "curves.csv", self.curves)
        for name, draw in figures.items():
            draw(self).savefig(path / f"{name}.png", dpi=120)
        page = robust_page if self._robust else leaderboard_page
        write_page(path, page(self.table, self.plant, SYSTEMS[SYSTEM], self.told))
        told = {**self.told, "seconds": self.seconds, **runtime.describe()}
        write_metadata(path / METADATA, told)

    def __repr__(self) -> str:
        names = [name for name in _TOLD if name in self.table]
        rows = self.table[self.table["rails"] == ALL] if self._robust else self.table
        took = (self.told[key] for key in ("plant_steps", "run_cpu_seconds", "compile_seconds"))
        doubts = [f"{rails}: {doubt}" for rails, doubt in self.told["doubts"].items()]
        return "\n\n".join([aligned(rows[names], 40), *doubts, steps_told(*took)])

    def _repr_html_(self) -> str:
        return self.table.to_html(index=False) + text_html(repr(self))


@recorded
@as_in_commands
def traction_leaderboard(
    methods: str | Sequence[str] | Mapping[str, Any] | None = None,
    plant: str | PathLike[str] | None = None,
    rails: str | Sequence[str | PathLike[str]] | None = None,
    law: str | PathLike[str] | None = None,
    track: str = TRACKS[0],
    runs: int = 40,
    budget: int = 64,
    seed: int = 0,
    tuning_seed: int = TUNING_SEED,
    beside: str | PathLike[str] | None = None,
    step: float | None = None,
    duration: float = 15.0,
    workers: int = 1,
    out: str | PathLike[str] | None = None,
    resume: bool = False,
    extend: int = 0,
    cluster: str | None = None,
) -> Leaderboard:
    """Tune methods of slip control with equal budgets, and judge them on fresh rails.

    Every method has the same train, sensors, demand, rails and noise. It is tuned on the first of
    the rails, and judged on all of them. The true optima stand beside the methods.

    Args:
        methods: names of ENTRANTS, by default all, or methods of your own by name, as
            `{"mine": Mine()}`: seekers, controllers, observers, or entrants.
        plant: a TOML file, or the name of a plant that ships; by default that of the HXD1F.
        rails: names of FAMILIES, or a curves.csv of `identify`; by default exponential rails.
        law: a law.json of `discover`, whose rails are judged too.
        track: nominal, or robust: on exponential rails under disturbances that no method knows, of
            which half are tuned on.
        runs: number of runs on each family of rails, for each of three seeds.
        budget: number of configurations that each method is tuned with.
        seed: the first of the seeds of the rails that methods are judged on.
        tuning_seed: of the rails that methods are tuned on.
        beside: a leaderboard.csv whose rows stand beside those of this board.
        step: of the plant, s.
        duration: of a run, s.
        workers: processes, which a script must start under `if __name__ == "__main__":`.
        out: a folder for the files of the command; what is finished stays there in shards.
        resume: go on with a board that was interrupted.
        extend: further runs for the board in the folder.
        cluster: local:N, or the address of a scheduler of Dask, whose workers compute.

    Returns:
        The table, the figures of all runs, and the courses of some.

    Raises:
        InputError: a name or a file cannot be used.
    """
    began = time.perf_counter()
    check_numbers(runs, workers, seed, seeds=SEEDS)
    _refuse(budget, seed, tuning_seed, track, (plant, rails, law, beside))
    runs = extended(out, runs, resume, extend)
    robust = track == TRACKS[1]
    ground = _disturbed() if robust else _ground(_families(rails, law))
    families, other = ground.families, None if beside is None else board_of(beside)
    system = SYSTEMS[SYSTEM]
    source = str(system.plant if plant is None else plant)
    train = read_plant(shipped().get(source, Path(source)))
    grid = Grid(step_of(step, STEP), duration=duration)
    entrants = _entrants(methods)
    if robust:  # judged at the price that methods are ranked by
        entrants.pop(OPTIMA[3])
    terms = terms_of(system, train.plant, Sensors(system.noise, period=SAMPLED))
    field = _field(terms, grid, entrants, families)
    # The optima with a price differ from the one without in what they are told alone.
    alone = {name: one for name, one in entrants.items() if name not in [*OPTIMA.values()][1:]}
    of_tuned = {name: families[name] for name in ground.tuned_on}
    to_tune = Tuning(field._replace(entrants=alone), of_tuned, budget, tuning_seed)
    to_judge = Judging(field, families, {}, runs, seed)
    with (
        TemporaryDirectory() if out is None else nullcontext(out) as results,
        pool_of(workers, cluster) as pool,
        opened_for(
            "leaderboard",
            [to_judge, to_tune],
            output_directory(Path(results)),
            LEADERBOARD_FILES,
            resume,
            extend,
        ) as (folder, stage),
    ):
        compute(tuning.content, [to_tune], folder, lambda _: pool)
        of_tuning = [*read_all(folder, to_tune.name, to_tune.shards)]
        best = tuned(to_tune, of_tuning)
        points = {name: best.get(name, best[OPTIMA[0]]).point for name in entrants}
        compute(judging.content, [to_judge._replace(points=points)], folder, lambda _: pool)
        of_judging = [*read_all(folder, to_judge.name, to_judge.shards)]
        write_rows(stage / "segments.parquet", folder, [to_judge])
        segments = pd.read_parquet(stage / "segments.parquet")
        versions = {name: versions_of(terms, grid, one) for name, one in families.items()}
        known = {
            name: _known(one, best.get(name), best[OPTIMA[0]]) for name, one in entrants.items()
        }
        table = _table(segments, known, versions, ground.tuned_on[0], robust)
        if other is not None:
            table = with_rows(table, other)
        told = {
            "system": "leaderboard",
            "track": track,
            "plant": train.title,
            "rails": ground.titles,
            "doubts": {name: one.doubt for name, one in families.items() if one.doubt},
            "tuned_on": ", ".join(ground.tuned_on),
            "runs": runs,
            "seeds": [*range(seed, seed + SEEDS)],
            "budget": budget,
            "tuning_seed": tuning_seed,
            "tuning_rails": TRIPLES,
            "step_s": grid.step,
            "control_period_s": grid.control_period,
            "duration_s": duration,
            **_costs(of_tuning, of_judging, to_judge, ground.tuned_on[0]),
        }
        courses = shown_of(to_judge, of_judging)
        found = Leaderboard(table, segments, courses, train, told, time.perf_counter() - began)
        if out is not None:
            found.write(stage)
    return found


def _refuse(
    budget: int, seed: int, tuning_seed: int, track: str, of_nominal: tuple[object, ...]
) -> None:
    """InputError where numbers are not possible or the track has no such options."""
    if not 1 <= budget <= 2**16:
        raise InputError(
            f"a budget of {budget} configurations is not possible; give 1 to {2**16}, such as 64."
        )
    if seed <= tuning_seed < seed + SEEDS:
        raise InputError(
            f"methods would be judged on the rails that they are tuned on: the seeds of judging "
            f"are {seed} to {seed + SEEDS - 1}, and that of tuning is {tuning_seed}; give another "
            "seed."
        )
    if track not in TRACKS:
        raise InputError(f"There is no track {track}; name {listed(TRACKS, 'or')}.")
    if track == TRACKS[1] and any(one is not None for one in of_nominal):
        raise InputError(
            "the robust track has its own train and rails; leave out plant, rails, law and beside."
        )


class _Ground(NamedTuple):
    """What methods are judged on, with its title, and which of it they are tuned on, by name."""

    families: Mapping[str, Family]
    titles: Mapping[str, str]
    tuned_on: Sequence[str]


def _ground(families: Mapping[str, Family]) -> _Ground:
    """Families of rails, the first of which is tuned on."""
    return _Ground(families, {name: one.TITLE for name, one in families.items()}, [*families][:1])


def _disturbed() -> _Ground:
    """The disturbances of the robust track."""
    every = disturbances()
    return _Ground(
        {name: one.disturbance for name, one in every.items()},
        {name: one.words for name, one in every.items()},
        [name for name, one in every.items() if one.tuned_on],
    )


def _field(
    terms: Terms, grid: Grid, entrants: Mapping[str, Entrant], families: Mapping[str, Family]
) -> Field:
    """What all methods share; one program does for all dead times."""
    # What limits the step is the plant on its rails, or the observer of a method.
    first = next(iter(entrants.items())), next(iter(families.items()))
    timings = [
        timing_of(terms, grid, f"{name} on {on} rails", entrant, rail)
        for (name, entrant), (on, rail) in [
            *((one, first[1]) for one in entrants.items()),
            *((first[0], one) for one in families.items()),
        ]
    ]
    return Field(terms, max(timings, key=lambda one: one.dead), entrants)


def _table(
    segments: pd.DataFrame,
    known: Mapping[str, Known],
    versions: Mapping[str, Versions],
    tuned_on: str,
    robust: bool,
) -> pd.DataFrame:
    if not robust:
        return table_of(segments, known, versions, tuned_on)
    judged = pd.concat([over_all(segments), segments], ignore_index=True)
    return with_worst(table_of(judged, known, {ALL: versions[tuned_on], **versions}, ""))


def _costs(
    of_tuning: Sequence[Arrays], of_judging: Sequence[Arrays], job: Judging, tuned_on: str
) -> dict[str, object]:
    """Steps of the plant, the time that they took, and how fast each method is."""
    # All processes together.
    steps, cpu_seconds, compiling = (
        sum(float(one[name]) for one in (*of_tuning, *of_judging))
        for name in ("steps", "seconds", "compile_seconds")
    )
    return {
        "plant_steps": round(steps),
        "plant_steps_per_cpu_second": steps / cpu_seconds,
        "run_cpu_seconds": cpu_seconds,
        "compile_seconds": compiling,
        "million_plant_steps_per_cpu_second": {
            method: float(one["steps"] / one["seconds"] / 1e6)
            for (_, on, method), one in zip(job.units, of_judging, strict=True)
            if on == tuned_on
        },
    }


def _families(
    rails: str | Sequence[str | PathLike[str]] | None, law: str | PathLike[str] | None
) -> Mapping[str, Family]:
    """The rails by name: a file goes by its path as it is given."""
    if rails is None:
        rails = [] if law else [next(iter(FAMILIES))]
    found: dict[str, Family] = {}
    for one in [rails] if isinstance(rails, str | PathLike) else rails:
        if str(one) in FAMILIES:
            found[str(one)] = FAMILIES[str(one)]
        elif Path(one).suffix == ".csv":
            found[str(one)] = rails_of_curves(Path(one))
        else:
            raise InputError(
                f"There are no rails {one}; name {listed([*FAMILIES], 'or')}, or a curves.csv."
            )
    return {**found, **({} if law is None else {str(law): rails_of_law(Path(law))})}


def _entrants(methods: str | Sequence[str] | Mapping[str, Any] | None) -> dict[str, Entrant]:
    """The methods by name, and the true optima; InputError for a name that there is not."""
    optima = {name: sought(TrueOptimum(float(price))) for price, name in OPTIMA.items()}
    known = {**ENTRANTS, **optima}
    if isinstance(methods, Mapping):
        return {**optima, **own_parts("entrant", methods, known)}
    names = [*ENTRANTS] if methods is None else methods
    return {**optima, **parts_named("method", "methods", names, known)}


def _known(entrant: Entrant, own: Tuned | None, optimum: Tuned) -> Known:
    """What is known of a method: an optimum with a price has the numbers of the one without."""
    numbers = [
        f"{place.partition('.')[0]} {place.rpartition('.')[2]} {float(one.at(share)):.4g}"
        for (place, one), share in zip(
            box(entrant).items(), jnp.asarray((own or optimum).point), strict=True
        )
    ]
    seeker = entrant.seeker
    return Known(
        seeker is not None and seeker.told_price is not None,
        np.nan if own is None else own.promised,
        np.nan if own is None else own.promised_se,
        ", ".join(numbers),
        *(own or optimum).cost,
    )
