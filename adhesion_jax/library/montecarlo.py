"""`montecarlo`: how well methods know the truth of a scenario, one's own methods among them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from adhesion_jax.campaign.config import Config, choose_identifiers
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.effects.saved import law_text
from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import IDENTIFIERS, Identifier
from adhesion_jax.report.montecarlo.tables import accuracy_table
from adhesion_jax.runtime import as_in_commands, silent
from adhesion_jax.scenarios import SCENARIOS, Options, build, declared
from adhesion_jax.wording import listed


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarlo:
    """How well methods know the truth of a scenario, over all runs.

    `tables` holds, by name, what the command writes as files: summary, and where a scenario has
    them switches, checkpoints, tracking, steady and bands.
    """

    tables: Mapping[str, pd.DataFrame]
    estimates: pd.DataFrame  # a row for each run, identifier and block

    @property
    def summary(self) -> pd.DataFrame:
        """A row for each rail, identifier and quantity: truth, bias, RMSE, bound, coverage ..."""
        return self.tables["summary"]

    def __repr__(self) -> str:
        return accuracy_table(self.summary, _quantities(self.summary))

    def _repr_html_(self) -> str:
        return self.summary.to_html(index=False)


@as_in_commands
def montecarlo(
    scenario: str = "single",
    identifiers: str | Sequence[str] | Mapping[str, Identifier] | None = None,
    runs: int = 256,
    seed: int = 0,
    workers: int = 1,
    **options: object,
) -> MonteCarlo:
    """Identify the same noisy runs of a scenario by several methods.

    `scenario` is a name of SCENARIOS, and `options` are its arguments (rail, sigma, points ...;
    `law` is a law that was found, or the path of a saved one). `identifiers` are names of
    IDENTIFIERS, or methods of your own by name; without any, all that accept the scenario. Run r of
    a seed has the same noise whatever else is asked for. With more `workers` than one the runs are
    shared among processes, which a script must start under `if __name__ == "__main__":`.
    InputError where a name, a number or an option does not fit.
    """
    given = _options(scenario, options)
    if runs < 1 or workers < 1 or not 0 <= seed < 2**32:
        raise InputError("runs and workers are 1 or more, and a seed is from 0 to 2**32 - 1.")
    methods, names = _methods(identifiers)
    config = Config(scenario, names, given, int(runs), int(seed))
    _refuse_unsuited(config, methods)
    estimates: list[pd.DataFrame] = []
    campaign = run_campaign(config, estimates.append, silent, workers, methods)
    return MonteCarlo(campaign.tables, pd.concat(estimates, ignore_index=True))


def _methods(
    identifiers: str | Sequence[str] | Mapping[str, Identifier] | None,
) -> tuple[Mapping[str, Identifier], tuple[str, ...]]:
    """Every method that may be run, by its name, and the names of those that are asked for."""
    if identifiers is None:
        return IDENTIFIERS, ()
    if isinstance(identifiers, Mapping):
        taken = [n for n, own in identifiers.items() if IDENTIFIERS.get(n, own) is not own]
        if taken:
            raise InputError(
                f"{listed(taken)} is the name of a method of the package; name yours otherwise."
            )
        return {**IDENTIFIERS, **identifiers}, tuple(identifiers)
    names = (identifiers,) if isinstance(identifiers, str) else tuple(identifiers)
    unknown = [name for name in names if name not in IDENTIFIERS]
    if unknown:
        raise InputError(
            f"There is no identifier {listed(unknown)}; the identifiers are "
            f"{', '.join(IDENTIFIERS)}, and one of your own is given by name: {{'mine': Mine()}}."
        )
    return IDENTIFIERS, names


def _refuse_unsuited(config: Config, methods: Mapping[str, Identifier]) -> None:
    """InputError where a method that is asked for does not accept the scenario."""
    scenario = build(config.scenario, config.options)
    for name in config.identifiers:
        reason = methods[name].accepts(scenario.known)
        if reason is not None:
            raise InputError(f"{name} cannot be run on {config.scenario}: {reason}.")
    choose_identifiers(config, scenario, methods)


def _options(scenario: str, options: Mapping[str, object]) -> Options:
    """The arguments of a scenario; InputError where it takes none such."""
    if scenario not in SCENARIOS:
        raise InputError(
            f"There is no scenario {scenario}; the scenarios are {', '.join(SCENARIOS)}."
        )
    known = declared(SCENARIOS[scenario])
    needed = [name for name, one in known.items() if one.required and name not in options]
    if needed:
        raise InputError(f"The scenario {scenario} needs {listed(needed)}.")
    strange = [name for name in options if name not in known]
    if strange:
        raise InputError(f"{scenario} takes {listed([*known])}, but not {listed(strange)}.")
    return Options(**{name: _option(name, known[name], value) for name, value in options.items()})


def _option(name: str, one: Any, value: object) -> object:
    """The value of an option as a scenario takes it; InputError where it lies outside its range."""
    if one.option.is_file:
        return _law_text(name, value)
    if one.kind is str:
        return str(value)
    low, high = one.option.low, one.option.high
    try:
        number = one.kind(value)
        right = number == value and math.isfinite(number)
    except (TypeError, ValueError, OverflowError):
        right = False
    above = right and (low is None or number > low or (number == low and not one.option.low_open))
    below = right and (
        high is None or number < high or (number == high and not one.option.high_open)
    )
    if not (above and below):
        kind = "a whole number" if one.kind is int else "a number"
        ends = " ".join(
            f"{word} {end:g}" for word, end in (("from", low), ("to", high)) if end is not None
        )
        raise InputError(f"{name} is {kind} {ends}, not {value!r}.")
    return number


def _law_text(name: str, value: object) -> str:
    if isinstance(value, CorrectedLaw):
        return law_text(value)
    try:
        return Path(str(value)).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        raise InputError(f"{name} {value} cannot be read; give a law or the path of one.") from None


def _quantities(summary: pd.DataFrame) -> tuple[str, ...]:
    there = tuple(dict.fromkeys(summary["quantity"]))
    return ("mu_max",) if "mu_max" in there else there
