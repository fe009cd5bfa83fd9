"""One growing sequence of points; each estimate uses all points so far."""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, PRNGKeyArray

from adhesion_jax.curves import Curve
from adhesion_jax.errors import InputError
from adhesion_jax.metrics.information import bound_of_blocks, stacked, true_quantities
from adhesion_jax.options import Outliers, Points, Rail, Sigma, SlipMax
from adhesion_jax.records import SHARED_SLIP, Known, Record
from adhesion_jax.scenarios.base import Group, Scenario
from adhesion_jax.scenarios.noise import draw_noise
from adhesion_jax.scenarios.rails import HE2018, RAILS, rail_named

_PREFIXES = 20


def prefixes(
    points: int, lengths: tuple[int, ...]
) -> tuple[Bool[Array, "lengths points"], Bool[Array, "lengths points"]]:
    """Which points have been seen at each length, and which of them since the length before."""
    mask = jnp.arange(points) < jnp.array(lengths)[:, None]
    return mask, mask & ~jnp.roll(mask, 1, axis=0).at[0].set(False)


def growing_tables(rail: str, lengths: tuple[int, ...]) -> Mapping[str, Sequence[Group]]:
    """The whole sequence in the summary, every length in a table of checkpoints."""
    checkpoints = [Group(rail, (b,), k=length) for b, length in enumerate(lengths)]
    return {"summary": [Group(rail, (len(lengths) - 1,))], "checkpoints": checkpoints}


class GrowingSequence(Scenario):
    """Slip rises from 0 to `slip_max` in equal steps; a block is the sequence up to a length.

    The blocks of a run overlap: all hold the same points, and the mask tells how many have been
    seen.
    """

    rails: tuple[str, ...] = eqx.field(static=True)
    lengths: tuple[int, ...] = eqx.field(static=True)
    sigma: float = eqx.field(static=True)
    outliers: float = eqx.field(static=True)
    slip: Float[Array, " points"]
    truth: tuple[Curve, ...]
    known: Known
    run_axes: Any = eqx.field(default=SHARED_SLIP, static=True)

    def draw(self, key: PRNGKeyArray) -> Record:
        shape = (len(self.lengths), self.slip.size)
        noise = draw_noise(key, self.slip.shape, self.sigma, self.outliers)
        adhesion = self.truth[0](self.slip, {}) + noise
        mask, fresh = prefixes(self.slip.size, self.lengths)
        return Record(
            jnp.broadcast_to(self.slip, shape), jnp.broadcast_to(adhesion, shape), mask, fresh, {}
        )

    def quantities(self) -> Mapping[str, np.ndarray]:
        return true_quantities(stacked(self.truth), self.known)

    def bound(self, record: Record) -> Float[Array, "blocks values"]:
        return bound_of_blocks(
            stacked(self.truth),
            record.slip,
            record.mask,
            record.conditions,
            self.sigma,
            self.known,
        )

    def support(self) -> np.ndarray:
        return np.array(self.lengths)

    def tables(self) -> Mapping[str, Sequence[Group]]:
        return growing_tables(self.rails[0], self.lengths)


def he2018_1(
    rail: Rail = "dry",
    sigma: Sigma = 0.01,
    points: Points = 500,
    slip_max: SlipMax = 0.5,
    outliers: Outliers = 0.0,
) -> GrowingSequence:
    """500 points, slip 0 to 0.5, on one rail (dry), estimated at 20 lengths (He Exp. 1)."""
    lengths = tuple(round(points * (j + 1) / _PREFIXES) for j in range(_PREFIXES))
    if lengths[0] < 5:
        raise InputError(
            f"--points {points} is too few for --scenario he2018-1; "
            "the first of its 20 lengths needs 5 points, so at least 100."
        )
    rail = rail_named(rail)
    return GrowingSequence(
        rails=(rail,) * _PREFIXES,
        lengths=lengths,
        sigma=sigma,
        outliers=outliers,
        slip=jnp.linspace(0.0, slip_max, points),
        truth=(RAILS[rail],) * _PREFIXES,
        known=HE2018,
    )
