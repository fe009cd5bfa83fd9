"""What the name of a column says: the quantity and the unit, where exactly one of each fits."""

import re
from collections.abc import Mapping
from typing import NamedTuple

from adhesion_jax.data.columns import (
    COLUMNS,
    LABEL_SYNONYMS,
    LABELS,
    UNDECIDED,
    UNDECIDED_SYNONYMS,
)
from adhesion_jax.data.units import at_the_end, conversion, known
from adhesion_jax.wording import listed

#: Quantities without a dimension that are ratios wherever no unit is given. A slip is not among
#: them, for 1.2 is a possible slip in per cent as well as a possible ratio.
_RATIOS = ("adhesion", "adhesion_sd", "sanding", "driven_axles")

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
    # A unit may hold a divider itself, as in `v km/h`: the longest ending that is a unit counts.
    for divider in re.finditer(" in |[/ _]", name):
        stem, ending = name[: divider.start()].strip(), name[divider.end() :].strip()
        if stem and at_the_end(ending):
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
    word, number = plain(stem), -1
    indexed = _INDEXED.fullmatch(stem)
    if indexed and word not in _WORDS:
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
