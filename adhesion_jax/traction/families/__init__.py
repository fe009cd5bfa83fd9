"""Families of rails that are drawn at random, by name."""

from collections.abc import Mapping

from adhesion_jax.traction.families.base import Family
from adhesion_jax.traction.families.by_segment import (
    AxleRails,
    ExponentialRails,
    NoMaximumRails,
    PolachRails,
    SplitRails,
    TwoMaximaRails,
)
from adhesion_jax.traction.families.changing import FilmRails, PatchRails, SlowRails, SpeedRails

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
