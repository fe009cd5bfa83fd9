"""What a user says of columns: which of them is which quantity, in which unit, or a constant."""

import re
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import NamedTuple

from adhesion_jax.data.columns import COLUMNS, LABELS, UNDECIDED
from adhesion_jax.data.naming import QUANTITIES, goes, instead, named, plain
from adhesion_jax.data.stamps import ORDERS
from adhesion_jax.data.units import conversion, known
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed

#: A constant such as `200 kN`, and a column with its unit such as `v [km/h]`.
_CONSTANT = re.compile(r"([-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?)\s*\[?([^\s\[\]]*)\]?")
_WITH_UNIT = re.compile(r"(.*\S)\s*\[([^\[\]]*)\]")


class Said(NamedTuple):
    """A quantity is in this column in this unit, which is empty where it is not said.

    `constant` is its value in the unit of the package, where it is in no column. `ours` says that
    it was called by its name in the package, which ends in the unit.
    """

    quantity: str
    column: str = ""
    unit: str = ""
    constant: float | None = None
    ours: bool = False
    turned: bool = False  # the sign of the column is the other one


def said(name: str, names: Sequence[str], columns: Mapping[str, object]) -> list[Said]:
    """What `columns` says of a file of this name that has columns of these names.

    A key is a quantity: a name of COLUMNS or LABELS, or what it is called without a unit, such as
    speed. A value is `COLUMN`, `COLUMN [UNIT]`, the same after a minus, which turns the sign, or,
    where there is no such column, `NUMBER UNIT`. InputError in a sentence where it fits neither the
    columns nor the units of the quantity.
    """
    found: list[Said] = []
    for key, value in columns.items():
        one = _said(name, names, _quantity(key), value)._replace(ours=key in COLUMNS)
        for other in found:
            if other.quantity == one.quantity:
                raise InputError(f"{one.quantity} is said to be two things; name one of them.")
            if one.column and other.column == one.column:
                raise InputError(
                    f"The column {one.column} is said to be {other.quantity} and {one.quantity}; "
                    "a column is one quantity."
                )
        found.append(one)
    return found


def _quantity(key: str) -> str:
    word = plain(key)
    if key in COLUMNS or key in LABELS:
        return key
    if word in UNDECIDED:
        raise InputError(
            f"{key} does not tell of which body it is; write "
            f"{listed([COLUMNS[one].plain for one in UNDECIDED[word]], 'or')}."
        )
    quantities = QUANTITIES.get(word, ())
    if len(quantities) != 1:
        plains = [column.plain for column in COLUMNS.values()] + [*LABELS]
        near = get_close_matches(word.replace(" ", "_"), plains, 3, 0.7) or plains
        raise InputError(f"{key} is no quantity that is known; name {listed(near, 'or')}.")
    return quantities[0]


def _said(name: str, names: Sequence[str], quantity: str, value: object) -> Said:
    wanted = f'write a column, as in {quantity} = "v [km/h]", or a constant, as in "200 kN"'
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return _checked(Said(quantity, "", "", _number(quantity, value)))
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{quantity} cannot be {value!r}; {wanted}.")
    text = " ".join(value.split())
    if text in names:
        return _in_column(name, names, Said(quantity, text))
    stem = _WITH_UNIT.fullmatch(text)
    of_names = stem is not None and stem[1] in names
    if text.startswith("-") and not (of_names or _CONSTANT.fullmatch(text) or quantity in LABELS):
        return _said(name, names, quantity, text[1:])._replace(turned=True)
    with_unit, constant = _WITH_UNIT.fullmatch(text), _CONSTANT.fullmatch(text)
    if constant and not (with_unit and with_unit[1] in names):
        return _checked(Said(quantity, "", constant[2], _number(quantity, constant[1])))
    column, unit = (with_unit[1], with_unit[2]) if with_unit else (text, "")
    return _in_column(name, names, Said(quantity, column, unit))


def _number(quantity: str, value: object) -> float:
    if quantity in LABELS:
        raise InputError(f"{quantity} is told by a column of labels, not by a constant.")
    try:
        return float(str(value))
    except ValueError:
        raise InputError(f"{quantity} cannot be {value!r}; write a number and its unit.") from None


def _in_column(name: str, names: Sequence[str], one: Said) -> Said:
    if one.column not in names:
        # A column `v [km/h]` may be called v.
        short = [column for column in names if named(column).stem == one.column]
        if len(short) != 1:
            near = get_close_matches(one.column, names, 3) or names[:12]
            more = " ..." if len(names) > 12 and len(near) == 12 else ""
            plainly = COLUMNS[one.quantity].plain if one.quantity in COLUMNS else one.quantity
            purpose = "to compare by" if one.quantity == "group" else f"to read {plainly} from"
            raise InputError(
                f"{name} has no column {one.column} {purpose}; there "
                f"{'is' if len(near) == 1 else 'are'} {', '.join(near) or 'none'}{more}."
            )
        one = one._replace(column=short[0])
    return _checked(one)


def _checked(one: Said) -> Said:
    """The same, if the unit is one of the quantity; InputError otherwise."""
    if one.quantity in LABELS:
        if one.unit:
            raise InputError(f"{one.quantity} is a label and has no unit; leave {one.unit} out.")
        return one
    if one.quantity == "time_s" and one.unit in ORDERS:
        return one
    wanted = COLUMNS[one.quantity]
    what = f"column {one.column}" if one.column else f"{one.quantity} = {one.constant:g}"
    if one.unit and not known(one.unit):
        raise InputError(
            f"The unit {one.unit} of {what} is not known; write a unit of {wanted.plain}, such "
            f"as {wanted.unit}."
        )
    if one.unit and not goes(one.unit, one.quantity):
        raise InputError(
            f"The unit {one.unit} of {what} is no unit of {wanted.plain}; "
            f"{instead(one.unit, one.quantity, one.column)}."
        )
    if one.constant is None:
        return one
    to = conversion(one.unit or "1", wanted.unit)
    if to is None:
        raise InputError(f"{what} needs its unit; write one such as {wanted.unit} after it.")
    value = to.of(one.constant)
    if not wanted.lower <= value <= wanted.upper:
        raise InputError(
            f"{one.quantity} = {value:g} {wanted.unit} lies outside {wanted.span}; {wanted.advice}."
        )
    return one._replace(constant=value)
