"""The estimates of single runs that a campaign keeps, as tables of arrow."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from adhesion_jax.identifiers import Status
from adhesion_jax.metrics.tracking import Tracking
from adhesion_jax.scenarios import Scenario


class Found(NamedTuple):
    """The estimates of a method, arrays [runs, blocks], and what was seen on the way."""

    values: Mapping[str, np.ndarray]
    standard_errors: Mapping[str, np.ndarray]
    cosine_errors: Mapping[str, np.ndarray]  # of a method of least squares; NaN for another
    on_box: np.ndarray
    status: np.ndarray
    objective: np.ndarray
    kept_share: np.ndarray  # by which earlier data were last discounted; 0 after a reset
    evaluations: np.ndarray
    tracking: Tracking


def estimate_rows(
    name: str, scenario: Scenario, found: Mapping[str, Found], first: int, blocks: np.ndarray
) -> pa.Table:
    """One row for each method, run and block of `blocks`; `first` is the number of the first run.

    The values of a method are those of its own; in rows of others they stay empty.
    """
    values = dict.fromkeys(value for one in found.values() for value in one.values)
    tables = []
    for identifier, one in found.items():
        runs = len(one.status)

        def column(array: np.ndarray) -> pa.Array:
            return _numbers(array[:, blocks].ravel())

        empty = pa.nulls(runs * len(blocks), pa.float64())
        here = np.zeros(runs * len(blocks))
        codes = one.status[:, blocks].ravel()
        rails = list(dict.fromkeys(scenario.rails))
        of_block = np.array([rails.index(scenario.rails[b]) for b in blocks])
        columns = {
            "scenario": _words(here, [name]),
            "run": _numbers(np.repeat(np.arange(first, first + runs), len(blocks))),
            "identifier": _words(here, [identifier]),
            "block": _numbers(np.tile(blocks, runs)),
            "rail": _words(np.tile(of_block, runs), rails),
            **{v: column(one.values[v]) if v in one.values else empty for v in values},
            **{
                f"{v}_se": column(one.standard_errors[v]) if v in one.values else empty
                for v in values
            },
            "status": _words(codes, [status.name.lower() for status in sorted(Status)]),
            "objective": column(one.objective),
            "forgetting": column(one.kept_share),
            "evaluations": column(one.evaluations),
        }
        tables.append(pa.table(columns))
    return pa.concat_tables(tables).unify_dictionaries()


def segment_rows(
    words: Mapping[str, str],
    numbers: Mapping[str, np.ndarray],
    segments: Sequence[str],
    figures: Mapping[str, np.ndarray],
) -> pa.Table:
    """A row for each run and segment: words of all, numbers of a run, figures [runs, segments]."""
    runs = len(next(iter(figures.values())))
    here = np.zeros(runs * len(segments))
    return pa.table(
        {
            **{name: _words(here, [word]) for name, word in words.items()},
            **{name: _numbers(np.repeat(of, len(segments))) for name, of in numbers.items()},
            "segment": _words(np.tile(np.arange(len(segments)), runs), segments),
            **{name: _numbers(np.ravel(figure)) for name, figure in figures.items()},
        }
    )


# Whatever is given to `pa.array`, it imports pandas, a fifth of the start of a worker process.


def _numbers(values: np.ndarray) -> pa.Array:
    """The numbers, which are not truth values, as a column without gaps."""
    if values.dtype == bool:
        raise TypeError("arrow packs truth values into bits, which this does not")
    kind = pa.from_numpy_dtype(values.dtype)
    return pa.Array.from_buffers(kind, values.size, [None, pa.py_buffer(values)])


def _words(places: np.ndarray, known: Sequence[str]) -> pa.Array:
    """Words at their places among those that are known."""
    ends = np.cumsum([0, *(len(word.encode()) for word in known)], dtype=np.int32)
    letters = pa.py_buffer("".join(known).encode())
    words = pa.StringArray.from_buffers(len(known), pa.py_buffer(ends), letters)
    return pa.DictionaryArray.from_arrays(_numbers(places.astype(np.int32)), words)


def row_schema(parts: Sequence[pa.Schema]) -> pa.Schema:
    """The columns of the rows of several jobs; what one has alone is empty in the others."""
    names = dict.fromkeys(name for part in parts for name in part.names)
    last = [name for name in ("status", "objective", "forgetting", "evaluations") if name in names]
    ordered = [
        *(name for name in names if not name.endswith("_se") and name not in last),
        *(name for name in names if name.endswith("_se")),
        *last,
    ]
    fields = {field.name: field for part in parts for field in part}
    return pa.schema([fields[name] for name in ordered])
