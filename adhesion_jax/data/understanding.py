"""Which column of a sheet is which quantity, in which unit: as said, as named, or to be asked."""

import re
from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from itertools import pairwise
from typing import NamedTuple

from adhesion_jax.data.cells import EITHER, ORDERS
from adhesion_jax.data.columns import (
    COLUMNS,
    GROUP,
    LABELS,
    QUANTITIES,
    REPEATS_BESIDE,
    SD_AFTER,
    UNDECIDED,
    Conversion,
    Guess,
    conversion,
    goes,
    guess,
    instead,
    known,
    named,
    plain,
    side_by_side,
)
from adhesion_jax.data.files import Sheet
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed

#: A constant such as `200 kN`, and a column with its unit such as `v [km/h]`.
_CONSTANT = re.compile(r"([-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?)\s*\[?([^\s\[\]]*)\]?")
_WITH_UNIT = re.compile(r"(.*\S)\s*\[([^\[\]]*)\]")


#: Quantities of one body each; a force that is none of them by name is the one to be explained.
_FORCES = (*UNDECIDED["force"], "motor_torque_Nm")

#: What each axle has of its own, and from which slip and adhesion come.
_OF_AN_AXLE = (
    *("wheel_speed_mps", "wheel_rotation_radps", "slip_ratio", "slip_velocity_mps", "adhesion"),
    *(*_FORCES, *UNDECIDED["load"]),
)

#: Columns of results, which a further column of a file may not be taken for.
_OF_RESULTS = ("before", "after", "error", "slip")

#: How many answers to a question are written out.
_ANSWERS = 6


class Taken(NamedTuple):
    """A column of a sheet and what it is taken as: a quantity, or a column of its own name."""

    column: str
    name: str
    unit: str  # as understood; empty for labels, stamps and columns of an unknown unit
    conversion: Conversion = Conversion(1.0, 0.0)
    stamp: str = ""  # the form of dates or times of day
    copy: int = 0  # from 1 where several columns hold the quantity, of one repeat or axle each
    said: bool = False  # whether the user said its unit

    @property
    def quantity(self) -> str:
        """What it is; its name where it is no quantity of the package."""
        return self.name.rpartition(" ")[0] if self.copy > 1 else self.name


class Understanding(NamedTuple):
    """Every column that is read, each once; the constants; and what is in doubt."""

    taken: tuple[Taken, ...]
    constants: Mapping[str, float]  # quantity to value in the unit of the package
    questions: Mapping[str, Guess]  # by the column that must be told of before it can be used
    left_out: tuple[str, ...]  # columns that may be a force, which is what adhesion explains
    copies: str  # the label that tells copies apart, run for repeats and axle; empty without any


def understand(sheet: Sheet, columns: Mapping[str, object], axles: bool = False) -> Understanding:
    """What the columns of a sheet are; `columns` is what the user says of them.

    A key is a quantity: a name of COLUMNS or LABELS, or what it is called without a unit, such as
    speed. A value is `COLUMN`, `COLUMN [UNIT]`, the same after a minus, which turns the sign, or,
    where there is no such column, `NUMBER UNIT`. `axles` says that columns with an index are those
    of axles. InputError where what is said fits neither the columns nor the units of the quantity.
    """
    given = [_quantity(key) for key in columns]
    guesses = {name: _guess(sheet, name) for name in sheet.columns}
    guesses = _by_neighbours(guesses, "adhesion_sd" in given)
    told, constants = _told(sheet, guesses, given, columns)
    # What groups go by may be a quantity as well.
    by_column = {name: one for name, one in told.items() if one.name != GROUP}
    questions: dict[str, Guess] = {}
    chosen: dict[str, dict[str, Guess]] = {}
    for name, found in guesses.items():
        if name in by_column or found.quantity in given:
            continue
        if found.quantity:
            chosen.setdefault(found.quantity, {})[name] = found
        elif found.question and not {*given} & {*found.quantities}:
            questions[name] = found
    one_axle = any(guesses[name].number >= 0 for name in by_column)
    in_time = "time_s" in given or any(one.quantity == "time_s" for one in guesses.values())
    of_quantity, asked, copies = _one_each(chosen, one_axle, in_time, axles)
    taken = []
    left_out = []
    for name, found in guesses.items():
        if name in by_column:
            taken.append(by_column[name])
        elif name in of_quantity:
            quantity, copy = of_quantity[name]
            one = _taken(sheet, name, quantity, found.unit)
            own = f"{one.name} {copy}" if copy > 1 else one.name
            taken.append(one._replace(name=own, copy=copy))
        elif {found.quantity, *found.quantities} & {*_FORCES}:
            left_out.append(name)
        else:
            # It keeps its name, which may not be that of a quantity that it is not.
            ours = name in COLUMNS or name in LABELS or name in _OF_RESULTS
            own = f"{name} (as it is)" if ours else name
            taken.append(Taken(name, own, found.unit))
    taken += [one for one in told.values() if one.name == GROUP]
    return Understanding(
        tuple(taken),
        constants,
        questions | asked,
        tuple(left_out),
        copies if any(one.copy for one in taken) else "",
    )


