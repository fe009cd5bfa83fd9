"""The contract of a seeker: it asks for a slip velocity, from the observed adhesion."""

from abc import abstractmethod
from typing import Any

import equinox as eqx

from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import Reference, Signals


class Seeker(eqx.Module):
    """Its fields are settings; numbers among them may differ without a new compilation."""

    @property
    def told_price(self) -> float | None:
        """The price of slip work at which it is told the true optimum, for comparison; or none."""
        return None

    def init(self, nominal: Plant, signals: Signals) -> Any:
        """The state before the first control sample; by default there is none."""
        return ()

    @abstractmethod
    def update(
        self, state: Any, nominal: Plant, signals: Signals, period: float
    ) -> tuple[Any, Reference]:
        """The state and the slip asked for at a control sample, `period` seconds after the last."""
