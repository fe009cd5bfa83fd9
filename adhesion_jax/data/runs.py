"""The runs of a campaign: their rows, their conditions, and all of them side by side."""

from collections.abc import Iterator, Mapping, Sequence
from hashlib import blake2b
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pandas as pd

from adhesion_jax.data.columns import COLUMNS, LABELS, MODES
from adhesion_jax.data.grouping import as_one, group, with_velocity
from adhesion_jax.data.reading import Measured, refuse_useless
from adhesion_jax.data.stretches import order_by, steps_in_runs
from adhesion_jax.errors import InputError
from adhesion_jax.records import Record
from adhesion_jax.wording import listed

#: Largest number of runs of a campaign: every run is at least one point of a search.
MOST_RUNS = 20_000

#: Columns that are no conditions: the slip, and what is to be explained by it, the adhesion, its
#: standard deviation, and the force, which is adhesion times load.
_EXPLAINED = ("slip_ratio", "adhesion", "adhesion_sd", "tangential_force_N")

#: Conditions that a curve or an effect in time may need, kept whatever else they are equal to.
_ALWAYS = ("time_s", "vehicle_speed_mps", "slip_velocity_mps", "normal_load_N")


#: Points of a block, and how many blocks there shall be. With fewer, a test that flips the sign of
#: whole blocks cannot reach p = .001; beyond the most, longer blocks are worth more than further
#: ones, for they depend less on their neighbours.
_BLOCK_POINTS = 10
_FEWEST_BLOCKS = 16
_MOST_BLOCKS = 50


def places(starts: np.ndarray, lengths: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray]:
    """The rows of runs side by side and where there are any, both [runs, points].

    `starts` and `lengths` [runs] are the first row of each run and its number of rows. The last row
    of a run is repeated to that number of points.
    """
    step = np.arange(points)
    held = starts[:, None] + np.minimum(step, lengths[:, None] - 1)
    return held, step < lengths[:, None]


class Rows(NamedTuple):
    """Rows of measured data, run after run, each run in its own order; arrays [rows]."""

    slip: np.ndarray
    adhesion: np.ndarray
    conditions: Mapping[str, np.ndarray]


class RunSet(NamedTuple):
    """The runs of a campaign.

    Its rows lie one after the other, so that memory does not depend on how the lengths of the runs
    differ; `record` lays them side by side. The conditions are the numeric columns without slip
    ratio, adhesion and force, those of labels as codes, and the `mode` as +1 traction, -1 braking,
    0 coasting.
    """

    whole: Rows
    starts: np.ndarray  # [runs]: the place in `whole` of the first row of each run
    places: np.ndarray  # [rows]: where a row stood, from 0 over all files one after the other
    worth: np.ndarray  # [rows]: how many independent measured rows it is worth (`data.condensing`)
    names: tuple[str, ...]  # of the runs
    order: np.ndarray  # [runs]: of the runs in the campaign
    blocks: bool  # contiguous blocks of one run take the place of runs
    covariates: tuple[str, ...]  # the conditions that the project does not know
    named: Mapping[str, tuple[str, ...]]  # the labels of a condition, in the order of their codes
    left_out: Mapping[str, str]  # columns that are not used, each with the clause why
    warnings: tuple[str, ...]  # whole sentences
    slip: str  # the column that is the slip: slip_ratio, or slip_velocity_mps without a speed
    same: Mapping[str, str]  # column left out of the conditions -> the column that it repeats

    @property
    def lengths(self) -> np.ndarray:
        """The number of rows of each run, [runs]."""
        return np.diff(self.starts, append=self.whole.slip.size)

    @property
    def run(self) -> np.ndarray:
        """The number of the run of each row, [rows]."""
        return np.repeat(np.arange(self.starts.size), self.lengths)

    @property
    def record(self) -> Record:
        """The runs side by side, arrays [runs, points].

        A run is padded at its end with its last row, masked. Blocks of one run in time are led in
        by as many rows before them, masked: what acts with a memory needs them.
        """
        held, inside = self.layout
        mask = jnp.asarray(inside)
        slip, adhesion = jnp.asarray(self.whole.slip[held]), jnp.asarray(self.whole.adhesion[held])
        return Record(slip, adhesion, mask, mask, self.conditions_at(held))

    def conditions_at(self, held: np.ndarray) -> dict[str, jnp.ndarray]:
        """The conditions of the rows in those places of `whole`, and the order of their runs.

        It is the condition `run_order`, and computed here since a column of it would repeat one
        number a run.
        """
        conditions = {name: jnp.asarray(rows[held]) for name, rows in self.whole.conditions.items()}
        run = np.searchsorted(self.starts, held, side="right") - 1
        return conditions | {"run_order": jnp.asarray(self.order[run])}

    @property
    def weights(self) -> np.ndarray:
        """`worth` of each point of `record`, [runs, points], masked ones too."""
        return self.worth[self.layout[0]]

    @property
    def layout(self) -> tuple[np.ndarray, np.ndarray]:
        """The rows in `whole` at the points of `record`, and where it has points."""
        held, inside = places(self.starts, self.lengths, int(self.lengths.max()))
        if self.blocks and "time_s" in self.whole.conditions:
            # Where there are none before, the first row again.
            before = np.maximum(held[:, :1] - np.arange(inside.shape[1], 0, -1), 0)
            held, inside = np.hstack([before, held]), np.hstack([np.zeros_like(inside), inside])
        return held, inside


