"""`python -m experiments.rules`: what each number that the discovery decides by does to its report.

Each is halved and doubled by itself, on campaigns of `experiments.strangers`.
"""

from collections.abc import Callable, Iterator
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
from experiments import stranger_sets, strangers
from experiments.stranger_sets import Stranger, stranger
from experiments.strangers import WORSE, names_of
from experiments.study import Study, conduct, sized

OWN_FILES = ("sets.csv", "rules.csv", "rules.png", "metadata.json")

#: The rules as they are, by name, and what each is multiplied by.
VALUES = {name: value for name, value in vars(rules).items() if name.isupper()}
TIMES = (0.5, 2.0)

#: A rule and what it is multiplied by.
Variant = tuple[str, float]


class Watched(float):
    """A rule that notes by which of `TIMES` any of its comparisons would turn out otherwise.

    A product of rules is watched for each of them. What is not a comparison counts as one that
    turns out otherwise.
    """

    __array_ufunc__ = None  # so that arrays leave products and comparisons to this class

    def __new__(cls, value: float, note: Callable[[str, float], None], *names: str) -> "Watched":
        return super().__new__(cls, value)

    def __init__(self, value: float, note: Callable[[str, float], None], *names: str) -> None:
        self.plain, self.note, self.names = value, note, names

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

    def _otherwise(self) -> float:
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
        return Watched(self.plain * float(other), self.note, *self.names, *more)

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
def _as_rules(**values: float) -> Iterator[None]:
    """Other values of some rules for the time being; whole numbers stay so, and at least one."""
    for name, value in values.items():
        setattr(rules, name, value)
    try:
        yield
    finally:
        for name in values:
            setattr(rules, name, VALUES[name])


def _times(name: str, times: float) -> float:
    value = VALUES[name]
    return max(round(times * value), 1) if isinstance(value, int) else times * value


@threadpool_limits.wrap(limits=1)
def one_set(task: tuple[int, int, bool]) -> dict[str, object]:
    """What is reported of a campaign with the rules as they are, and with those changed that matter.

    Left out, and empty in the table, is what no comparison of the search depends on.
    """
    made, noted = stranger(*task), set[Variant]()
    watched = {
        name: Watched(value, lambda *one: noted.add(one), name) for name, value in VALUES.items()
    }
    with _as_rules(**watched):
        found = {"": _report(made, task[1])}
    for name, times in sorted(noted):
        with _as_rules(**{name: _times(name, times)}):
            found[f"{name} x {times:g} "] = _report(made, task[1])
    every = ["", *(f"{name} x {times:g} " for name in VALUES for times in TIMES)]
    nothing = dict.fromkeys(found[""])
    told = {
        variant + what: value
        for variant in every
        for what, value in found.get(variant, nothing).items()
    }
    return {"number": task[1], "causes": len(made.causes), **told}


def _report(made: Stranger, number: int) -> dict[str, object]:
    """Of a report what is right and wrong, the error on the test, and its sentences."""
    found = discover(made.train, made.test, seed=number).findings
    reported = (*found.effects, *found.unexplained)
    told = [names for names in map(names_of, reported) if not names & {*made.harmless}]
    right = {name for cause in made.causes for name in cause}
    measured = (proposal.measurement for proposal in found.proposals)
    assert found.test is not None
    return {
        "named": sum(any({*cause} & names for names in told) for cause in made.causes),
        "wrong": sum(not names & right for names in told),
        "after": found.test.after.value,
        "words": " ".join([verdict(found), *found.warnings, *found.confounded, *measured]),
    }


def table(sets: pd.DataFrame) -> pd.DataFrame:
    """A row for each rule and what it is multiplied by: in how many sets it changes what.

    `decides` counts the sets in which a comparison would turn out otherwise, `named` and `wrong`
    how many columns more are named and wrongly named in all sets, `better` and `worse` the sets
    whose error on the test falls or grows by more than 2 %, and `words` those whose report changes.
    """
    rows = []
    for name, value in VALUES.items():
        for times in TIMES:
            own = {
                what: sets[f"{name} x {times:g} {what}"]
                for what in ("named", "wrong", "after", "words")
            }
            there = own["after"].notna()
            ratio = own["after"] / sets["after"]
            rows.append(
                {
                    "rule": name,
                    "value": value,
                    "times": times,
                    "decides": int(there.sum()),
                    "words": int((own["words"] != sets["words"])[there].sum()),
                    "named": int((own["named"] - sets["named"])[there].sum()),
                    "wrong": int((own["wrong"] - sets["wrong"])[there].sum()),
                    "better": int((ratio < 1 / WORSE).sum()),
                    "worse": int((ratio > WORSE).sum()),
                }
            )
    return pd.DataFrame(rows)


def draw(path: Path, counts: pd.DataFrame, sets: int) -> None:
    """In how many of the sets the error and the report change, for each rule."""
    figure = Figure(figsize=(10, 2 + 0.2 * len(VALUES)), layout="constrained")
    for axes, (times, own) in zip(figure.subplots(1, 2, sharey=True), counts.groupby("times")):
        for what, color in (("decides", "0.85"), ("words", "0.6")):
            axes.barh(own["rule"], own[what], color=color, label=_SHOWN[what])
        both = own["better"] + own["worse"]
        axes.barh(own["rule"], both, color="k", height=0.4, label=_SHOWN["both"])
        axes.set(title=f"rule x {times:g}", xlabel="number of campaigns (1)", xlim=(0, sets))
        axes.grid(axis="x", color="0.9")
    axes.invert_yaxis()
    axes.legend(loc="lower right")
    figure.savefig(path, dpi=150)


_SHOWN = {
    "decides": "a comparison turns out otherwise",
    "words": "the report changes",
    "both": "the error on the test changes by over 2 %",
}

#: Options that tell how many sets are made: their defaults and help.
SIZES = {"sets": (40, "Sets with a cause."), "nulls": (20, "Sets without one.")}


@sized(SIZES, Path("out/rules"))
def main(sets: int, nulls: int, seed: int, workers: int, resume: bool, out: Path) -> None:
    """Halve and double each rule of the discovery, and count what changes."""
    start()
    tasks = [(seed, n, True) for n in range(nulls)] + [(seed, n, False) for n in range(sets)]
    sizes = {"sets": sets, "nulls": nulls, "seed": seed}
    source = [Path(module.__file__ or "") for module in (strangers, stranger_sets)]
    study = Study(tasks, one_set, sizes, {}, [Path(__file__), *source])
    conduct(study, out, OWN_FILES, workers, resume, written)


def written(sets: pd.DataFrame, folder: Path) -> str:
    """The table of a study, which is written to the folder with its figure."""
    counts = table(sets)
    write_table(folder / "rules.csv", counts)
    draw(folder / "rules.png", counts, len(sets))
    return str(counts.to_string(index=False))


if __name__ == "__main__":
    run(main)
