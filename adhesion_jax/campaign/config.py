"""What a Monte Carlo campaign is asked for: the command line, checked."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import ABLATIONS, IDENTIFIERS, Identifier
from adhesion_jax.scenarios import SCENARIOS, Options, Scenario


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
    return SCENARIOS[config.scenario](config.options)


def choose_identifiers(
    config: Config, scenario: Scenario, identifiers: Mapping[str, Identifier] = IDENTIFIERS
) -> tuple[str, ...]:
    """The names to run, in the order of the registry or of the command line."""
    if not config.identifiers:
        return tuple(
            name
            for name, identifier in identifiers.items()
            if name not in ABLATIONS and identifier.accepts(scenario) is None
        )
    for name in config.identifiers:
        if name not in identifiers:
            raise InputError(
                f"--identifiers {name} is unknown; the identifiers are {', '.join(identifiers)}."
            )
        reason = identifiers[name].accepts(scenario)
        if reason is not None:
            raise InputError(
                f"--identifiers {name} does not go with --scenario {config.scenario}: {reason}."
            )
    return tuple(dict.fromkeys(config.identifiers))