def to_runs(files: Sequence[Measured]) -> RunSet:
    """The runs of measured tables, or InputError naming all that is wrong with them.

    Runs are told apart by the column `run`, without one by gaps in time_s; no run reaches over two
    files. Needed are the columns that `read_measured` needs and 10 rows in all, at one slip or
    many.
    """
    measured = as_one(files)
    grouping = group(measured)
    table, slip = with_velocity(measured.table), measured.slip
    length = np.bincount(grouping.run)
    refuse_useless(measured, _fault(length))
    columns, named = _conditions(table, slip)
    same = _repeated({slip: table[slip], "adhesion": table["adhesion"], **columns})
    order = order_by(grouping.run)
    rows = Rows(
        _numbers(table[slip], order),
        _numbers(table["adhesion"], order),
        {name: _numbers(values, order) for name, values in columns.items() if name not in same},
    )
    return RunSet(
        rows,
        np.cumsum(length) - length,
        np.arange(len(table), dtype=np.int32) if order is None else order,
        np.broadcast_to(1.0, len(table)),
        grouping.names,
        np.array(_told_order(grouping.names) or range(len(grouping.names)), float),
        False,
        tuple(name for name in rows.conditions if name not in {*COLUMNS, *LABELS}),
        named,
        measured.left_out,
        (
            *_warnings(table, slip, grouping.run),
            *dict.fromkeys(measured.gaps),
            *(f"The column {name} is left out: {why}." for name, why in measured.left_out.items()),
            *(
                f"The column {name} is left out: it is the same as {first}."
                for name, first in same.items()
            ),
        ),
        slip,
        same,
    )


