"""What the command line must know of the rooms: names, and the options of scenarios."""

from collections.abc import Mapping

from adhesion_jax.campaign.config import MAIN_JOB
from adhesion_jax.curves import CURVES
from adhesion_jax.data import SHIPPED
from adhesion_jax.identifiers import ABLATIONS, IDENTIFIERS
from adhesion_jax.options import declared
from adhesion_jax.scenarios import SCENARIOS
from adhesion_jax.scenarios.rails import RAILS
from adhesion_jax.simulation.plantable import PLANTABLE
from adhesion_jax.studies.peers.methods import PEERS
from adhesion_jax.studies.peers.summary import THIS
from adhesion_jax.traction.controllers import CONTROLLERS
from adhesion_jax.traction.observers import OBSERVERS
from adhesion_jax.traction.plants.reading import shipped
from adhesion_jax.traction.seekers import SEEKERS
from adhesion_jax.traction.systems import SYSTEMS
from adhesion_jax.traction.systems.base import NO_SEEKER


def names() -> Mapping[str, object]:
    """The fields of `command_line.catalogue.Catalogue`, in what JSON can hold."""
    scenarios = {
        name: {
            "words": (build.__doc__ or "").partition("\n")[0],
            "options": {
                key: {
                    "kind": one.kind.__name__,
                    "required": one.required,
                    "option": one.option._asdict(),
                }
                for key, one in declared(build).items()
            },
        }
        for name, build in SCENARIOS.items()
    }
    return {
        "scenarios": scenarios,
        "main_job": [*MAIN_JOB],
        "identifiers": [*IDENTIFIERS],
        "ablations": [*ABLATIONS],
        "rails": [*RAILS],
        "curves": [*CURVES],
        "effects": [*PLANTABLE],
        "data": [*SHIPPED],
        "systems": [*SYSTEMS],
        "plants": [*shipped()],
        "observers": [*OBSERVERS],
        "seekers": [NO_SEEKER, *SEEKERS],
        "controllers": [*CONTROLLERS],
        "peers": [THIS, *PEERS],
    }
