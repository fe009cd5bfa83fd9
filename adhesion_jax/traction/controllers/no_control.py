"""No control: the driver's demand."""

from adhesion_jax.traction.controllers.base import Controller
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import PerAxle, Signals


class NoControl(Controller):
    """T = T*."""

    FOLLOWS = False

    def update(
        self, state: tuple[()], nominal: Plant, signals: Signals, period: float
    ) -> tuple[tuple[()], PerAxle]:
        return state, signals.demand
