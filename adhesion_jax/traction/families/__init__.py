"""Families of rails that are drawn at random, by name: one family a file."""

from collections.abc import Mapping

from adhesion_jax.traction.families.axles import AxleRails
from adhesion_jax.traction.families.base import Family
from adhesion_jax.traction.families.exponential import ExponentialRails
from adhesion_jax.traction.families.film import FilmRails
from adhesion_jax.traction.families.no_maximum import NoMaximumRails
from adhesion_jax.traction.families.patches import PatchRails
from adhesion_jax.traction.families.polach import PolachRails
from adhesion_jax.traction.families.slow import SlowRails
from adhesion_jax.traction.families.speed import SpeedRails
from adhesion_jax.traction.families.split import SplitRails
from adhesion_jax.traction.families.two_maxima import TwoMaximaRails

#: The first is the nominal one.
FAMILIES: Mapping[str, Family] = {
    "exponential": ExponentialRails(),
    "polach": PolachRails(),
    "speed": SpeedRails(),
    "slow": SlowRails(),
    "patches": PatchRails(),
    "no-maximum": NoMaximumRails(),
    "two-maxima": TwoMaximaRails(),
    "film": FilmRails(),
    "split": SplitRails(),
    "axles": AxleRails(),
}
