"""Observers by name, those of a kind in a file."""

from collections.abc import Mapping

from adhesion_jax.traction.observers.base import Observer
from adhesion_jax.traction.observers.full_dimension import FullDimension, TrueLoad
from adhesion_jax.traction.observers.kalman import Kalman
from adhesion_jax.traction.observers.sliding_modes import SuperTwisting, TerminalSliding

#: Those that may be named, set for a sample of 1 ms and noise of .02 rad/s and 5 mm/s.
OBSERVERS: Mapping[str, Observer] = {
    "full-dimension": FullDimension(),
    "super-twisting": SuperTwisting(),
    "terminal-sliding": TerminalSliding(),
    "kalman": Kalman(),
    "true-load": TrueLoad(),
}