def _told(
    sheet: Sheet,
    guesses: Mapping[str, Guess],
    given: Sequence[str],
    columns: Mapping[str, object],
) -> tuple[dict[str, Taken], dict[str, float]]:
    """What the user says of columns, by the column, and the constants by the quantity.

    `given` are the quantities of the keys of `columns`.
    """
    twice = next((one for one in given if given.count(one) > 1), None)
    if twice is not None:
        raise InputError(f"{twice} is said to be two things; name one of them.")
    told: dict[str, Taken] = {}
    constants: dict[str, float] = {}
    for quantity, (key, value) in zip(given, columns.items(), strict=True):
        one = _said(sheet, guesses, quantity, value, key in COLUMNS)
        if isinstance(one, float):
            constants[quantity] = one
            continue
        other = told.setdefault(one.column, one)
        if other is not one:
            raise InputError(
                f"The column {one.column} is said to be {other.name} and {quantity}; a column is "
                "one quantity."
            )
    return told, constants


def _one_each(
    chosen: Mapping[str, Mapping[str, Guess]], one_axle: bool, in_time: bool, axles: bool
) -> tuple[dict[str, tuple[str, int]], dict[str, Guess], str]:
    """The columns of each quantity that several may hold: one of them, copies, or a question.

    `chosen` are the columns by quantity. Returns the quantity and the number of the copy by column,
    from 1 and 0 where there is one column; the questions by the first column; the label of copies.
    """
    of_quantity: dict[str, tuple[str, int]] = {}
    families: dict[str, list[str]] = {}
    for quantity, of_it in chosen.items():
        exact = [name for name in of_it if name == quantity]
        if len(exact or of_it) == 1:
            of_quantity[(exact or [*of_it])[0]] = quantity, 0
        else:
            families[quantity] = [] if exact else side_by_side(of_it)
    copies = _copies(families, in_time and not one_axle, axles)
    count = max((len(families[one]) for one in families if copies), default=0)
    questions: dict[str, Guess] = {}
    for quantity, names in families.items():
        if copies and len(names) == count and (quantity == "adhesion" or copies == "axle"):
            of_quantity |= {name: (quantity, i) for i, name in enumerate(names, 1)}
        else:
            asked = _which_column(quantity, chosen[quantity], bool(names) and in_time)
            questions[next(iter(chosen[quantity]))] = asked
    return of_quantity, questions, copies


def _quantity(key: str) -> str:
    word = plain(key)
    if key in COLUMNS or key in LABELS:
        return key
    for name, column in COLUMNS.items():
        if word == plain(column.plain):
            return name
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


