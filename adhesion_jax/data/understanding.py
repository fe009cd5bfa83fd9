"""Which column of a sheet is which quantity, in which unit: as said, as named, or to be asked."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from adhesion_jax.data.columns import COLUMNS, LABELS, REPEATS_BESIDE, SD_AFTER, UNDECIDED
from adhesion_jax.data.files import Sheet
from adhesion_jax.data.mapping import Said, said
from adhesion_jax.data.naming import Guess, guess, named, plain, repeats
from adhesion_jax.data.stamps import EITHER, ORDERS
from adhesion_jax.data.units import Conversion, conversion
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed

#: Quantities of one body each; a force that is none of them by name is the one to be explained.
_FORCES = (*UNDECIDED["force"], "motor_torque_Nm")


class Taken(NamedTuple):
    """A column of a sheet and what it is taken as: a quantity, or a column of its own name."""

    column: str
    name: str
    unit: str  # as understood; empty for labels, stamps and columns of an unknown unit
    conversion: Conversion = Conversion(1.0, 0.0)
    stamp: str = ""  # the form of dates or times of day
    repeat: int = 0  # from 1 where several columns hold the quantity, of one repeat each
    said: bool = False  # whether the user said its unit

    @property
    def quantity(self) -> str:
        """What it is; its name where it is no quantity of the package."""
        return "adhesion" if self.repeat else self.name


class Question(NamedTuple):
    """What must be asked before a column can be one of these quantities; a clause with the answer.

    The clause is such as "in which unit the vehicle speed in column v is (--column ...)".
    """

    column: str
    clause: str
    quantities: tuple[str, ...]


class Understanding(NamedTuple):
    """Every column that is read, each once; the constants; and what is in doubt."""

    taken: tuple[Taken, ...]
    constants: Mapping[str, float]  # quantity to value in the unit of the package
    questions: tuple[Question, ...]
    left_out: tuple[str, ...]  # columns that may be a force, which is what adhesion explains


def understand(sheet: Sheet, columns: Mapping[str, object]) -> Understanding:
    """What the columns of a sheet are; `columns` is what the user says of them, see `said`."""
    guesses = {name: _guess(sheet, name) for name in sheet.columns}
    side_by_side = repeats(sheet.columns)
    for name in side_by_side:
        # The 1 of mu_1 is an index and no unit; a unit stands in brackets or in the row of units.
        unit = sheet.units.get(name, "") or (named(name).unit if name[-1:] in "])}>" else "")
        guesses[name] = Guess("adhesion", unit or "1")
    told = said(sheet.name, sheet.columns, columns)
    guesses = _by_neighbours(guesses, any(one.quantity == "adhesion_sd" for one in told))
    by_column = {one.column: one for one in told if one.column}
    given = {one.quantity for one in told}
    # In a log, columns with an index are axles, of which the user is asked for one.
    in_time = "time_s" in given or any(one.quantity == "time_s" for one in guesses.values())
    repeat_of: dict[str, int] = {}
    questions: list[Question] = []
    chosen: dict[str, list[str]] = {}
    for name, found in guesses.items():
        if name in by_column or found.quantity in given:
            continue
        if found.quantity:
            chosen.setdefault(found.quantity, []).append(name)
        elif found.question and not given & {*found.quantities}:
            questions.append(Question(name, found.question, found.quantities))
    quantity_of: dict[str, str] = {}
    for quantity, names in chosen.items():
        exact = [name for name in names if name == quantity]
        if {*names} == {*side_by_side} and not in_time:
            repeat_of = {name: number for number, name in enumerate(side_by_side, 1)}
            quantity_of |= dict.fromkeys(names, quantity)
        elif len(exact or names) == 1:
            quantity_of[(exact or names)[0]] = quantity
        else:
            questions.append(_which_column(quantity, names))
    taken = []
    left_out = []
    for name, found in guesses.items():
        if name in by_column:
            taken.append(_as_said(sheet, by_column[name], found))
        elif name in quantity_of:
            one = _taken(sheet, name, quantity_of[name], found.unit)
            repeat = repeat_of.get(name, 0)
            own = f"{one.name} {repeat}" if repeat > 1 else one.name
            taken.append(one._replace(name=own, repeat=repeat))
        elif {found.quantity, *found.quantities} & {*_FORCES}:
            left_out.append(name)
        else:
            # It keeps its name, which may not be that of a quantity that it is not.
            own = f"{name} (as it is)" if name in COLUMNS or name in LABELS else name
            taken.append(Taken(name, own, found.unit))
    return Understanding(
        tuple(taken),
        {one.quantity: one.constant for one in told if one.constant is not None},
        tuple(questions),
        tuple(left_out),
    )


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
            f"{COLUMNS[quantity].plain} (write one such as {COLUMNS[quantity].unit})."
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


def _as_said(sheet: Sheet, one: Said, found: Guess) -> Taken:
    unit = one.unit
    said = bool(unit)
    if not unit and one.quantity not in LABELS and one.column not in sheet.stamps:
        # The header says the unit where the user does not, and a name of ours where neither does.
        wanted = COLUMNS[one.quantity]
        unit = found.unit or (wanted.unit if one.ours else "")
        if not unit:
            raise InputError(
                f"{sheet.name} cannot be used: it is not known in which unit the column "
                f'{one.column} is (write --column "{wanted.plain}={one.column} [UNIT]", with a '
                f"unit such as {wanted.unit})."
            )
    return _taken(sheet, one.column, one.quantity, unit)._replace(said=said)


def _which_column(quantity: str, names: Sequence[str]) -> Question:
    plain = COLUMNS[quantity].plain if quantity in COLUMNS else quantity
    return Question(
        names[0],
        f"which of the columns {listed(names)} is the {plain.replace('_', ' ')} "
        f'(--column "{plain}={names[0]}", say)',
        (quantity,),
    )
