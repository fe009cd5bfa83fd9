"""The quantities that the package knows, and what the name of a column says: quantity and unit."""

import math
import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
import pint

from adhesion_jax.wording import listed


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

Values = TypeVar("Values", float, np.ndarray)

_UNITS = tomllib.loads(Path(__file__).with_name("units.toml").read_text(encoding="utf-8"))


def unit_of(column: str) -> str:
    """The unit of a known column, or of the time since a run began; else words for an unknown."""
    if column in COLUMNS:
        return COLUMNS[column].unit
    return "s" if column == "run_time_s" else "unit of the column"


def _spelled(kind: str) -> dict[str, str]:
    """Spellings of units to the form that pint knows."""
    return {one: unit for unit, spellings in _UNITS[kind].items() for one in spellings}


#: Spellings in small letters, and those whose capital letters matter.
_SPELLINGS, _EXACT = _spelled("spellings"), _spelled("exact")

#: The letters and signs of a unit. What pint is given is computed, and 9**9**9 would never end: no
#: number is raised to a power, and a power is a number of one digit.
_WRITTEN = re.compile(r"[\w\s%‰°µμΩ·*/().^+-]{1,40}")
_SUPER = "⁰¹²³⁴⁵⁶⁷⁸⁹"
_BOMB = re.compile(
    rf"(?:\*\*|\^)(?!\s*\(?[+-]?\d(?:\.\d)?\)?(?![\d.]))"
    rf"|[\d)]\s*\)*\s*(?:\*\*|\^|[{_SUPER}])|[{_SUPER}]{{2}}|\d{{5}}"
)


class Conversion(NamedTuple):
    """A value in the unit of the package is `factor` times the value in the other, plus `offset`.

    Of a mass the weight at standard gravity is taken.
    """

    factor: float
    offset: float

    def of(self, values: Values) -> Values:
        """Values in the unit of the package."""
        return values if self == (1.0, 0.0) else values * self.factor + self.offset

    def back(self, value: float) -> float:
        """A value of the package in the other unit."""
        return (value - self.offset) / self.factor


def known(unit: str) -> bool:
    """Whether this is the spelling of a unit."""
    return _parsed(unit) is not None


def conversion(unit: str, wanted: str) -> Conversion | None:
    """From a unit to one of the package; None where it is of another kind, or not known."""
    of, to = _parsed(unit), _parsed(wanted)
    if of is None or to is None:
        return None
    registry = _registry()
    if wanted == "N" and of.check("[mass]"):
        return Conversion(float((of * registry.standard_gravity).m_as(to.units)), 0.0)
    if not of.is_compatible_with(to):
        return None
    if (of.check("[]") or _angular(wanted)) and _angular(unit) != _angular(wanted):
        # To pint an angle is a number: a slip of 3 degrees would be one of .05, and a rotation of
        # 1/s, which may be a turn or a radian, one of 1 rad/s.
        return None
    offset = float(registry.Quantity(0.0, of.units).m_as(to.units))
    return Conversion(float(registry.Quantity(1.0, of.units).m_as(to.units)) - offset, offset)


def _angular(unit: str) -> bool:
    parsed = _parsed(unit)
    return parsed is not None and any(
        str(name) in ("radian", "degree", "milliradian", "revolution", "turn")
        for name in parsed.units._units
    )


@cache
def _registry() -> pint.UnitRegistry:
    return pint.UnitRegistry(autoconvert_offset_to_baseunit=False)


@cache
def _parsed(unit: str) -> pint.Quantity | None:
    """One of the unit, without regard to what the unit stands for; None where there is none."""
    text = " ".join(unit.split())
    text = _EXACT.get(text, _SPELLINGS.get(text.lower(), text))
    if re.fullmatch(r"[\d\s.,+-]*", text) or not _WRITTEN.fullmatch(text) or _BOMB.search(text):
        return None
    registry = _registry()
    try:
        return registry.Quantity(1.0, registry.parse_units(text.replace("^", "**")))
    except Exception:  # pint raises errors of many kinds, tokenizer's and its own
        return None


#: Quantities without a dimension that are ratios wherever no unit is given. A slip is not among
#: them, for 1.2 is a possible slip in per cent as well as a possible ratio.
_RATIOS = ("adhesion", "adhesion_sd", "sanding", "driven_axles")

#: Quantities that may be written as a flag, such as on and off: 1 and 0.
FLAGS = ("sanding",)

#: `v [km/h]` and `rH (%)`.
_BRACKETS = re.compile(r"(.*?)\s*[\[(<{]\s*([^\[\](){}<>]*?)\s*[\])>}]\s*")

#: `mu_1`, `mu 1` and `mu1`.
_INDEXED = re.compile(r"(.*?[^\W\d_])[ _.]?(\d{1,2})")


class Named(NamedTuple):
    """The name of a column: what is left of it without the unit, and the unit, empty without."""

    stem: str
    unit: str


class Guess(NamedTuple):
    """What a column may be: a quantity of the package, empty where it is none.

    `question` is what must be asked where the name says something but not enough, a clause such as
    "in which unit column v is"; it is empty where nothing is in doubt. `quantities` are those that
    an answer may name. `number` is that at the end of the name, such as that of an axle or a
    repeat; -1 without one.
    """

    quantity: str
    unit: str
    question: str = ""
    quantities: tuple[str, ...] = ()
    number: int = -1


