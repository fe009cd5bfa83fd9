"""Units as users write them, and the factor and offset to those of the package, by pint."""

import re
import tomllib
from functools import cache
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
import pint

Values = TypeVar("Values", float, np.ndarray)

_TOLD = tomllib.loads(Path(__file__).with_name("units.toml").read_text(encoding="utf-8"))


def _spelled(kind: str) -> dict[str, str]:
    """Spellings of units to the form that pint knows."""
    return {one: unit for unit, spellings in _TOLD[kind].items() for one in spellings}


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


def at_the_end(word: str) -> bool:
    """Whether a word at the end of a name, such as the kmh of v_kmh, is a unit."""
    ends = _TOLD["ends"]
    return word in ends["as_written"] or word.lower() in ends["in_any_letters"]


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
