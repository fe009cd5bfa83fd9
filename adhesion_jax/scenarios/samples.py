"""A stream in which every sample is followed, on a rail that changes."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, PRNGKeyArray

from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.errors import InputError
from adhesion_jax.metrics.information import (
    adhesion_and_information,
    inverse_information,
    quantity_covariance,
    true_quantities,
)
from adhesion_jax.options import Outliers, Points, Rail, Sigma, SlipMax
from adhesion_jax.records import OWN_SLIP, Known, Record
from adhesion_jax.scenarios.base import Group, Scenario
from adhesion_jax.scenarios.draws import uniform
from adhesion_jax.scenarios.noise import draw_noise
from adhesion_jax.scenarios.rails import (
    KIENCKE_RAILS,
    QIAN2024,
    RAILS,
    peak_matched,
    peak_of,
    rail_named,
)

#: Number of samples between two reports.
_BLOCK = 10

#: Number of blocks between two checkpoints.
_SPACING = 5

#: A stream is followed at every sample.
_KNOWN = dataclasses.replace(QIAN2024, by_sample=True)


class Samples(Scenario):
    """Slips independent and uniform on 0 to `slip_max`; the curve may differ between samples.

    The bound is that for the data since the last switch; a rail that drifts has none, because
    every sample has another curve.
    """

    rails: tuple[str, ...] = eqx.field(static=True)
    sigma: float = eqx.field(static=True)
    outliers: float = eqx.field(static=True)
    slip_max: float = eqx.field(static=True)
    drifts: bool = eqx.field(static=True)
    curves: Kiencke  # its parameters are those of each sample, [samples]
    known: Known
    run_axes: Any = eqx.field(default=OWN_SLIP, static=True)

    def draw(self, key: PRNGKeyArray) -> Record:
        slip_key, noise_key = jax.random.split(key)
        shape = (len(self.rails), _BLOCK)
        slip = uniform(slip_key, (_BLOCK * len(self.rails),), self.slip_max)
        adhesion = self.curves(slip, {}) + draw_noise(
            noise_key, slip.shape, self.sigma, self.outliers
        )
        every = jnp.ones(shape, dtype=bool)
        return Record(slip.reshape(shape), adhesion.reshape(shape), every, every, {})

    def quantities(self) -> Mapping[str, np.ndarray]:
        return true_quantities(self._truth(), self.known)

    def bound(self, record: Record) -> Float[Array, "blocks values"]:
        truth = self._truth()
        _, information = jax.vmap(adhesion_and_information)(truth, record.slip, record.mask, {})
        total = jnp.cumsum(information, axis=0)
        first = np.arange(len(self.rails)) + 1 - self.support() // _BLOCK
        since = total - jnp.where((first > 0)[:, None, None], total[first - 1], 0.0)
        covariance = self.sigma**2 * jax.vmap(inverse_information)(since)
        covariance = jax.vmap(quantity_covariance, (0, 0, None))(truth, covariance, self.known)
        bound = jnp.sqrt(jnp.diagonal(covariance, axis1=-2, axis2=-1))
        return jnp.full_like(bound, jnp.nan) if self.drifts else bound

    def _truth(self) -> Kiencke:
        """The curve at the end of each block."""
        return jax.tree.map(lambda values: values[_BLOCK - 1 :: _BLOCK], self.curves)

    def support(self) -> np.ndarray:
        """Samples since the last switch."""
        since, counts = 0, []
        for b, rail in enumerate(self.rails):
            since = since + _BLOCK if b == 0 or rail == self.rails[b - 1] else _BLOCK
            counts.append(since)
        return np.array(counts)

    def tables(self) -> Mapping[str, Sequence[Group]]:
        """The end of each stretch in the summary; k counts the samples seen.

        Steady running is the second half of a stretch, against the bound of the data since its
        start.
        """
        blocks = len(self.rails)
        switches = [b for b in range(1, blocks) if self.rails[b] != self.rails[b - 1]]
        ends = {b - 1 for b in switches} | {blocks - 1}
        after = {b + j for b in switches for j in range(_SPACING)}
        spaced = set(range(_SPACING - 1, blocks, _SPACING))
        halves = [
            tuple(range(end + 1 - self.support()[end] // _BLOCK // 2, end + 1))
            for end in sorted(ends)
        ]
        return {
            "summary": [Group(self.rails[b], (b,)) for b in sorted(ends)],
            "steady": [Group(self.rails[half[0]], half) for half in halves],
            "checkpoints": [
                Group(self.rails[b], (b,), k=_BLOCK * (b + 1))
                for b in sorted(ends | after | spaced)
                if b < blocks
            ],
        }


def _of_samples(curves: Sequence[Kiencke]) -> Kiencke:
    """One curve whose parameters have the axis [samples]; stacked in NumPy, which is faster."""
    parameters = np.array([jax.tree.leaves(curve) for curve in curves], dtype=float).T
    together: Kiencke = jax.tree.unflatten(
        jax.tree.structure(curves[0]), [jnp.asarray(values) for values in parameters]
    )
    return together


def _check_samples(name: str, points: int) -> None:
    """Raises InputError if the samples do not divide into blocks and two equal halves."""
    if points % (2 * _BLOCK) or points < 10 * _BLOCK:
        raise InputError(
            f"--points {points} does not go with --scenario {name}; "
            f"it takes a multiple of {2 * _BLOCK}, at least {10 * _BLOCK}."
        )


def qian2024_switch(
    sigma: Sigma = 0.01,
    points: Points = 1000,
    slip_max: SlipMax = 0.2,
    outliers: Outliers = 0.0,
) -> Samples:
    """1000 samples at random slips, from dry to common rail at sample 500 (Qian 2024, Fig. 4-6)."""
    _check_samples("qian2024-switch", points)
    rails = ("dry",) * (points // 2) + ("common",) * (points // 2)
    return Samples(
        rails=rails[_BLOCK - 1 :: _BLOCK],
        sigma=sigma,
        outliers=outliers,
        slip_max=slip_max,
        drifts=False,
        curves=_of_samples([KIENCKE_RAILS[rail] for rail in rails]),
        known=_KNOWN,
    )


#: Share of the adhesion that is lost from 20 to 100 % relative humidity.
_LOST_TO_HUMIDITY = 0.17


def drift(
    rail: Rail = "dry",
    sigma: Sigma = 0.01,
    points: Points = 1000,
    slip_max: SlipMax = 0.2,
    outliers: Outliers = 0.0,
) -> Samples:
    """1000 samples while humidity rises from 20 to 100 %, which takes 17 % of the adhesion.

    The peak sinks in proportion to humidity at a constant slip; the initial slope, which is
    elastic, stays.
    """
    _check_samples("drift", points)
    rail = rail_named(rail)
    peak_slip, peak = peak_of(RAILS[rail])
    left = 1 - _LOST_TO_HUMIDITY * np.arange(points) / (points - 1)
    return Samples(
        rails=(rail,) * (points // _BLOCK),
        sigma=sigma,
        outliers=outliers,
        slip_max=slip_max,
        drifts=True,
        curves=_of_samples([peak_matched(peak_slip, float(share * peak)) for share in left]),
        known=_KNOWN,
    )
