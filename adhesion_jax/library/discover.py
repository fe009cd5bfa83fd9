"""`discover`: which effects an adhesion curve lacks in measured runs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from adhesion_jax.data import RunSet, matching, to_runs
from adhesion_jax.data.events import Chosen
from adhesion_jax.data.forces import Corrections
from adhesion_jax.data.stretches import FEW_OF_A_SEARCH
from adhesion_jax.discovery import engine
from adhesion_jax.discovery.types import Findings
from adhesion_jax.effects import Cause
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.files import output_directory
from adhesion_jax.library.reading import Data, chosen_of, citation_of, name_of, parts_of
from adhesion_jax.library.results import columns_of, of_numbers, recorded, text_html, written
from adhesion_jax.plugins import add
from adhesion_jax.report.discovery.figures import adhesion_over_slip
from adhesion_jax.report.discovery.files import DISCOVERY_FILES, printed, write_discovery
from adhesion_jax.report.discovery.tables import (
    effects_frame,
    effects_table,
    errors_frame,
    errors_table,
    ranking_frame,
)
from adhesion_jax.report.discovery.words import verdict
from adhesion_jax.runtime import as_in_commands, silent


@dataclass(frozen=True, eq=False, repr=False)
class Discovery:
    """What a curve lacks in measured runs, and how far its error falls with it.

    Attributes:
        findings: everything, as the reports read it.
        logs: the rows that were used of each table, and the slip events they are.
    """

    findings: Findings
    logs: Sequence[Chosen]

    @property
    def law(self) -> CorrectedLaw:
        """The curve with its effects, a function of slip and conditions (columns by name).

        Conditions are scalars for a steady state, or arrays [points] of one whole run in time.
        """
        return self.findings.law

    @property
    def effects(self) -> pd.DataFrame:
        """A row for each parameter of an effect, with its 95 % interval and unit."""
        return effects_frame(self.findings)

    @property
    def errors(self) -> pd.DataFrame:
        """Root mean square error before and after, in training, cross-validation and test."""
        return errors_frame(self.findings)

    @property
    def ranking(self) -> pd.DataFrame:
        """A row for each candidate of each round, the strongest first."""
        return ranking_frame(self.findings)

    @property
    def base_parameters(self) -> pd.DataFrame:
        """The parameters of the base curve before and after."""
        return self.findings.base_parameters

    @property
    def points(self) -> pd.DataFrame:
        """A row for each training point: run, slip, adhesion, before, after and its columns."""
        return self.findings.points

    @property
    def predictions(self) -> pd.DataFrame | None:
        """A row for each used row of the test: row (the number among these), run, time_s, slip,
        adhesion, and its prediction by base, corrected and, if asked for, with_trees.
        """
        return self.findings.predictions

    @property
    def verdict(self) -> str:
        """What is missing, how sure that is, and how much smaller the error becomes."""
        return verdict(self.findings)

    def write(self, folder: str | PathLike[str]) -> None:
        """The report.html, report.md, law.json, tables and figures that the command writes."""
        path = output_directory(Path(folder))
        as_in_commands(write_discovery)(path, self.findings, self.logs)

    @as_in_commands
    def plot(self) -> Figure:
        """The points, and the law before and after, at the median of every column."""
        return adhesion_over_slip(self.findings)

    def __repr__(self) -> str:
        return printed(self.findings)

    def _repr_html_(self) -> str:
        tables = (errors_table(self.findings), effects_table(self.findings))
        frames = (pd.DataFrame(list(one.rows), columns=list(one.headings)) for one in tables)
        return text_html(self.verdict) + "".join(frame.to_html(index=False) for frame in frames)


@recorded
@as_in_commands
def discover(
    data: Data | Sequence[Data],
    test: Data | Sequence[Data] | None = None,
    curves: str | Sequence[str] = "auto",
    seed: int = 0,
    effects: Sequence[type[Cause]] | Mapping[str, type[Cause]] = (),
    slip_noise: float | None = None,
    correct: bool = False,
    progress: Callable[[str, float], None] = silent,
    columns: Mapping[str, object] | None = None,
    wheel_radius: float | None = None,
    events: bool | None = None,
    delays: Mapping[str, float] | None = None,
    inertia: float | None = None,
    gear_ratio: float | None = None,
    efficiency: float = 1.0,
    axles: bool = False,
    out: str | PathLike[str] | None = None,
) -> Discovery:
    """Find which effects an adhesion curve lacks in measured runs.

    Args:
        data: tables as `identify` takes them, with a column run (or time_s, from whose gaps runs
            are told) and whatever was measured beside.
        test: tables that are predicted and never fitted.
        curves: names of CURVES, of which the base curve is the best, or auto.
        seed: of the draw of the runs that are held out.
        effects: classes of your own, which are searched for beside those of EFFECTS and stay there.
        slip_noise: standard deviation of the noise of the wheel speed, m/s (of the slip, where
            there is no vehicle speed), 0 for an exact slip; estimated where there is time_s.
        correct: predict the test also with boosted trees on top of the law, where they help.
        progress: called with words and the share that is done.
        columns: what columns are where names and units do not tell, `{"speed": "v [km/h]"}`; a
            minus turns a sign, `{"wheel_load": "-FZ"}`, and a number is a constant.
        wheel_radius: rolling radius, m, for a slip from the rotation of the wheel.
        events: whether each slip event of a log is a run; by default that is so in a long log.
        delays: how late signals are, s, as in `{"vehicle_speed": 0.2}`.
        inertia: that of a wheelset with all that turns with it, kg m2, taken off its force.
        gear_ratio: turns of the motor for one of the wheel, where its torque was measured.
        efficiency: that of the gear between motor and wheel, a share.
        axles: columns of one quantity with an index are those of axles, one below the other.
        out: a folder for the files of the command of the same name.

    Returns:
        The effects with their intervals, the law with them, and the errors before and after.

    Raises:
        InputError: something cannot be used; the sentence names all that is wrong with the data.
    """
    own = effects if isinstance(effects, Mapping) else {kind.__name__: kind for kind in effects}
    add("effect", own)
    known = Corrections(wheel_radius, delays or {}, inertia, gear_ratio, efficiency, axles)
    logs = chosen_of(data, columns, known, events, FEW_OF_A_SEARCH)
    train = to_runs([log.points for log in logs])
    judging: RunSet | None = None
    judged: Sequence[Chosen] = ()
    if test is not None:
        judged = chosen_of(test, columns, known, events, FEW_OF_A_SEARCH)
        judging = matching(train, to_runs([log.points for log in judged]))
    parts = parts_of(data)
    remarks = (*(log.sentence for log in logs), *map(citation_of, parts))
    findings = engine.discover(
        train,
        judging,
        curves,
        seed,
        progress,
        source=", ".join(map(name_of, parts)),
        citation=" ".join(filter(None, remarks)),
        slip_noise=slip_noise,
        correct=correct,
    )
    progress("writing the report", 0.97)
    laws = {name: of_numbers(getattr(findings, name)) for name in ("law", "law_before")}
    found = Discovery(findings._replace(**laws), tuple(logs))
    understood = columns_of([log.points for log in (*logs, *judged)])
    return written(found, out, DISCOVERY_FILES, understood)
