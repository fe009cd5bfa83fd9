"""Laws with effects as files: names and numbers in JSON."""

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import Any

import equinox as eqx
import numpy as np

from adhesion_jax.curves import BASES, Curve, Law, Parameter
from adhesion_jax.curves.bent import Bent
from adhesion_jax.effects import KINDS, Labels, kind_of
from adhesion_jax.effects.conditions import Calendar
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.errors import InputError

#: Format number of the files of a discovery; a file without one is of format 1.
FORMAT = 5

#: The first format with the present formula of each effect that has changed, or with its place
#: among others: saved values of an earlier one would give other adhesions.
_CHANGED = {"covariate": 2, "interaction": 5}
_CHANGED |= dict.fromkeys(("spline", "surface"), 3)
_CHANGED |= dict.fromkeys(("contact_heating", "cleaning", "torque_offset"), 4)

#: The calendar of a law that does not know of time.
NO_TIME = Calendar("run_order", 0.0, 1.0)


def save_law(
    path: str | PathLike[str], law: Law, labels: Mapping[str, Sequence[str]] = MappingProxyType({})
) -> None:
    """Write a law, or a curve with its departure or without, as JSON: names and numbers.

    Args:
        path: the file.
        law: what `discover` found, or the curve of `identify`.
        labels: by column, what its numbers from 0 on stand for.
    """
    Path(path).write_text(law_text(law, labels), encoding="utf-8")


def law_text(law: Law, labels: Mapping[str, Sequence[str]] = MappingProxyType({})) -> str:
    """A law as JSON, with the labels of the columns that its effects know by numbers."""
    if not isinstance(law, CorrectedLaw):
        law = CorrectedLaw(law, (), {}, NO_TIME)
    bent = law.curve if isinstance(law.curve, Bent) else None
    curve = law.curve if bent is None else bent.curve
    assert isinstance(curve, Curve)
    name = next(name for name, known in BASES.items() if type(known) is type(curve))
    told = {
        "format": FORMAT,
        "curve": {"name": name, **_fields(curve)},
        **({} if bent is None else {"departure": _fields(bent, "curve")}),
        "effects": [{"name": kind_of(effect), **_fields(effect)} for effect in law.effects],
        "ranges": dict(law.ranges),
        "calendar": law.calendar._asdict(),
        "slip": law.slip,
    }
    columns = [effect.column for effect in law.effects if isinstance(effect, Labels)]
    if known := {name: [*labels[name]] for name in columns if name in labels}:
        told["labels"] = known
    return json.dumps(told, indent=2) + "\n"


def load_law(path: str | PathLike[str]) -> CorrectedLaw:
    """The law saved in a file.

    Args:
        path: the file, as `save_law` or a command has written it.

    Returns:
        The law, a function of slip and conditions.

    Raises:
        InputError: the file holds no law.
    """
    try:
        return law_from(Path(path).read_text(encoding="utf-8"), str(path))
    except OSError as error:
        raise InputError(f"{path} cannot be read ({error.strerror}); name a law.json.") from None
    except UnicodeDecodeError:
        raise _no_law(str(path)) from None


def law_from(text: str, source: str) -> CorrectedLaw:
    """The law saved as this text; InputError, which names the source, if the text holds none."""
    try:
        saved = json.loads(text)
        _check_format(saved, source)
        curve, effects = dict(saved["curve"]), [dict(effect) for effect in saved["effects"]]
        known, free = type(BASES[curve.pop("name")]), tuple(curve.pop("free"))
        if not free or not {*free} <= {*known.PARAMETERS}:
            raise ValueError
        kinds = [KINDS[effect.pop("name")] for effect in effects]
        alone = known(**_numbers(known.PARAMETERS, curve), free=free)
        base = _bent(alone, **saved["departure"]) if "departure" in saved else alone
        column, start, end = (saved["calendar"][name] for name in Calendar._fields)
        return CorrectedLaw(
            base,
            tuple(
                kind(**_numbers(kind.FACTS.parameters, effect))
                for kind, effect in zip(kinds, effects, strict=True)
            ),
            {name: _range(*ends) for name, ends in saved["ranges"].items()},
            Calendar(str(column), *_range(start, end)),
            str(saved.get("slip", "slip_ratio")),
        )
    except InputError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise _no_law(source) from None


def _bent(
    curve: Curve,
    factors: list[float],
    reach: float,
    largest: float,
    braking: list[float] | None = None,
) -> Bent:
    """The curve with its departure; a ValueError for numbers that no departure has."""
    rows = np.array([factors] if braking is None else [factors, braking], float)
    ends = np.array([reach, largest], float)
    finite = np.all(np.isfinite(rows)) and np.all(np.isfinite(ends))
    if rows.ndim != 2 or rows.size == 0 or not finite or ends.min() <= 0:
        raise ValueError
    return Bent(curve, rows[0], *ends.tolist(), *rows[1:])


def _check_format(saved: Mapping[str, Any], source: str) -> None:
    """Raises InputError if this version would read the law with another meaning."""
    written = saved.get("format", 1)
    if written > FORMAT:
        raise InputError(
            f"{source} is a law of format {written}, and this version reads up to {FORMAT}; "
            "use the version that saved it, or a newer one."
        )
    names = [effect["name"] for effect in saved["effects"]]
    changed = [name for name in names if name not in KINDS or written < _CHANGED.get(name, 1)]
    if changed:
        raise InputError(
            f"{source} is a law of format {written} with {' and '.join(changed)}, which this "
            "version does not know, or has with another formula or place among the others; find "
            "the effects again with adhesion discover of this version."
        )


def _no_law(source: str) -> InputError:
    return InputError(f"{source} is not a law saved by adhesion discover; name its law.json.")


def _numbers(parameters: Mapping[str, Parameter], fields: dict[str, Any]) -> dict[str, Any]:
    """The fields; a parameter is finite, for Python's JSON accepts NaN, and a width not zero."""
    for name in parameters.keys() & fields.keys():
        positive = parameters[name].lower > 0
        if not math.isfinite(fields[name]) or (positive and not fields[name] > 0):
            raise ValueError
    return fields


def _range(low: float, high: float) -> tuple[float, float]:
    """Two finite numbers in order."""
    if not -math.inf < low <= high < math.inf:
        raise ValueError
    return float(low), float(high)


def _fields(module: eqx.Module, *without: str) -> dict[str, object]:
    """Words, lists and numbers by the names of the fields, but for those `without` or with none."""
    fields = {field.name: getattr(module, field.name) for field in dataclasses.fields(module)}
    return {
        name: value if isinstance(value, str | tuple) else np.asarray(value, float).tolist()
        for name, value in fields.items()
        if name not in without and value is not None
    }
