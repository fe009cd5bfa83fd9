"""Independent blocks of points, each over the whole slip range, on one rail or several."""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves import Curve
from adhesion_jax.errors import InputError
from adhesion_jax.metrics.information import (
    adhesion_and_sensitivity,
    bound_of_information,
    information_of,
    stacked,
    true_quantities,
)
from adhesion_jax.options import BlockCount, Outliers, Points, Rail, Sigma, SlipMax
from adhesion_jax.records import SHARED_SLIP, Known, Record
from adhesion_jax.scenarios.base import Group, Scenario
from adhesion_jax.scenarios.noise import draw_noise, whitened
from adhesion_jax.scenarios.rails import HE2018, RAILS, rail_named


class Blocks(Scenario):
    """Blocks on equally spaced slips from 0 to `slip_max`, the rail constant within a block.

    The noise of neighbouring points has the correlation `lag_one`.
    """

    rails: tuple[str, ...] = eqx.field(static=True)
    sigma: float = eqx.field(static=True)
    outliers: float = eqx.field(static=True)
    slip: Float[Array, " points"]
    truth: tuple[Curve, ...]
    known: Known
    run_axes: Any = eqx.field(default=SHARED_SLIP, static=True)
    lag_one: float = eqx.field(default=0.0, static=True)

    def draw(self, key: PRNGKeyArray) -> Record:
        clean = jnp.stack([curve(self.slip, {}) for curve in self.truth])
        noise = draw_noise(key, clean.shape, self.sigma, self.outliers, self.lag_one)
        slip = jnp.broadcast_to(self.slip, clean.shape)
        every = jnp.ones(clean.shape, dtype=bool)
        return Record(slip, clean + noise, every, every, {})

    def quantities(self) -> Mapping[str, np.ndarray]:
        return true_quantities(stacked(self.truth), self.known)

    def bound(self, record: Record) -> Float[Array, "blocks values"]:
        """The bound for correlated noise: the filter that makes the noise white is applied to J."""

        def of_block(curve: Curve) -> Float[Array, " values"]:
            _, sensitivity = adhesion_and_sensitivity(curve, self.slip, {})
            information = information_of(whitened(sensitivity, self.lag_one))
            return bound_of_information(curve, information, self.sigma, self.known)

        return jax.vmap(of_block)(stacked(self.truth))

    def support(self) -> np.ndarray:
        return np.full(len(self.rails), self.slip.size)

    def tables(self) -> Mapping[str, Sequence[Group]]:
        """The first block after a switch has a table of its own, which shows the tracking."""
        starts = [b for b in range(1, len(self.rails)) if self.rails[b] != self.rails[b - 1]]
        blocks = {
            rail: tuple(b for b, other in enumerate(self.rails) if other == rail)
            for rail in dict.fromkeys(self.rails)
        }
        switched = {self.rails[b]: number for number, b in enumerate(starts, 1)}
        summary = [
            Group(rail, tuple(b for b in of_rail if b not in starts), switched.get(rail))
            for rail, of_rail in blocks.items()
        ]
        if not starts:
            return {"summary": summary}
        switches = [Group(self.rails[b], (b,), number) for number, b in enumerate(starts, 1)]
        return {"summary": summary, "switches": switches}


def _blocks(
    rails: tuple[str, ...],
    sigma: float,
    points: int,
    slip_max: float,
    outliers: float,
    lag_one: float = 0.0,
) -> Blocks:
    return Blocks(
        rails=rails,
        sigma=sigma,
        outliers=outliers,
        slip=jnp.linspace(0.0, slip_max, points),
        truth=tuple(RAILS[rail] for rail in rails),
        known=HE2018,
        lag_one=lag_one,
    )


def single(
    rail: Rail = "dry",
    sigma: Sigma = 0.01,
    points: Points = 500,
    slip_max: SlipMax = 0.2,
    outliers: Outliers = 0.0,
) -> Blocks:
    """One block of 500 points, slip 0 to 0.2, on one rail (dry)."""
    return _blocks((rail_named(rail),), sigma, points, slip_max, outliers)


#: Correlation of neighbours in `coloured`: that of a filter with a time constant of 4.5 samples.
_COLOURED = 0.8


def coloured(
    rail: Rail = "dry",
    sigma: Sigma = 0.01,
    points: Points = 500,
    slip_max: SlipMax = 0.2,
    outliers: Outliers = 0.0,
) -> Blocks:
    """As single, but neighbouring points share their noise (first-order autoregressive, 0.8).

    The noise of a point is as large as in single. A method that takes it as white loses at most a
    per cent or two of its accuracy; but it assumes nine times the information that the points
    hold, so that its standard errors are a third of the true ones.
    """
    return _blocks((rail_named(rail),), sigma, points, slip_max, outliers, _COLOURED)


def he2018_blocks(
    blocks: BlockCount = 12,
    sigma: Sigma = 0.01,
    points: Points = 500,
    slip_max: SlipMax = 0.2,
    outliers: Outliers = 0.0,
) -> Blocks:
    """Blocks of 500 points, slip 0 to 0.2, dry, common and wet rail in turn (He Exp. 2 and 3)."""
    if blocks < 6:
        raise InputError(
            f"--blocks {blocks} is too few for --scenario he2018-blocks; "
            "each of its three rails needs two blocks, so at least 6."
        )
    order = tuple(RAILS)
    rails = tuple(order[3 * block // blocks] for block in range(blocks))
    return _blocks(rails, sigma, points, slip_max, outliers)
