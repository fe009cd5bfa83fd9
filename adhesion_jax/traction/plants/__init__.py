"""Plants: one model a file, and sets of their parameters, which are TOML files."""

from collections.abc import Mapping

from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.plants.elastic_axles import ElasticAxles
from adhesion_jax.traction.plants.rigid_axles import RigidAxles
from adhesion_jax.traction.plants.twisting_axles import TwistingAxles

MODELS: Mapping[str, type[Plant]] = {
    "elastic-axles": ElasticAxles,
    "rigid-axles": RigidAxles,
    "twisting-axles": TwistingAxles,
}