def named(name: str) -> Named:
    """The parts of a name such as `v [km/h]`, `rH (%)`, `T/°C`, `v_kmh`, `v in km/h`, `v km/h`."""
    bracket = _BRACKETS.fullmatch(name)
    if bracket:
        return Named(bracket[1], bracket[2] or "1")
    ends = _UNITS["ends"]
    # A unit may hold a divider itself, as in `v km/h`: the longest ending that is a unit counts.
    for divider in re.finditer(" in |[/ _]", name):
        stem, ending = name[: divider.start()].strip(), name[divider.end() :].strip()
        if stem and (ending in ends["as_written"] or ending.lower() in ends["in_any_letters"]):
            return Named(stem, ending)
    return Named(name, "")


def guess(name: str, row_of_units: str = "") -> Guess:
    """What a column of this name is; `row_of_units` is what stands under the name, if anything.

    Our own names are believed with the unit that they end in. Other names are taken for a
    quantity where the stem is a synonym of one that the unit goes with, and of no other.
    """
    if name in LABELS:
        return Guess(name, "")
    if name in COLUMNS:
        return Guess(name, row_of_units or COLUMNS[name].unit)
    stem, unit = named(name)
    unit = row_of_units or unit
    # The word for a unit may be a part of the name, as in `wheel rpm`.
    word, number = plain(name if plain(name) in QUANTITIES else stem), -1
    indexed = _INDEXED.fullmatch(stem)
    # A numbered x is any variable: there is one position.
    if indexed and word not in _WORDS and plain(indexed[1]) != "x":
        word, number = plain(indexed[1]), int(indexed[2])
    label = next((label for label, words in LABEL_SYNONYMS.items() if word in words), "")
    if label and not unit and number < 0:
        return Guess(label, "")
    unknown = bool(unit) and not known(unit)
    fits = tuple(one for one in QUANTITIES.get(word, ()) if not unit or unknown or goes(unit, one))
    if len(fits) == 1 and not unknown and (unit or fits[0] in _RATIOS):
        return Guess(fits[0], unit or "1", number=number)
    bodies = UNDECIDED.get(_UNDECIDED.get(word, ""), ())
    fits += tuple(one for one in bodies if not unit or unknown or goes(unit, one))
    if not fits:
        return Guess("", unit)
    question = _question(name, "" if unknown else unit, fits)
    asked = f"{question}; the unit {unit} is unknown" if unknown else question
    return Guess("", unit, asked, fits, number)


def side_by_side(guesses: Mapping[str, Guess]) -> list[str]:
    """The columns in the order of their index, which counts from 0 or 1; none where it does not."""
    by_index = {one.number: name for name, one in guesses.items()}
    first, count = min(by_index), len(guesses)
    whole = first in (0, 1) and max(by_index) == first + count - 1 and len(by_index) == count
    return [by_index[index] for index in sorted(by_index)] if whole and count > 1 else []


def goes(unit: str, quantity: str) -> bool:
    """Whether a quantity can be measured in a unit."""
    return conversion(unit, COLUMNS[quantity].unit) is not None


def instead(unit: str, quantity: str, column: str) -> str:
    """What to write where a column is said to be a quantity that has no such unit."""
    if quantity == "slip_ratio" and goes(unit, "slip_angle_deg"):
        return f'name it slip_angle, as by --column "slip_angle={column} [{unit}]"'
    return f"write one such as {COLUMNS[quantity].unit}"


def plain(name: str) -> str:
    """A name in small letters, with spaces in the place of other divisions."""
    return " ".join(re.sub(r"[\s_.,;:/-]+", " ", name).casefold().split())


def _question(name: str, unit: str, quantities: tuple[str, ...]) -> str:
    if quantities == ("slip_ratio",):
        return (
            f"whether the slip in column {name} is a ratio or in per cent "
            f'(--column "slip={name} [1]" or --column "slip={name} [%]")'
        )
    plains = [COLUMNS[one].plain for one in quantities]
    ending = "" if unit else " [UNIT]"
    answers = " or ".join(f'--column "{one}={name}{ending}"' for one in plains)
    if len(plains) == 1 and quantities != ("wheel_rotation_radps",):
        return f"in which unit the {_words(plains[0])} in column {name} is ({answers})"
    return f"whether column {name} is the {listed([*map(_words, plains)], 'or')} ({answers})"


def _words(name: str) -> str:
    return name.replace("_", " ")


def _quantities() -> Mapping[str, tuple[str, ...]]:
    words: dict[str, tuple[str, ...]] = {}
    for name, column in COLUMNS.items():
        for word in dict.fromkeys(map(plain, (name, column.plain, *column.synonyms))):
            words[word] = (*words.get(word, ()), name)
    return words


#: What a column may be called, in small letters, to the quantities that are called so.
QUANTITIES = _quantities()

_UNDECIDED = {plain(word): kind for kind in UNDECIDED for word in (kind, *UNDECIDED_SYNONYMS[kind])}

#: Every word that is known.
_WORDS = {*QUANTITIES, *_UNDECIDED, *(word for words in LABEL_SYNONYMS.values() for word in words)}
