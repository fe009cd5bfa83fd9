"""What is to be identified: records in blocks, the truth behind them, what may be known of it."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from adhesion_jax.curves import Curve


class Record(NamedTuple):
    """One block of one run; with a leading axis, all the blocks of it."""

    slip: Float[Array, "*blocks points"]
    adhesion: Float[Array, "*blocks points"]
    mask: Bool[Array, "*blocks points"]  # false: there is no such point
    fresh: Bool[Array, "*blocks points"]  # false: seen before, or no such point
    conditions: Mapping[str, Float[Array, "*blocks points"]]


#: The axes of `Scenario.run_axes` where the slips are the same in every run.
SHARED_SLIP: Any = Record(None, 0, None, None, {})  # type: ignore[arg-type]


class Known(eqx.Module):
    """What a scenario tells an identifier: the form of the curve, where to start and the box.

    The free parameters of `curve` hold the start; the others are known. `lower` and `upper`
    bound the free parameters, in their order.
    """

    curve: Curve
    lower: Float[Array, " free"]
    upper: Float[Array, " free"]


class Group(NamedTuple):
    """Blocks whose estimates are pooled into one row of a table.

    `after_switch` are all the blocks of the rail, if it began with a switch; k is the number of
    points seen, where a table is ordered by it.
    """

    rail: str
    blocks: tuple[int, ...]
    after_switch: tuple[int, ...] = ()
    k: int | None = None


@dataclass(frozen=True)
class Options:
    """What a user may change about a scenario; None leaves the scenario's own default."""

    rail: str | None = None
    sigma: float | None = None
    points: int | None = None
    slip_max: float | None = None
    outliers: float | None = None
    blocks: int | None = None


class Scenario(eqx.Module):
    """Draws runs. `rails` names the rail of each block, `truth` the curve of each block."""

    known: eqx.AbstractVar[Known]
    rails: eqx.AbstractVar[tuple[str, ...]]
    truth: eqx.AbstractVar[tuple[Curve, ...]]
    sigma: eqx.AbstractVar[float]
    outliers: eqx.AbstractVar[float]
    #: Zero for each field of a record that differs from run to run, None for one shared by all.
    run_axes: eqx.AbstractVar[Any]

    @abstractmethod
    def draw(self, key: PRNGKeyArray) -> Record:
        """All the blocks of one run: arrays [blocks, points]."""

    @abstractmethod
    def tables(self) -> Mapping[str, Sequence[Group]]:
        """The rows of each table that is reported: the name of a table to its groups."""
