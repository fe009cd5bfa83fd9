"""Experiments 2 and 3 of He et al. 2018: scatter of the estimates, and tracking of a switch."""

from collections.abc import Callable, Iterator, Mapping
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from adhesion_jax.metrics.accuracy import FAILURE_GAP
from adhesion_jax.metrics.information import quantity_names
from adhesion_jax.scenarios import Scenario
from adhesion_jax.scenarios.rails import RAILS, peak_of
from adhesion_jax.wording import plus_minus
from experiments.claims.claim import STANDARD_ERRORS, Claim, Flags, Numbers
from experiments.claims.he2018 import PAPER

#: The two ablations, Experiment 3, and what each is called in a sentence.
VARIANTS = {
    "ml-de-eq16": "Eq. 16 alone",
    "ml-de-eq17": "Eq. 17 alone",
    "ml-de-he2018": "the modified algorithm",
}

_RESAMPLES = 400


class Blocks(NamedTuple):
    """Estimates of each identifier as arrays [runs, blocks], and the rail of each block."""

    rails: tuple[str, ...]
    values: Mapping[str, Mapping[str, Numbers]]
    failed: Mapping[str, Flags]  # the search missed the optimum

    def groups(self, switch: bool) -> list[list[int]]:
        """The blocks of each rail: those right after a switch, or those in steady running.

        The first of all blocks is neither: theta(k-1) is then no estimate but the start.
        """
        chosen = [b for b in range(1, len(self.rails)) if self._begins(b) == switch]
        named = {rail: [b for b in chosen if self.rails[b] == rail] for rail in self.rails}
        return [group for group in named.values() if group]

    def _begins(self, block: int) -> bool:
        return self.rails[block] != self.rails[block - 1]


def as_blocks(rows: pd.DataFrame, scenario: Scenario) -> Blocks:
    """From the estimates of a campaign, one row a run, identifier and block."""
    count = len(scenario.rails)

    def array(identifier: str, column: str) -> Numbers:
        chosen = rows.loc[rows["identifier"] == identifier, column]
        return chosen.to_numpy(dtype=float).reshape(-1, count)

    names = list(dict.fromkeys(rows["identifier"]))
    optimum = array("ml-exact", "objective")
    return Blocks(
        scenario.rails,
        {name: {q: array(name, q) for q in quantity_names(scenario.known.curve)} for name in names},
        {
            name: ~(array(name, "objective") - optimum <= FAILURE_GAP * scenario.noise.sigma**2)
            for name in names
        },
    )


def standard_deviation(x: Numbers) -> float:
    return float(np.std(x, ddof=1))


def robust_deviation(x: Numbers) -> float:
    """The interquartile range, scaled to the standard deviation of a normal distribution."""
    low, high = np.percentile(x, [25, 75])
    return float((high - low) / 1.349)


def with_error(
    statistic: Callable[[NDArray[np.intp]], float], runs: int, random: np.random.Generator
) -> tuple[float, float]:
    """A statistic of the numbers of all runs; its standard error by a bootstrap over whole runs.

    NaN where one of the resamples is infinite.
    """
    resampled = [statistic(random.integers(runs, size=runs)) for _ in range(_RESAMPLES)]
    error = float(np.std(resampled, ddof=1)) if np.isfinite(resampled).all() else float("nan")
    return statistic(np.arange(runs)), error


def scatter_ratio(
    upper: Numbers,
    lower: Numbers,
    groups: list[list[int]],
    scatter: Callable[[Numbers], float],
    random: np.random.Generator,
) -> tuple[float, float]:
    """Scatter of one method over that of another, [runs, blocks] each: geometric mean over rails.

    The runs that are resampled for its standard error are the same for both.
    """

    def ratio(runs: NDArray[np.intp]) -> float:
        logs = [
            np.log(scatter(upper[runs][:, group]) / scatter(lower[runs][:, group]))
            for group in groups
        ]
        return float(np.exp(np.mean(logs)))

    return with_error(ratio, len(upper), random)


