"""A stream of samples at random slips, whose estimates are taken at a few moments."""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import Curve
from adhesion_jax.errors import InputError
from adhesion_jax.metrics.information import bound_of_blocks, stacked, true_quantities
from adhesion_jax.options import Outliers, Points, Rail, Sigma, SlipMax
from adhesion_jax.records import OWN_SLIP, Known, Record
from adhesion_jax.scenarios.base import Group, Scenario
from adhesion_jax.scenarios.draws import uniform
from adhesion_jax.scenarios.growing import growing_tables, prefixes
from adhesion_jax.scenarios.noise import draw_noise
from adhesion_jax.scenarios.rails import KIENCKE_RAILS, QIAN2024, rail_named

#: Numbers of samples after which Qian et al. 2024 reads its figures.
_CHECKPOINTS = (30, 230, 250)


class Stream(Scenario):
    """Every sample has a slip of its own, uniform on 0 to `slip_max`; one rail.

    A block holds all the samples up to a length. The slips differ from run to run.
    """

    rails: tuple[str, ...] = eqx.field(static=True)
    lengths: tuple[int, ...] = eqx.field(static=True)
    sigma: float = eqx.field(static=True)
    outliers: float = eqx.field(static=True)
    slip_max: float = eqx.field(static=True)
    truth: tuple[Curve, ...]
    known: Known
    run_axes: Any = eqx.field(default=OWN_SLIP, static=True)

    def draw(self, key: PRNGKeyArray) -> Record:
        slip_key, noise_key = jax.random.split(key)
        points = self.lengths[-1]
        shape = (len(self.lengths), points)
        slip = uniform(slip_key, (points,), self.slip_max)
        noise = draw_noise(noise_key, slip.shape, self.sigma, self.outliers)
        adhesion = self.truth[0](slip, {}) + noise
        mask, fresh = prefixes(points, self.lengths)
        return Record(
            jnp.broadcast_to(slip, shape), jnp.broadcast_to(adhesion, shape), mask, fresh, {}
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


def qian2024(
    rail: Rail = "dry",
    sigma: Sigma = 0.01,
    points: Points = _CHECKPOINTS[-1],
    slip_max: SlipMax = 0.2,
    outliers: Outliers = 0.0,
) -> Stream:
    """250 samples on one rail (dry), slip uniform on 0 to 0.2, Kiencke with a0 known."""
    if points < _CHECKPOINTS[0]:
        raise InputError(
            f"--points {points} is too few for --scenario qian2024; "
            f"its first estimate is taken after {_CHECKPOINTS[0]} points."
        )
    lengths = (*(k for k in _CHECKPOINTS if k < points), points)
    rail = rail_named(rail)
    return Stream(
        rails=(rail,) * len(lengths),
        lengths=lengths,
        sigma=sigma,
        outliers=outliers,
        slip_max=slip_max,
        truth=(KIENCKE_RAILS[rail],) * len(lengths),
        known=QIAN2024,
    )
