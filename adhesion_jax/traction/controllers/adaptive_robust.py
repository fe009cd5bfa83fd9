"""The adaptive robust re-adhesion controller of Uyulan et al. 2018."""

from typing import ClassVar, NamedTuple

import jax.numpy as jnp

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.controllers.base import Controller, followed
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import PerAxle, Setting, Signals


class AdaptiveRobustState(NamedTuple):
    bound: PerAxle  # kappa^


class AdaptiveRobust(Controller):
    """T = -k0 e - kappa^ phi sat(e/layer), e = v_s - v*, phi = 1 + p |V| + q V^2 + |dv*|,
    dkappa^ = sigma |e| phi outside the layer (Eq. 25, 28 and 29).

    sat, a straight line within +- layer, and the rest there stand for the paper's sign: kappa^
    would grow for ever by the chattering. p and q are not printed.
    """

    gain: Setting = 12500.0  # k0, N s
    adaptation: Setting = 19.0  # sigma
    linear: Setting = 0.0154  # p, s/m
    square: Setting = 0.00467  # q, s^2/m^2
    layer: Setting = 0.05  # m/s

    BOX: ClassVar = {
        "gain": Range(1e4, 1e6, log=True),
        "adaptation": Range(10.0, 1e5, log=True),
        "layer": Range(0.005, 0.1, log=True),
    }

    def init(self, nominal: Plant, signals: Signals) -> AdaptiveRobustState:
        return AdaptiveRobustState(jnp.zeros_like(signals.slip))

    def update(
        self, state: AdaptiveRobustState, nominal: Plant, signals: Signals, period: float
    ) -> tuple[AdaptiveRobustState, PerAxle]:
        asked = followed(signals)
        error = signals.slip - asked.slip
        speed = signals.train_speed
        size = 1 + self.linear * jnp.abs(speed) + self.square * speed**2 + jnp.abs(asked.rate)
        torque = -self.gain * error - state.bound * size * jnp.clip(error / self.layer, -1.0, 1.0)
        outside = jnp.abs(error) > self.layer
        growth = self.adaptation * jnp.abs(error) * size * outside
        return AdaptiveRobustState(state.bound + period * growth), torque
