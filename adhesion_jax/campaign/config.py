"""What a Monte Carlo campaign is asked for: the command line, checked."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import ABLATIONS, IDENTIFIERS, Identifier
from adhesion_jax.options import check_accepted
from adhesion_jax.scenarios import SCENARIOS, Options, Scenario, build, needs_options

#: What runs when no scenario is named: curves identified block by block, and a stream.
MAIN_JOB = ("he2018-blocks", "qian2024-switch")

#: What stands for all scenarios: those that need no option and ask for the peak. A sequence that
#: grows is left out, as it is a block of each of its lengths.
ALL = "all"
_NOT_IN_ALL = ("he2018-1", "qian2024", "fang2018-slope")

#: What runs for a name that is none of one scenario.
SEVERAL: Mapping[str | None, tuple[str, ...]] = {
    None: MAIN_JOB,
    ALL: tuple(n for n in SCENARIOS if n not in _NOT_IN_ALL and not needs_options(n)),
}


@dataclass(frozen=True)
class Config:
    """One campaign. Without identifiers: all that accept the scenario, ablations left out."""

    scenario: str = "he2018-blocks"
    identifiers: tuple[str, ...] = ()
    options: Options = field(default_factory=Options)
    runs: int = 1000
    seed: int = 0


def build_scenario(config: Config) -> Scenario:
    """The scenario with the user's options; an InputError where they do not fit it."""
    if config.scenario not in SCENARIOS:
        raise InputError(
            f"--scenario {config.scenario} is unknown; the scenarios are {', '.join(SCENARIOS)}."
        )
    return build(config.scenario, config.options)


def choose_identifiers(
    config: Config, scenario: Scenario, identifiers: Mapping[str, Identifier] = IDENTIFIERS
) -> tuple[str, ...]:
    """The names to run, in the order of the registry or of the command line."""
    if not config.identifiers:
        return tuple(
            name
            for name, identifier in identifiers.items()
            if name not in ABLATIONS and identifier.accepts(scenario.known) is None
        )
    _refuse_unknown(config, identifiers)
    for name in config.identifiers:
        check_accepted(name, config.scenario, identifiers[name].accepts(scenario.known))
    return tuple(dict.fromkeys(config.identifiers))


def parts_of(config: Config, scenarios: Sequence[str]) -> list[Config]:
    """The configurations of those scenarios that take the options and identifiers of `config`.

    Scenarios that do not support one of the options are skipped, and so are identifiers that a
    scenario rejects. InputError if nothing remains.
    """
    _refuse_unknown(config, IDENTIFIERS)
    parts, refusals = [], []
    for scenario in scenarios:
        part = dataclasses.replace(config, scenario=scenario)
        try:
            built = build_scenario(part)
            if config.identifiers:
                suited = [
                    n for n in config.identifiers if IDENTIFIERS[n].accepts(built.known) is None
                ]
                part = dataclasses.replace(part, identifiers=tuple(suited) or config.identifiers)
            choose_identifiers(part, built)
        except InputError as refusal:
            refusals.append(refusal)
        else:
            parts.append(part)
    chosen = {name for part in parts for name in part.identifiers}
    left = [name for name in config.identifiers if name not in chosen]
    if not parts:
        raise refusals[0]
    if left:
        raise InputError(
            f"--identifiers {', '.join(left)} does not go with what is left of the scenarios "
            f"({' and '.join(part.scenario for part in parts)}); name a --scenario."
        )
    return parts


def _refuse_unknown(config: Config, identifiers: Mapping[str, Identifier]) -> None:
    for name in config.identifiers:
        if name not in identifiers:
            raise InputError(
                f"--identifiers {name} is unknown; the identifiers are {', '.join(identifiers)}."
            )
