"""Repeats and axles as columns side by side; the scatter of repeats."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from adhesion_jax.data.gathering import Gathered
from adhesion_jax.data.understanding import Taken
from adhesion_jax.wording import listed, number

#: Slips whose variances are pooled: of three repeats a variance is known to a factor of two only.
_POOLED = 5

#: What repeats differ in: the adhesion, what it comes from, and the label of the repeat itself.
_REPEATED = ("adhesion", "tangential_force_N", "run")


def stacked(read: Gathered, taken: Sequence[Taken], label: str) -> Gathered:
    """The rows of every repeat or axle one below the other, where they are columns side by side.

    The `label` numbers the copies from 1; where the file has such labels it is `label/copy`. What
    has one column for all is repeated. Without a label all stays as it is.
    """
    if not label:
        return read
    copies: dict[str, list[str]] = {}
    for one in taken:
        if one.copy:
            copies.setdefault(one.quantity, []).append(one.name)
    names = {name for of_one in copies.values() for name in of_one}
    count, rows = max(map(len, copies.values())), read.rows
    numbers = {
        name: np.tile(values, count) for name, values in read.numbers.items() if name not in names
    }
    for quantity, of_one in copies.items():
        if all(name in read.numbers for name in of_one):  # of one that is not needed, one may lack
            numbers[quantity] = np.concatenate([read.numbers[name] for name in of_one])
    labels = {
        name: pd.Categorical.from_codes(np.tile(of.codes, count), of.categories)
        for name, of in read.labels.items()
    }
    number = np.repeat(np.arange(1, count + 1), rows).astype(str)
    if label in labels:
        number = np.char.add(np.char.add(np.asarray(labels[label], str), "/"), number)
    labels[label] = pd.Categorical(number.astype(object))
    return read._replace(numbers=numbers, labels=labels, rows=count * rows)


def stacked_note(taken: Sequence[Taken], label: str, rows: int) -> list[str]:
    """The sentence on columns side by side that have `rows` rows as one; none without."""
    names = [one.column for one in taken if one.copy]
    if not label:
        return []
    count = max(one.copy for one in taken)
    if label == "axle":
        return [
            f"The columns {listed(names)} are those of {count} axles: they are used as {rows:,} "
            "rows, one axle below the other."
        ]
    return [
        f"The columns {listed(names)} are {count} repeats of the adhesion: they are used as "
        f"{rows:,} rows, those of the first column being run 1, and so on."
    ]


def of_means(columns: dict[str, np.ndarray]) -> list[str]:
    """Makes the standard deviation that of the mean, in place, where repeats are counted; says so.

    The standard deviation of the mean of n repeats is that of one over the root of n. A number of
    repeats explains nothing of the adhesion, and is not handed on.
    """
    count = columns.pop("repeats", None)
    if count is None:
        return []
    if "adhesion_sd" not in columns:
        return [
            "The number of repeats is not used: there is no standard deviation of the adhesion."
        ]
    columns["adhesion_sd"] = columns["adhesion_sd"] / np.sqrt(count)
    return [
        "Each adhesion is the mean of its number of repeats: its standard deviation is that of the "
        "file over the root of that number."
    ]


def with_scatter(table: pd.DataFrame, slip: str) -> tuple[pd.DataFrame, list[str]]:
    """The table with the column adhesion_sd from its repeats, and the sentence that says so.

    The standard deviation of one row is

        sqrt(sum of squared deviations from the mean of the repeats / sum of (repeats - 1))

    both summed over 5 neighbouring slips. Repeats are rows of exactly the same slip and the same
    other numbers, axle and mode. Unchanged are a table that has the column, one with time_s, whose
    rows are no repeats, and one in which half of the slips or fewer are repeated, or under 5.
    """
    if "adhesion_sd" in table or "time_s" in table or not len(table):
        return table, []
    slips, at, rows_at = np.unique(table[slip].to_numpy(), return_inverse=True, return_counts=True)
    if slips.size < _POOLED or 2 * np.count_nonzero(rows_at > 1) <= slips.size:
        return table, []
    same = [column for column in table if column not in _REPEATED]
    group = table.groupby(same, sort=False, observed=True).ngroup().to_numpy()
    adhesion, rows = table["adhesion"].to_numpy(), np.bincount(group)
    mean = np.bincount(group, adhesion) / rows
    squares = np.bincount(at, (adhesion - mean[group]) ** 2, slips.size)
    # Every group has one degree of freedom less than it has rows.
    freedom = np.bincount(at, 1 - 1 / rows[group], slips.size).round()
    repeated = np.flatnonzero(freedom)
    if repeated.size < _POOLED or 2 * repeated.size <= slips.size:
        return table, []
    first = np.clip(np.arange(repeated.size) - _POOLED // 2, 0, repeated.size - _POOLED)

    def pooled(values: np.ndarray) -> np.ndarray:
        whole = np.concatenate([[0.0], np.cumsum(values[repeated])])
        return whole[first + _POOLED] - whole[first]

    scatter = np.sqrt(pooled(squares) / pooled(freedom))
    # Adding up and taking away leaves rounding where repeats are equal throughout.
    if scatter.min() <= 1e-9:
        return table, []
    nearest = np.interp(np.arange(slips.size), repeated, np.arange(repeated.size)).round()
    column = scatter[nearest.astype(int)][at]
    note = (
        f"The standard deviation of the adhesion is that of the repeats, which {repeated.size} of "
        f"{slips.size} slips have: {number(column.min())} to {number(column.max())} in a row, each "
        f"from {_POOLED} neighbouring slips."
    )
    return table.assign(adhesion_sd=column), [note]
