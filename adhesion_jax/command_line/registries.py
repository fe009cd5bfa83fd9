"""What the command line must know of the rooms: names, and the options of scenarios."""

from collections.abc import Mapping

from adhesion_jax.campaign.config import MAIN_JOB
from adhesion_jax.command_line.catalogue import Catalogue, Scenario
from adhesion_jax.curves import CURVES
from adhesion_jax.data import SHIPPED
from adhesion_jax.identifiers import ABLATIONS, IDENTIFIERS
from adhesion_jax.measured.following import refusal
from adhesion_jax.options import declared
from adhesion_jax.scenarios import SCENARIOS, build, needs_options
from adhesion_jax.scenarios.rails import RAILS
from adhesion_jax.simulation.plantable import PLANTABLE
from adhesion_jax.traction.controllers import CONTROLLERS
from adhesion_jax.traction.observers import OBSERVERS
from adhesion_jax.traction.plants.reading import shipped
from adhesion_jax.traction.seekers import SEEKERS
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import NO_SEEKER


def told() -> Catalogue:
    """What the registries have now."""
    return Catalogue(
        scenarios={
            name: Scenario((function.__doc__ or "").partition("\n")[0], dict(declared(function)))
            for name, function in SCENARIOS.items()
        },
        main_job=MAIN_JOB,
        identifiers=(*IDENTIFIERS,),
        ablations=(*ABLATIONS,),
        refusals={name: _refusals(name) for name in SCENARIOS if not needs_options(name)},
        not_following=_stated({name: refusal(one) for name, one in IDENTIFIERS.items()}),
        rails=(*RAILS,),
        curves=(*CURVES,),
        effects=(*PLANTABLE,),
        data=(*SHIPPED,),
        systems=(*SYSTEMS,),
        plants=(*shipped(),),
        observers=(*OBSERVERS,),
        seekers=(NO_SEEKER, *SEEKERS),
        controllers=(*CONTROLLERS,),
    )


def _refusals(scenario: str) -> Mapping[str, str]:
    """Why an identifier cannot work on the scenario, by its name; no option changes that."""
    known = build(scenario).known
    return _stated({name: identifier.accepts(known) for name, identifier in IDENTIFIERS.items()})


def _stated(reasons: Mapping[str, str | None]) -> Mapping[str, str]:
    return {name: reason for name, reason in reasons.items() if reason is not None}
