"""`python -m experiments.strangers`: how often the discovery is right on campaigns of strangers."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from threadpoolctl import threadpool_limits

from adhesion_jax.command_line.command import run, start
from adhesion_jax.discovery.findings.cautions import AHEAD
from adhesion_jax.discovery.types import Findings, FoundEffect, Interval
from adhesion_jax.files import write_table
from adhesion_jax.library.discover import discover
from experiments import stranger_sets
from experiments.stranger_sets import LABELS, Stranger, stranger
from experiments.study import Group, Study, conduct, rates_of, removed_share, sized, spread

OWN_FILES = ("sets.csv", "rates.csv", "shares.csv", "strangers.png", "metadata.json")
#: A test error that grows by more than this factor is made worse; a share of the removable error
#: that is smaller than that of the trees by more than this is behind them.
WORSE, BEHIND = 1.02, 0.05
#: Columns of the findings: the curve without effects.
_PLAIN = ["slip", "before"]
#: The methods of which the share removed is told, and their columns.
METHODS = {
    "discovery": "share",
    "corrected": "share corrected",
    "trees": "share of trees",
    "least squares": "share of lines",
}
QUANTITIES = (
    "claimed",
    "named",
    "wrong beside",
    "made worse",
    "behind trees",
    "behind trees, untold",
    "trees told",
    "error foretold",
    "size covered",
)
OF_NULLS = ("claimed", "made worse", "trees told", "error foretold")


@threadpool_limits.wrap(limits=1)
def one_set(task: tuple[int, int, bool]) -> dict[str, object]:
    """What is hidden in a campaign, what is reported, the errors on its test, and the seconds.

    The campaign is told by seed, number, and whether nothing is hidden in it.
    """
    made, number = stranger(*task), task[1]
    began, cpu = time.perf_counter(), time.process_time()
    found = discover(made.train, made.test, seed=number, correct=True).findings
    seconds, cpu_seconds = time.perf_counter() - began, time.process_time() - cpu
    assert found.test is not None
    reported = (*found.effects, *found.unexplained)
    told = [names for names in map(names_of, reported) if not names & {*made.harmless}]
    right = {name for cause in made.causes for name in cause}
    before, after = found.test.before.value, found.test.after.value
    by_trees, by_lines = _peers_rms(made, found)
    corrected = found.with_trees.after.value if found.with_trees else after
    sizes = _sizes(made, reported)
    removed = {
        column: removed_share(before, error, made.test_noise) if made.causes else np.nan
        for column, error in zip(
            METHODS.values(), (after, corrected, by_trees, by_lines), strict=True
        )
    }
    behind = removed["share"] < removed["share of trees"] - BEHIND
    beside = found.beside_trees.after.value if found.beside_trees else after
    ahead = found.opinion is not None or beside**2 <= (1 - AHEAD) * after**2
    told_of = ("base", "layout", "noise", "effect", "sigma", "run_scatter", "strength")
    return {name: getattr(made, name) for name in (*told_of, "test_gap", "test_noise")} | {
        "number": number,
        "hidden": "+".join(cause[0] for cause in made.causes),
        "reported": "|".join(effect.name for effect in reported),
        "p": "|".join(f"{effect.p_adjusted:.2g}" for effect in reported),
        "causes": len(made.causes),
        "claimed": len(told) > 0,
        "named": sum(any({*cause} & names for names in told) for cause in made.causes),
        "wrong beside": any(not names & right for names in told),
        "made worse": after > WORSE * before,
        "behind trees": behind,
        "behind trees, untold": behind and not ahead,
        "trees told": ahead,
        "error foretold": _foretold(found.validation.after, found.test.after),
        "sizes": len(sizes),
        "size covered": sum(sizes),
        "before": before,
        "after": after,
        "trees": by_trees,
        **removed,
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
    }


def _foretold(validation: Interval, test: Interval) -> bool:
    """Whether the errors on runs left out and on the test differ by no more than their intervals.

    Both are independent, so that their distances to the ends that face each other add in squares.
    """
    first, other = sorted((validation, test))
    least = np.hypot(first.high - first.value, other.value - other.low)
    return bool(other.value - first.value <= least)


def _sizes(made: Stranger, effects: Sequence[FoundEffect]) -> list[bool]:
    """Of each line of a cause that is reported alone, whether its interval holds the true slope.

    Where the level changes by 1 + a line of each cause that is that of the law mu exp(sum of k z)
    next to it, by least squares of mu. Nothing else has a slope.
    """
    if made.effect not in ("two weak", "designed"):
        return []
    names = [cause[0] for cause in made.causes]
    z = StandardScaler().fit_transform(made.train[names])
    weight = np.abs(made.train["adhesion"].to_numpy())
    line = LinearRegression().fit(z, np.log1p(made.change), weight**2)
    slopes = dict(zip(names, line.coef_, strict=True))
    found = {
        effect.covariates[0]: effect.parameters["k"]
        for effect in effects
        if effect.name.startswith("covariate:") and effect.acts_on == "level"
        if {*effect.parameters} == {"k"}
    }
    return [
        bool(one.low <= slopes[name] <= one.high) for name, one in found.items() if name in slopes
    ]


def names_of(effect: FoundEffect) -> Set[str]:
    """The names of a reported effect and of its class, and the columns that they blame."""
    names = {effect.name, *effect.candidates}
    columns = {column for name in names for column in name.partition(":")[2].split("*") if column}
    return names | columns | {*effect.covariates}


def _peers_rms(made: Stranger, found: Findings) -> tuple[float, float]:
    """The test errors of two fits to what the same plain curve leaves.

    Boosted trees, and plain least squares on a line of each column and a level of each label.
    """
    texts = [name for name in LABELS if made.train.get(name, pd.Series()).dtype == "str"]
    kinds = {name: pd.CategoricalDtype(sorted({*made.train[name]})) for name in texts}
    train, test = (
        table.drop(columns=["run", "adhesion"]).astype(kinds) for table in (made.train, made.test)
    )
    assert found.predictions is not None
    points = found.points.sort_values("slip")
    left = made.train["adhesion"] - np.interp(
        made.train["slip_ratio"], *points[_PLAIN].T.to_numpy()
    )
    base = found.predictions["base"].to_numpy()
    trees = HistGradientBoostingRegressor(random_state=0).fit(train, left).predict(test)
    lines = make_pipeline(StandardScaler(), LinearRegression())
    lines = lines.fit(pd.get_dummies(train), left).predict(pd.get_dummies(test))
    errors = (made.test["adhesion"] - base - more for more in (trees, lines))
    by_trees, by_lines = (float(np.sqrt(np.mean(error**2))) for error in errors)
    return by_trees, by_lines


def _groups(sets: pd.DataFrame) -> Iterator[tuple[str, str, pd.DataFrame]]:
    """Null sets and those with a cause: all, and by what they are made of."""
    names = [".5 to 1 sigma", "1 to 1.5 sigma", "1.5 to 2 sigma"]
    sets = sets.assign(strength=pd.cut(sets["strength"], [0.4, 1, 1.5, 2.1], labels=names))
    for part, same in (("nothing", sets["causes"] == 0), ("a cause", sets["causes"] > 0)):
        own = sets[same]
        if len(own):
            yield part, "all", own
        by_cause = ("effect", "strength") if part == "a cause" else ()
        for by in ("base", "layout", "noise", "run_scatter", *by_cause):
            for value, group in own.groupby(by, observed=True):
                yield part, f"{by} {value}", group


def rates(sets: pd.DataFrame) -> pd.DataFrame:
    """Shares of sets, of causes (`named`) or of slopes, with their 95 % intervals, Wilson 1927."""
    return rates_of(_counted(sets), ("hidden", "group"), "wilson")


def _counted(sets: pd.DataFrame) -> Iterator[Group]:
    for part, group, own in _groups(sets):
        counts = {name: len(own) for name in (OF_NULLS if part == "nothing" else QUANTITIES[1:])}
        if part == "a cause":
            counts |= {"named": int(own["causes"].sum()), "size covered": int(own["sizes"].sum())}
        yield (part, group), {name: (int(own[name].sum()), n) for name, n in counts.items()}


def shares(sets: pd.DataFrame) -> pd.DataFrame:
    """Quantiles over the sets of the share of the removable squared error that is removed."""
    rows = [
        (group, method, *spread(own[column]))
        for part, group, own in _groups(sets)
        if part == "a cause"
        for method, column in METHODS.items()
    ]
    return pd.DataFrame(rows, columns=["group", "method", "sets", "median", "quartile", "decile"])


def text(sets: pd.DataFrame) -> str:
    """The rates and shares for a terminal: a row for each group."""
    table, removed = rates(sets), shares(sets)
    table["cell"] = [f"{t.hits}/{t.count} [{t.low:.2f}, {t.high:.2f}]" for t in table.itertuples()]
    removed["cell"] = [
        f"{t.median:.2f} {t.quartile:.2f} {t.decile:.2f}" for t in removed.itertuples()
    ]
    lines = [
        "Sets, causes (`named`) or slopes (`size covered`), and their share with its 95 % interval"
    ]
    for hidden, part in table.groupby("hidden", sort=False):
        lines += ["", f"hidden: {hidden}", _wide(part, "quantity")]
    if len(removed):
        lines += ["", "share of the removable squared error removed: median, quartile, decile"]
        lines += [_wide(removed, "method")]
    seconds, cpu = sets["seconds"], sets["cpu_seconds"]
    lines += ["", f"seconds a set: median {seconds.median():.1f}, largest {seconds.max():.1f}"]
    return "\n".join([*lines, f"CPU seconds a set: median {cpu.median():.1f}"])


def _wide(table: pd.DataFrame, columns: str) -> str:
    """The cells of a table, a row for each group."""
    wide = table.pivot_table("cell", "group", columns, aggfunc="first", sort=False)
    return str(wide.rename_axis(columns=None, index=None).to_string())


def draw(path: Path, sets: pd.DataFrame) -> None:
    """False claims on null sets by group, and the shares removed in order of their size."""
    table, caused = rates(sets), sets[sets["causes"] > 0]
    nulls = table[(table["hidden"] == "nothing") & (table["quantity"] == "claimed")]
    figure = Figure(figsize=(11, 2 + 0.22 * max(len(nulls), 12)), layout="constrained")
    left, right = figure.subplots(1, 2)
    spread = np.stack([nulls["rate"] - nulls["low"], nulls["high"] - nulls["rate"]])
    names = [f"{row.group} ({row.count})" for row in nulls.itertuples(index=False)]
    left.errorbar(nulls["rate"], names, xerr=spread.clip(0), fmt="o", color="k", capsize=2)
    left.axvline(0.02, color="0.5", linestyle="--", label=".02")
    left.set(xlabel="share of the sets with nothing hidden\nin which a cause is claimed (1)")
    left.invert_yaxis()
    for (method, column), style in zip(METHODS.items(), ("k-", "k-.", "C1--", "C0:"), strict=True):
        ordered = np.sort(caused[column].dropna()).clip(-0.3, None)
        below = (np.arange(ordered.size) + 0.5) / max(ordered.size, 1)
        right.plot(ordered, below, style, label=method)
    right.set(
        xlim=(-0.33, 1.05), ylim=(0, 1), ylabel="share of the sets with a cause that stay below (1)"
    )
    right.set(xlabel="share of the removable squared error removed (1)\nleft edge: -.3 or less")
    for axes in (left, right):
        axes.grid(color="0.9")
        axes.legend(frameon=False)
    figure.savefig(path, dpi=150)


#: Options that tell how many sets are made: their defaults and help.
SIZES = {"sets": (200, "Sets with a cause."), "nulls": (400, "Sets without one.")}


@sized(SIZES, Path("out/strangers"))
def main(sets: int, nulls: int, seed: int, workers: int, resume: bool, out: Path) -> None:
    """Run the discovery on campaigns of a generator that shares no code with it."""
    start()
    study = study_of(one_set, Path(__file__), sets, nulls, seed)
    conduct(study, out, OWN_FILES, workers, resume, written)


def study_of(
    row: Callable[[tuple[int, int, bool]], Mapping[str, object]],
    source: Path,
    sets: int,
    nulls: int,
    seed: int,
) -> Study:
    """A study of campaigns of strangers: first those without a cause, then those with one."""
    tasks = [(seed, n, True) for n in range(nulls)] + [(seed, n, False) for n in range(sets)]
    sizes = {"sets": sets, "nulls": nulls, "seed": seed}
    return Study(tasks, row, sizes, {}, [source, Path(stranger_sets.__file__)])


def written(sets: pd.DataFrame, folder: Path) -> str:
    """The words of a study, whose tables and figure are written to the folder."""
    write_table(folder / "rates.csv", rates(sets))
    write_table(folder / "shares.csv", shares(sets))
    draw(folder / "strangers.png", sets)
    return text(sets)


if __name__ == "__main__":
    run(main)
