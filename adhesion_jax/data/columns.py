"""The quantities that the package knows: their units, valid ranges, and what users call them."""

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple


class Column(NamedTuple):
    """A column of numbers; `advice` says what to look at where a value lies outside the range.

    Where the largest size of all values lies outside `usual`, a warning is given: the values are
    possible, but of the size that another unit would give. `plain` is what the quantity is called
    where its unit is told beside it; `synonyms` are names by which it is recognised in a file,
    in small letters, where no other quantity has them too.
    """

    unit: str
    lower: float
    upper: float
    meaning: str
    plain: str
    synonyms: tuple[str, ...] = ()
    advice: str = "check its unit"
    usual: tuple[float, float] = (0.0, math.inf)

    @property
    def span(self) -> str:
        """The range in words, with its unit."""
        unit = "" if self.unit == "1" else f" {self.unit}"
        most = f"to {self.upper:g}" if math.isfinite(self.upper) else "and more"
        return f"{self.lower:g} {most}{unit}"


_TOLD = tomllib.loads(Path(__file__).with_name("columns.toml").read_text(encoding="utf-8"))


def _tuples(table: Mapping[str, object]) -> dict[str, object]:
    """The entries of a table, lists as tuples."""
    return {name: tuple(x) if isinstance(x, list) else x for name, x in table.items()}


#: Name to column.
COLUMNS: Mapping[str, Column] = {
    name: Column(**_tuples(told))  # type: ignore[arg-type]
    for name, told in _TOLD["columns"].items()
}

#: Label of `mode`, in any case of its letters, to the sign of the driving torque.
MODES: Mapping[str, float] = {"traction": 1.0, "braking": -1.0, "coasting": 0.0}

#: The label of what a comparison goes by.
GROUP = "group"

#: Known columns whose entries are labels: any text or number will do but for `mode`.
LABELS: Mapping[str, str] = {
    "run": "number or name of the run",
    "axle": "number or name of the axle",
    "mode": ", ".join(MODES),
    "file": "name of the file of a folder",
    GROUP: "what a comparison by a column goes by: any text or number",
}

#: Names by which columns of labels are recognised, in small letters.
LABEL_SYNONYMS: Mapping[str, tuple[str, ...]] = _tuples(_TOLD["labels"])  # type: ignore[assignment]

#: What the column of the standard deviation of adhesion is called right after it, and that of the
#: number of repeats.
SD_AFTER: tuple[str, ...] = tuple(_TOLD["beside"]["sd"])
REPEATS_BESIDE: tuple[str, ...] = tuple(_TOLD["beside"]["repeats"])

#: Words that tell a quantity but not of which body, and the columns among which to choose.
UNDECIDED: Mapping[str, tuple[str, ...]] = _tuples(_TOLD["undecided"])  # type: ignore[assignment]

#: Names of columns that are one of these, in small letters.
UNDECIDED_SYNONYMS: Mapping[str, tuple[str, ...]] = _tuples(_TOLD["undecided_synonyms"])  # type: ignore[assignment]
