"""A folder of files, or a pattern of their names, as one log."""

import glob
import os
import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import pyarrow

from adhesion_jax.data.files import ENDINGS, WANTED, Block, Sheet, sheet_of_file
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed

#: The column that says of which file a row is.
FILE = "file"


def sheet_of(path: Path) -> Sheet:
    """A file as a sheet; or all files of a folder or of a pattern, one below the other.

    They are in the order of their names, run 2 before run 10, and a column `file` tells them apart.
    InputError where their columns do not agree.
    """
    is_folder = os.path.isdir(path)
    if not is_folder and (os.path.exists(path) or not glob.has_magic(str(path))):
        return sheet_of_file(path)
    found = glob.glob(f"{glob.escape(str(path))}/*" if is_folder else str(path))
    paths = [Path(one) for one in found if one.lower().endswith(ENDINGS) and os.path.isfile(one)]
    if not paths:
        raise InputError(f"{path} has no file that can be read; {WANTED}.")
    paths.sort(key=_in_order)
    if len(paths) == 1:
        return sheet_of_file(paths[0])
    return _one_below_the_other(path, paths, [sheet_of_file(one) for one in paths])


def _in_order(path: Path) -> list[tuple[int, str]]:
    """A name as texts and numbers."""
    return [
        (int(one), "") if one.isdecimal() else (0, one) for one in re.split(r"(\d+)", f"{path}")
    ]


def _one_below_the_other(path: Path, paths: Sequence[Path], sheets: Sequence[Sheet]) -> Sheet:
    first = sheets[0]
    for other in sheets[1:]:
        apart = sorted({*first.columns} ^ {*other.columns})
        if apart:
            reason = f"one of them alone has {listed(apart[:5])}{' ...' if apart[5:] else ''}"
        elif first.units != other.units:
            reason = "their rows of units differ"
        elif first.stamps != other.stamps:
            reason = "they write dates in different forms"
        elif {first.mark, other.mark} == {".", ","}:
            reason = "one has decimal points and the other decimal commas"
        else:
            continue
        raise InputError(
            f"{path} is not one log: the columns of {first.name} and {other.name} do not agree "
            f"({reason}); name files of the same columns."
        )
    above = os.path.commonpath([one.parent for one in paths])
    names = [Path(os.path.relpath(one, above)).as_posix() for one in paths]

    def blocks() -> Iterator[tuple[Block, float]]:
        for place, sheet in enumerate(sheets):
            for block, share in sheet.blocks():
                rows = len(next(iter(block.values()), ()))
                # A column of that name which the files have themselves stays theirs.
                yield (
                    {FILE: pyarrow.repeat(names[place], rows), **block},
                    (place + share) / len(sheets),
                )

    return first._replace(
        name=str(path),
        columns=tuple(dict.fromkeys((*first.columns, FILE))),
        mark=next((one.mark for one in sheets if one.mark), None),
        format=f"{len(sheets)} parts, {paths[0].name} to {paths[-1].name}, whose rows are counted "
        f"one after the other{f', and {first.format}' if first.format else ''}",
        blocks=blocks,
    )
