"""The contract of a scenario: it draws records in blocks, and gives the truth behind them."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.records import Known, Record


class Group(NamedTuple):
    """Blocks whose estimates are pooled into one row of a table.

    `switched` is the number of the stretch that began with a switch to this rail, or None; k is
    the number of points seen, in tables that are ordered by it.
    """

    rail: str
    blocks: tuple[int, ...]
    switched: int | None = None
    k: int | None = None


class Scenario(eqx.Module):
    """Draws runs. `rails` names the rail of each block."""

    known: eqx.AbstractVar[Known]
    rails: eqx.AbstractVar[tuple[str, ...]]
    sigma: eqx.AbstractVar[float]
    outliers: eqx.AbstractVar[float]
    #: Zero for each field of a record that differs from run to run, None for one shared by all.
    run_axes: eqx.AbstractVar[Any]

    @abstractmethod
    def draw(self, key: PRNGKeyArray) -> Record:
        """All the blocks of one run: arrays [blocks, points]."""

    @abstractmethod
    def quantities(self) -> Mapping[str, np.ndarray]:
        """The true value of each quantity at the end of each block, arrays [blocks]."""

    @abstractmethod
    def bound(self, record: Record) -> Float[Array, "blocks values"]:
        """Cramer-Rao bound of `quantities`, [blocks, values]; NaN where there is none.

        It is the bound for the last `support` points of one run up to each block; a method that
        uses more points may come below it.
        """

    @abstractmethod
    def support(self) -> np.ndarray:
        """The number of points that an estimate after each block can use, [blocks]."""

    @abstractmethod
    def tables(self) -> Mapping[str, Sequence[Group]]:
        """The rows of each table that is reported: the name of a table to its groups."""