def _said(
    sheet: Sheet, guesses: Mapping[str, Guess], quantity: str, value: object, ours: bool
) -> Taken | float:
    """The column that a quantity is said to be, or the constant in the unit of the package.

    Where no unit is said the header says it, or a name of `ours`, which ends in the unit.
    """
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return _constant(quantity, float(str(value)), "")
    if not isinstance(value, str) or not value.strip():
        raise InputError(
            f'{quantity} cannot be {value!r}; write a column, as in {quantity} = "v [km/h]", or a '
            'constant, as in "200 kN".'
        )
    text = " ".join(value.split())
    with_unit, constant = _WITH_UNIT.fullmatch(text), _CONSTANT.fullmatch(text)
    column, unit = (with_unit[1], with_unit[2]) if with_unit else (text, "")
    if text in sheet.columns:
        column, unit = text, ""
    elif column not in sheet.columns:
        if text.startswith("-") and not (constant or quantity in LABELS):
            found = _said(sheet, guesses, quantity, text[1:], ours)
            if isinstance(found, float):
                return found
            to = found.conversion
            return found._replace(conversion=Conversion(-to.factor, -to.offset))
        if constant:
            return _constant(quantity, float(constant[1]), constant[2])
        column = _called(sheet, column, quantity)
    if quantity in LABELS and unit:
        raise InputError(f"{quantity} is a label and has no unit; leave {unit} out.")
    said = bool(unit)
    if said and not (quantity == "time_s" and unit in ORDERS):
        _check_unit(unit, quantity, f"column {column}", column)
    if not said and quantity not in LABELS and column not in sheet.stamps:
        unit = guesses[column].unit or (COLUMNS[quantity].unit if ours else "")
        if not unit:
            wanted = COLUMNS[quantity]
            raise InputError(
                f"{sheet.name} cannot be used: it is not known in which unit the column "
                f'{column} is (write --column "{wanted.plain}={column} [UNIT]", with a '
                f"unit such as {wanted.unit})."
            )
    return _taken(sheet, column, quantity, unit)._replace(said=said)


def _called(sheet: Sheet, column: str, quantity: str) -> str:
    """The column of this name, which `v [km/h]` has where it is called v."""
    short = [name for name in sheet.columns if named(name).stem == column]
    if len(short) == 1:
        return short[0]
    plainly = COLUMNS[quantity].plain if quantity in COLUMNS else quantity
    purpose = "to compare by" if quantity == GROUP else f"to read {plainly} from"
    raise no_column(sheet.name, f"{column} {purpose}", column, sheet.columns)


def no_column(name: str, wanted: str, column: str, there: Sequence[str]) -> InputError:
    """What is said where a table lacks the column that is `wanted`, with those of like names."""
    near = get_close_matches(column, there, 3) or there[:12]
    more = " ..." if len(there) > 12 and len(near) == 12 else ""
    return InputError(
        f"{name} has no column {wanted}; there {'is' if len(near) == 1 else 'are'} "
        f"{', '.join(near) or 'none'}{more}."
    )


def _check_unit(unit: str, quantity: str, what: str, column: str) -> None:
    wanted = COLUMNS[quantity]
    if not known(unit):
        raise InputError(
            f"The unit {unit} of {what} is not known; write a unit of {wanted.plain}, such "
            f"as {wanted.unit}."
        )
    if not goes(unit, quantity):
        raise InputError(
            f"The unit {unit} of {what} is no unit of {wanted.plain}; "
            f"{instead(unit, quantity, column)}."
        )


def _constant(quantity: str, number: float, unit: str) -> float:
    if quantity in LABELS:
        raise InputError(f"{quantity} is told by a column of labels, not by a constant.")
    wanted, what = COLUMNS[quantity], f"{quantity} = {number:g}"
    if unit:
        _check_unit(unit, quantity, what, "")
    to = conversion(unit or "1", wanted.unit)
    if to is None:
        raise InputError(f"{what} needs its unit; write one such as {wanted.unit} after it.")
    value = to.of(number)
    if not wanted.lower <= value <= wanted.upper:
        raise InputError(
            f"{quantity} = {value:g} {wanted.unit} lies outside {wanted.span}; {wanted.advice}."
        )
    return value


