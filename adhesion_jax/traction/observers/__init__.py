"""Observers by name: one method a file."""

from collections.abc import Mapping

from adhesion_jax.traction.observers.base import Observer
from adhesion_jax.traction.observers.full_dimension import FullDimension, TrueLoad
from adhesion_jax.traction.observers.kalman import Kalman
from adhesion_jax.traction.observers.sliding_modes import SuperTwisting, TerminalSliding

#: Those that may be named, with settings for a sample of 1 ms and noise of .02 rad/s and 5 mm/s.
OBSERVERS: Mapping[str, Observer] = {
    "full-dimension": FullDimension(pole=-233.0),
    "super-twisting": SuperTwisting(gain=400.0),
    "terminal-sliding": TerminalSliding(surface_gain=100.0, rate_gain=50.0, switching_gain=4e4),
    "kalman": Kalman(motor_noise=0.02, train_noise=5e-3, load_walk=5e3, period=1e-3),
    "true-load": TrueLoad(),
}
