"""`python -m experiments.rules`: in how many campaigns each rule of the discovery decides.

A rule decides in a campaign of `experiments.strangers` if any comparison of its search would turn
out otherwise were the rule half or twice as large. Where none does, the report is the same.
"""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from threadpoolctl import threadpool_limits

from adhesion_jax.command_line.command import run, start
from adhesion_jax.discovery.search import rules
from adhesion_jax.files import write_table
from adhesion_jax.library.discover import discover
from adhesion_jax.report.discovery.words import verdict
from experiments.stranger_sets import stranger
from experiments.strangers import study_of
from experiments.study import conduct, sized

OWN_FILES = ("sets.csv", "rules.csv", "rules.png", "metadata.json")

#: The rules as they are, by name, and what each is multiplied by.
VALUES = {name: value for name, value in vars(rules).items() if name.isupper()}
TIMES = (0.5, 2.0)


class Watched(float):
    """A rule that notes by which of `TIMES` any of its comparisons would turn out otherwise.

    A product of rules is watched for each of them. A use that is no comparison, as of a number of
    candidates, counts as one that turns out otherwise.
    """

    __array_ufunc__ = None  # so that arrays leave products and comparisons to this class

    plain: Any  # the rule itself, whole or not
    note: Callable[[str, float], None]  # called with the name of a rule and the factor
    names: tuple[str, ...]

    @classmethod
    def of(
        cls, value: Any, note: Callable[[str, float], None], names: tuple[str, ...]
    ) -> "Watched":
        one = cls(value)
        one.plain, one.note, one.names = value, note, names
        return one

    def _compared(self, holds: Callable[[Any], Any]) -> Any:
        now = holds(self.plain)
        for times in TIMES:
            if np.any(holds(times * self.plain) != now):
                self._used(times)
        return now

    def _used(self, *times: float) -> None:
        for name in self.names:
            for one in times:
                self.note(name, one)

    def _otherwise(self) -> Any:
        """The number itself, for a use that is no comparison."""
        self._used(*TIMES)
        return self.plain

    def __lt__(self, other: Any) -> Any:
        return self._compared(lambda own: own < _plain(other))

    def __le__(self, other: Any) -> Any:
        return self._compared(lambda own: own <= _plain(other))

    def __gt__(self, other: Any) -> Any:
        return self._compared(lambda own: own > _plain(other))

    def __ge__(self, other: Any) -> Any:
        return self._compared(lambda own: own >= _plain(other))

    def __mul__(self, other: Any) -> Any:
        if isinstance(other, np.ndarray):
            return self._otherwise() * other
        more = other.names if isinstance(other, Watched) else ()
        return Watched.of(self.plain * _plain(other), self.note, (*self.names, *more))

    __rmul__ = __mul__

    def __truediv__(self, other: Any) -> Any:
        return self._otherwise() / other

    def __rtruediv__(self, other: Any) -> Any:
        return other / self._otherwise()

    def __rfloordiv__(self, other: Any) -> Any:
        return other // self._otherwise()

    def __rsub__(self, other: Any) -> Any:
        return other - self._otherwise()

    def __index__(self) -> int:
        return int(self._otherwise())

    def __format__(self, spec: str) -> str:
        return format(self.plain, spec)


def _plain(value: Any) -> Any:
    return value.plain if isinstance(value, Watched) else value


@contextmanager
def replaced(values: Mapping[str, Any]) -> Iterator[None]:
    """Other values of some rules for the time being."""
    for name, value in values.items():
        setattr(rules, name, value)
    try:
        yield
    finally:
        for name in values:
            setattr(rules, name, VALUES[name])


@threadpool_limits.wrap(limits=1)
def one_set(task: tuple[int, int, bool]) -> dict[str, object]:
    """Which rules decide in a campaign, told by seed, number, and whether nothing is hidden."""
    made, noted = stranger(*task), set[tuple[str, float]]()
    watched = {
        name: Watched.of(value, lambda *one: noted.add(one), (name,))
        for name, value in VALUES.items()
    }
    with replaced(watched):
        verdict(discover(made.train, made.test, seed=task[1]).findings)
    decides = {(name, times): (name, times) in noted for name in VALUES for times in TIMES}
    told = {f"{name} x {times:g}": decided for (name, times), decided in decides.items()}
    return {"number": task[1], "causes": len(made.causes), **told}


def table(sets: pd.DataFrame) -> pd.DataFrame:
    """A row for each rule: in how many of the sets it decides where it is halved, and doubled."""
    counts = [[int(sets[f"{name} x {times:g}"].sum()) for times in TIMES] for name in VALUES]
    halved, doubled = zip(*counts, strict=True)
    return pd.DataFrame(
        {
            "rule": [*VALUES],
            "value": [*VALUES.values()],
            "sets": len(sets),
            "halved": halved,
            "doubled": doubled,
        }
    )


def draw(path: Path, counts: pd.DataFrame) -> None:
    """In which share of the sets each rule decides."""
    figure = Figure(figsize=(9, 1.5 + 0.2 * len(counts)), layout="constrained")
    axes = figure.subplots()
    for column, marker in (("halved", "v"), ("doubled", "^")):
        shares = counts[column] / counts["sets"]
        axes.plot(shares, counts["rule"], marker, color="k", fillstyle="none", label=column)
    axes.set(xlabel="share of the campaigns in which a comparison turns out otherwise (1)")
    axes.invert_yaxis()
    axes.margins(y=0.01)
    axes.grid(color="0.9")
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=150)


#: Options that tell how many sets are made: their defaults and help.
SIZES = {"sets": (100, "Sets with a cause."), "nulls": (100, "Sets without one.")}


@sized(SIZES, Path("out/rules"))
def main(sets: int, nulls: int, seed: int, workers: int, resume: bool, out: Path) -> None:
    """Count in how many campaigns each rule of the discovery decides."""
    start()
    study = study_of(one_set, Path(__file__), sets, nulls, seed)
    conduct(study, out, OWN_FILES, workers, resume, written)


def written(sets: pd.DataFrame, folder: Path) -> str:
    """The table of a study, which is written to the folder with its figure."""
    counts = table(sets)
    write_table(folder / "rules.csv", counts)
    draw(folder / "rules.png", counts)
    return str(counts.to_string(index=False))


if __name__ == "__main__":
    run(main)