def _copies(families: Mapping[str, Sequence[str]], log: bool, axles: bool) -> str:
    """What columns of one quantity with an index are: repeats (run), axles, or not known.

    In a log they are axles where two quantities have as many; without a time, those of the
    adhesion alone are repeats. `axles` says that they are axles.
    """
    counts = [len(names) for one, names in families.items() if names and one in _OF_AN_AXLE]
    if axles or (log and len(counts) > 1 and len({*counts}) == 1):
        return "axle"
    return "run" if not log and families.get("adhesion") else ""


def _by_neighbours(guesses: Mapping[str, Guess], with_sd: bool) -> dict[str, Guess]:
    """The same with what neighbours tell: a standard deviation, and the number of its repeats.

    `std` says of what only where it follows the adhesion, and `n` counts repeats only where there
    is a standard deviation (`with_sd` where the user named one); elsewhere it may be a rotation.
    """
    found = dict(guesses)
    names = [*found]
    for before, name in pairwise(names):
        stem, unit = named(name)
        if found[before].quantity == "adhesion" and plain(stem) in SD_AFTER:
            found[name] = Guess("adhesion_sd", unit or found[before].unit)
    if with_sd or any(one.quantity == "adhesion_sd" for one in found.values()):
        counts = [name for name in names if plain(name) in REPEATS_BESIDE]
        if len(counts) == 1:
            found[counts[0]] = Guess("repeats", "1")
    return found


def _guess(sheet: Sheet, name: str) -> Guess:
    found = guess(name, sheet.units.get(name, ""))
    if name not in sheet.stamps:
        return found
    # A stamp is a time whatever it is called, and has no unit.
    return Guess(found.quantity if found.quantity in LABELS else "time_s", "")


def _taken(sheet: Sheet, name: str, quantity: str, unit: str) -> Taken:
    if quantity in LABELS:
        return Taken(name, quantity, "")
    if name in sheet.stamps and quantity == "time_s":
        return Taken(name, quantity, "", stamp=_ordered(sheet, name, unit))
    if unit in ORDERS:
        raise InputError(
            f"{sheet.name} cannot be used: the column {name} is said to hold dates of {unit}, but "
            "its first rows hold none."
        )
    found = conversion(unit, COLUMNS[quantity].unit)
    if found is None:
        raise InputError(
            f"{sheet.name} cannot be used: the column {name} is in {unit}, which is no unit of "
            f"{COLUMNS[quantity].plain} ({instead(unit, quantity, name)})."
        )
    return Taken(name, quantity, unit, found)


def _ordered(sheet: Sheet, name: str, said: str) -> str:
    """The form of the stamps of a column, with what is said of the order of day and month."""
    form = sheet.stamps[name]
    if said in ORDERS and form.startswith(EITHER):
        return form.replace(EITHER, said)
    if said in ORDERS and not form.startswith(said):
        raise InputError(
            f"{sheet.name} cannot be used: the column {name} is said to hold dates of {said}, but "
            f"its first rows have the form {form}."
        )
    if form.startswith(EITHER):
        answers = listed([f'--column "time={name} [{order}]"' for order in ORDERS], "or")
        raise InputError(
            f"{sheet.name} cannot be used: its first rows do not tell whether the dates in column "
            f"{name} are {EITHER} (please say so by {answers})."
        )
    return form


def _which_column(quantity: str, columns: Iterable[str], axles: bool) -> Guess:
    """What is asked where several columns may be a quantity: an answer for each, to be copied."""
    names = [*columns]
    plain = COLUMNS[quantity].plain if quantity in COLUMNS else quantity
    answers = [f'--column "{plain}={name}"' for name in names[:_ANSWERS]]
    if len(names) > _ANSWERS:
        answers.append("and so on")
    if axles:
        answers.append("--axles for all of them as axles")
    which = f"which of the columns {listed(names)} is the {plain.replace('_', ' ')}"
    return Guess("", "", f"{which} ({listed(answers, 'or')})", (quantity,))
