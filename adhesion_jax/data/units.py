"""Units as users write them, and the factor and offset to those of the package, by pint."""

import re
from functools import cache
from typing import NamedTuple

import pint

#: Spellings that pint does not know, or takes for something else, in the form that it knows.
_SPELLINGS = {
    "1": "dimensionless",
    "-": "dimensionless",
    "%": "percent",
    "pct": "percent",
    "prozent": "percent",
    "perc": "percent",
    "‰": "permille",
    "promille": "permille",
    "kmh": "km/h",
    "kph": "km/h",
    "kmph": "km/h",
    "km_h": "km/h",
    "mph": "mile/hour",
    "mps": "m/s",
    "m_s": "m/s",
    "°c": "degC",
    "degc": "degC",
    "grad c": "degC",
    "degree c": "degC",
    "celsius": "degC",
    "°f": "degF",
    "kelvin": "kelvin",
    "°": "degree",
    "deg": "degree",
    "grad": "degree",
    "t": "metric_ton",
    "to": "metric_ton",
    "u/min": "revolution/minute",
    "1/min": "revolution/minute",
    "min-1": "revolution/minute",
    "min^-1": "revolution/minute",
    "rpm": "revolution/minute",
    "radps": "rad/s",
    "rad_s": "rad/s",
    "mps2": "m/s^2",
    "m/s2": "m/s^2",
    "m/s²": "m/s^2",
    "g": "standard_gravity",
    "rf": "percent",
    "% rf": "percent",
    "%rh": "percent",
    "% rh": "percent",
    "sek": "s",
    "sec": "s",
    "std": "hour",
    "h": "hour",
    "µs": "us",
    "μs": "us",
    "per_m": "1/m",
    "per_km": "1/km",
    "knm": "kilonewton*meter",
}

#: Units whose small and capital letters mean the same as written here and nothing else; they may
#: stand at the end of a name, as in v_kmh, where any other letters might be a part of the name.
_AT_THE_END = frozenset(
    [
        "kmh",
        "km/h",
        "kph",
        "kmph",
        "mph",
        "mps",
        "m/s",
        "N",
        "kN",
        "MN",
        "Nm",
        "kNm",
        "kg",
        "t",
        "rpm",
        "radps",
        "rad/s",
        "pct",
        "%",
        "percent",
        "prozent",
        "degC",
        "°C",
        "C",
        "K",
        "deg",
        "°",
        "rad",
        "mrad",
        "mps2",
        "m/s2",
        "m/s²",
        "m/s^2",
        "s",
        "ms",
        "us",
        "µs",
        "min",
        "h",
        "m",
        "km",
        "mm",
        "1/m",
        "1/km",
        "per_m",
        "u/min",
        "1/min",
        "min-1",
    ]
)


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


def known(unit: str) -> bool:
    """Whether this is the spelling of a unit."""
    return _parsed(unit) is not None


def at_the_end(word: str) -> bool:
    """Whether a word at the end of a name, such as the kmh of v_kmh, is a unit."""
    return word in _AT_THE_END or word.lower() in ("kmh", "kn", "kph", "pct", "rpm", "degc")


def conversion(unit: str, wanted: str) -> Conversion | None:
    """From a unit to one of the package; None where it is of another kind, or not known."""
    of, to = _parsed(unit), _parsed(wanted)
    if of is None or to is None:
        return None
    registry = _registry()
    if not of.is_compatible_with(to):
        weighed = of * registry.standard_gravity if wanted == "N" else of
        if not weighed.is_compatible_with(to):
            return None
        return Conversion(float(weighed.m_as(to.units)), 0.0)
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
    spelled = {"C": "degC", "K": "kelvin", "N": "newton", "kN": "kilonewton", "MN": "meganewton"}
    # To pint Nm is a unit of yarn, and nm is one of length.
    spelled["Nm"] = "newton*meter"
    text = spelled.get(text, _SPELLINGS.get(text.lower(), text))
    if re.fullmatch(r"[\d\s.,+-]*", text) or not _WRITTEN.fullmatch(text) or _BOMB.search(text):
        return None
    registry = _registry()
    try:
        return registry.Quantity(1.0, registry.parse_units(text.replace("^", "**")))
    except Exception:  # pint raises errors of many kinds, tokenizer's and its own
        return None
