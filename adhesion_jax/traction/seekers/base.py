"""The contract of a seeker: it asks for a slip velocity, from the observed adhesion."""

from abc import abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import equinox as eqx

from adhesion_jax.traction.box import Range
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.signals import PerAxle, Reference, Signals


class Peak(NamedTuple):
    """The peak of the rail as a seeker has identified it; NaN where it does not know it yet."""

    slip: PerAxle  # m/s
    adhesion: PerAxle
    slip_error: PerAxle  # standard error, m/s
    adhesion_error: PerAxle


class Seeker(eqx.Module):
    """Its fields are settings; numbers among them may differ without a new compilation."""

    BOX: ClassVar[Mapping[str, Range]] = MappingProxyType({})  # of the fields that are tuned

    @property
    def told_price(self) -> float | None:
        """The price of slip work at which it is told the true optimum, for comparison; or none."""
        return None

    @property
    def box(self) -> Mapping[str, Range]:
        """The ranges of the numbers that may be tuned, by the names of their fields."""
        return self.BOX

    def init(self, nominal: Plant, signals: Signals) -> Any:
        """The state before the first control sample; by default there is none."""
        return ()

    @abstractmethod
    def update(
        self, state: Any, nominal: Plant, signals: Signals, period: float
    ) -> tuple[Any, Reference]:
        """The state and the slip asked for at a control sample, `period` seconds after the last."""

    def identified(self, state: Any) -> Peak | None:
        """The peak that a state tells of; by default a seeker identifies none."""
        return None