def in_blocks(runs: RunSet) -> RunSet:
    """A single run cut into contiguous blocks of like length; several runs as they are.

    A block has at least 10 points, and fewer (down to 2) where there would be under 16 blocks.
    """
    points = runs.whole.slip.size
    if len(runs.names) > 1 or points < 4:
        return runs
    wanted = max(points // _BLOCK_POINTS, min(_FEWEST_BLOCKS, points // 2))
    count = min(wanted, _MOST_BLOCKS)
    starts = -(-np.arange(count) * points // count)
    length = np.unique(np.diff(starts, append=points))
    return runs._replace(
        starts=starts,
        names=tuple(f"block {number}" for number in range(1, count + 1)),
        order=np.arange(count, dtype=float),
        blocks=True,
        warnings=(
            f"There is one run only: {count} contiguous blocks of {' to '.join(map(str, length))} "
            "points take the place of runs. Intervals and p-values then assume that points of "
            "different blocks are nearly independent, and effects that act in time within a run "
            "can hardly be tested.",
            *runs.warnings,
        ),
    )


def with_run_time(runs: RunSet) -> RunSet:
    """The runs with `run_time_s`, the time since each began, where the data have no such column.

    Those without a time, and blocks of one run, are returned as they are.
    """
    conditions = runs.whole.conditions
    if runs.blocks or "time_s" not in conditions:
        return runs
    since = conditions["time_s"] - np.repeat(conditions["time_s"][runs.starts], runs.lengths)
    if any(np.array_equal(since, rows) for name, rows in conditions.items() if name != "time_s"):
        return runs
    return runs._replace(whole=runs.whole._replace(conditions={"run_time_s": since, **conditions}))


def cut_alike(runs: RunSet, test: RunSet) -> RunSet:
    """The runs of `test`, a single one in blocks only if `runs` are blocks too."""
    return in_blocks(test) if runs.blocks else test


def matching(runs: RunSet, test: RunSet) -> RunSet:
    """The runs of `test` with the conditions of `runs` and no others, labels by its codes.

    A label that `runs` lacks has the code -1. Where the names of the runs do not tell their order
    in the campaign, those of `test` come last. InputError where a condition is missing.
    """
    rows = test.whole
    there = {**rows.conditions, test.slip: rows.slip, "adhesion": rows.adhesion}
    # Two columns may differ in one set and be equal in the other.
    there |= {name: there[first] for name, first in test.same.items()}
    needed = [runs.slip, *runs.whole.conditions]
    if runs.slip == "slip_velocity_mps":
        # Slip is a velocity and the speed is taken as 1, whether the test set has one or not.
        there["vehicle_speed_mps"] = np.ones_like(rows.slip)
    missing = [name for name in needed if name not in there]
    if missing:
        raise InputError(_lacks(missing, test.left_out))
    conditions = {name: there[name] for name in runs.whole.conditions}
    warnings = test.warnings
    for name, known in runs.named.items():
        labels, place = test.named.get(name), conditions[name].astype(int)
        if labels is None:  # the column has numbers in the test data
            values, place = np.unique(conditions[name], return_inverse=True)
            labels = tuple(f"{value:g}" for value in values)
        codes = [known.index(label) if label in known else -1.0 for label in labels]
        conditions[name] = np.array(codes)[place]
        strange = [label for label in labels if label not in known]
        if strange:
            warnings += (
                f"The training data have no {name} {listed(strange)}: what was found of the others "
                "is not applied to it.",
            )
    told = _told_order(runs.names) and _told_order(test.names)
    return test._replace(
        whole=rows._replace(slip=there[runs.slip], conditions=conditions),
        order=test.order if told else len(runs.names) + np.arange(len(test.names), dtype=float),
        covariates=runs.covariates,
        named=runs.named,
        warnings=warnings,
        slip=runs.slip,
    )


def _lacks(missing: Sequence[str], left_out: Mapping[str, str]) -> str:
    """What is wrong with test data without these columns, of which some may be left out."""
    absent = [name for name in missing if name not in left_out]
    unused = [f"{name} ({left_out[name]})" for name in missing if name in left_out]
    faults = []
    if absent:
        faults.append(
            f"The test data lack {listed(absent)}, which the training data have; add what is "
            "missing, or leave it out of the training data too."
        )
    if unused:
        faults.append(
            f"Left out of the test data: {listed(unused)}, which the training data have; mend it "
            "there, or leave it out of the training data too."
        )
    return " ".join(faults)


def _told_order(names: Sequence[str]) -> list[float]:
    """The names of runs as numbers; none if one is no number."""
    try:
        return [float(name) for name in names]
    except ValueError:
        return []


def _fault(length: np.ndarray) -> str:
    """A clause on runs that are of no use although every cell is valid; empty where they are.

    `length` are their numbers of rows, [runs].
    """
    if length.size > MOST_RUNS:
        return (
            f"there are {length.size} runs (at most {MOST_RUNS} are taken: join those that belong "
            "together in the column run)"
        )
    if length.size > 1 and length.max() == 1:
        return (
            f"each of the {length.size} runs has one row (a run is a sweep of several; without "
            "the column run all rows are one run)"
        )
    return ""


def _conditions(
    table: pd.DataFrame, slip: str
) -> tuple[dict[str, pd.Series], dict[str, tuple[str, ...]]]:
    """Every condition by its name, [rows], and the labels of those that have some."""
    columns = {str(name): table[name] for name in table if name not in {*_EXPLAINED, *LABELS}}
    if slip == "slip_velocity_mps":
        # As in `to_record`: a curve multiplies slip by this speed to have the slip velocity.
        columns["vehicle_speed_mps"] = pd.Series(1.0, index=table.index)
    if "mode" in table:
        columns["mode"] = table["mode"].str.lower().map(MODES)
    if "axle" in table:
        columns["axle"] = table["axle"]
    named: dict[str, tuple[str, ...]] = {}
    for name, values in columns.items():
        if isinstance(values.dtype, pd.CategoricalDtype) and name != "mode":
            # Numbers by their value, then names.
            order = sorted((float(x) if x.isdecimal() else np.inf, x) for x in values.unique())
            named[name] = tuple(label for _, label in order)
            columns[name] = values.map({label: code for code, label in enumerate(named[name])})
    return columns, named


def _numbers(column: pd.Series, order: np.ndarray | None) -> np.ndarray:
    """A column in that order, [rows]; not copied where it lies so already."""
    values = column.to_numpy(float)
    return values if order is None else values[order]


def _repeated(columns: Mapping[str, pd.Series]) -> dict[str, str]:
    """Each column that is exactly another one, and which: a known column goes before others.

    Constant columns are not compared, because they explain nothing.
    """
    first: dict[tuple[int, bytes], str] = {}
    same: dict[str, str] = {}
    for name in sorted(columns, key=lambda name: name not in {*COLUMNS, *LABELS}):
        values = columns[name].to_numpy(float)
        if (values == values[0]).all():
            continue
        # Adding zero makes -0 the same as 0.
        content = (values.size, blake2b((values + 0.0).data).digest())
        if content in first and name not in _ALWAYS:
            same[name] = first[content]
        else:
            first.setdefault(content, name)
    return same


def _warnings(table: pd.DataFrame, slip: str, run: np.ndarray) -> Iterator[str]:
    """Sentences on what slip, time and runs do not allow to be told."""
    if slip == "slip_velocity_mps":
        yield (
            "There is no vehicle_speed_mps: slip is the slip velocity in m/s, the speed is taken "
            "as 1, and no effect of speed can be tested."
        )
    if "time_s" in table:
        equal = int((steps_in_runs(table["time_s"].to_numpy(), run) == 0).sum())
        if equal:
            yield (
                f"In time_s {equal} {'row has' if equal == 1 else 'rows have'} the time of the row "
                "before in the same run: no time passes there for effects that act in time."
            )
    length = np.bincount(run)
    single = int((length == 1).sum())
    if single:
        yield (
            f"{single} of {length.size} runs {'has' if single == 1 else 'have'} one point only, "
            "which shows neither the noise within a run nor effects that act in time."
        )