def scatter_claims(blocks: Blocks, random: np.random.Generator) -> Iterator[Claim]:
    """The modified algorithm scatters less (Fig. 13 to 17 against 8 to 12)."""
    kinds = {"robust (interquartile)": robust_deviation, "standard deviation": standard_deviation}
    pairs = {"ours": ("ml-de-he2018", "ml-de")}
    pairs |= {"modified": ("ml-de-he2018", "ml-exact"), "original": ("ml-de", "ml-exact")}
    wheres = ("in steady running", "in the block after a switch")
    for (switch, where), quantity, (kind, scatter) in product(
        enumerate(wheres), ("mu_max", "c3"), kinds.items()
    ):
        groups = blocks.groups(bool(switch))
        together = [b for group in groups for b in group]
        missed = {name: 100 * failed[:, together].mean() for name, failed in blocks.failed.items()}
        values = {name: x[quantity] for name, x in blocks.values.items()}
        found = {
            name: scatter_ratio(values[upper], values[lower], groups, scatter, random)
            for name, (upper, lower) in pairs.items()
        }
        facts = {"quantity": quantity, "where": where, "kind": kind, "missed": missed}
        for method in ("modified", "original"):
            facts[method] = plus_minus(*found[method])
            facts[f"{method}_says"] = _against_optimum(*found[method])
        yield PAPER.below("scatter", *found["ours"], len(values["ml-de"]), **facts)


def _against_optimum(ratio: float, error: float) -> str:
    """What a scatter over that of the exact optimum means."""
    if ratio + STANDARD_ERRORS * error < 1:
        return "less than the noise of the data gives: it stops short, near its start"
    if ratio - STANDARD_ERRORS * error > 1:
        return "more: searches that do not arrive add to the noise"
    return "no difference is seen: the noise of the data explains it"


def tracking_claims(tables: Mapping[str, pd.DataFrame], runs: int) -> Iterator[Claim]:
    """The modified algorithm tracks a switch faster: delay, and failures in the first block."""
    for key, table, column, factor in (
        ("tracked_sooner", "summary", "delay_steps", 1.0),
        ("fewer_miss", "switches", "failure_share", 100.0),
    ):
        rows = tables[table]
        rows = rows[(rows["quantity"] == "mu_max") & rows["delay_steps"].notna()]
        means, errors = {}, {}
        for name, of_method in rows.groupby("identifier"):
            # The switches of a run have their own noise: independent of each other.
            means[name] = factor * of_method[column].mean()
            errors[name] = factor * np.sqrt((of_method[f"{column}_se"] ** 2).sum()) / len(of_method)
        written = {name: plus_minus(mean, errors[name]) for name, mean in means.items()}
        others = {"plain": written["ml-de"], "exact": written["ml-exact"]}
        for name, words in VARIANTS.items():
            difference = float(means[name] - means["ml-de"])
            error = float(np.hypot(errors[name], errors["ml-de"]))
            facts = {"name": name, "words": words, "own": written[name], **others}
            yield PAPER.below(key, difference, error, runs, **facts)


def volatility_claims(tables: Mapping[str, pd.DataFrame], runs: int) -> Iterator[Claim]:
    """Experiment 2 block by block: which parameter scatters most, and mu_max from little slip."""
    summary = tables["summary"]
    rows = summary[summary["identifier"] == "ml-de"]
    share, part = rows["rmse"] / rows["truth"], rows["rmse_se"] / rows["rmse"]
    rows = rows.assign(share=share, part=part).set_index("quantity")
    ratios = []
    for rail in ("common", "dry"):
        share, part = (rows.loc[rows["rail"] == rail, name] for name in ("share", "part"))
        other = max(("c1", "c2"), key=share.__getitem__)
        ratio = float(share[other] / share["c3"])
        ratios.append((ratio, ratio * float(np.hypot(part[other], part["c3"]))))
    yield PAPER.below("volatility", *max(ratios), runs)
    known = rows.loc["mu_max"].reset_index()
    off = 100 * known[["rmse", "rmse_se"]].div(known["truth"], axis=0).to_numpy()
    place = int(off[:, 0].argmax())
    (percent, error), rail = map(float, off[place]), known["rail"].iloc[place]
    facts = {"rail": rail, "peak": peak_of(RAILS[rail])[0]}
    yield PAPER.below("missing_data", percent, error, runs, **facts)
