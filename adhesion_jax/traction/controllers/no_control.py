"""No control: the driver's demand."""

from typing import ClassVar

from jaxtyping import Array, Float

from adhesion_jax.traction.controllers.base import Controller
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import Reference, Signals


class NoControl(Controller):
    """T = T*."""

    FOLLOWS: ClassVar[bool] = False

    def init(self, nominal: Plant, signals: Signals) -> tuple[()]:
        return ()

    def update(
        self,
        state: tuple[()],
        nominal: Plant,
        signals: Signals,
        reference: Reference | None,
        period: float,
    ) -> tuple[tuple[()], Float[Array, " axles"]]:
        return state, signals.demand
