"""The law that a plan takes for the truth: its adhesion, its peak, and what they depend on."""

from collections.abc import Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from adhesion_jax.curves import (
    SLIP_LIMIT,
    Conditions,
    Curve,
    Law,
    Scalar,
    free_values,
    with_free_values,
)
from adhesion_jax.curves.bent import Bent
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.errors import InputError
from adhesion_jax.linear_algebra import eigh
from adhesion_jax.programs import kept
from adhesion_jax.wording import listed

#: Number of slips of which sensitivities are computed at a time: one program serves all numbers.
_CHUNK = 2048

#: Where directions of the parameters differ by less than this in what they do, as a share, they
#: differ by rounding alone.
_ROUNDING = 1e-14

#: Taken in place of slip 0, where the size of the slip, and so an odd law, has no slope to jax.
_AT_REST = 1e-15


class Truth(NamedTuple):
    """A curve, or one with a departure or effects, at steady conditions.

    Unknown are the free parameters of the curve; departure, effects and conditions are known.
    """

    law: Law
    conditions: Mapping[str, float]
    slip_limit: float = SLIP_LIMIT  # largest slip at which the peak is searched
    slip_unit: str = ""  # " m/s" where slip is a velocity


class PeakOfTruth(NamedTuple):
    """The peak and its derivatives by the unknown parameters."""

    mu_max: float
    slip_opt: float
    gradient: Float[np.ndarray, "2 free"]  # of mu_max and of slip_opt


class Sensitivity(NamedTuple):
    """Adhesion at each slip, and its derivatives by the slip and by the unknown parameters."""

    adhesion: Float[np.ndarray, " points"]
    slope: Float[np.ndarray, " points"]
    by_parameters: Float[np.ndarray, "free points"]


def curve_of(law: Law) -> Curve:
    """The curve that holds the unknown parameters."""
    if isinstance(law, Curve):
        return law
    assert isinstance(law, (Bent, CorrectedLaw))
    return curve_of(law.curve)


def with_parameters(law: Law, values: Float[Array, " free"]) -> Law:
    """The law with other values of the unknown parameters."""
    return eqx.tree_at(curve_of, law, with_free_values(curve_of(law), values))


def peak_of(truth: Truth) -> PeakOfTruth:
    """InputError where the law has no peak, or lacks a condition."""
    lacking = [name for name in curve_of(truth.law).NEEDS if name not in truth.conditions]
    try:
        # A law looks its columns up by name, so that a missing one raises KeyError.
        if not lacking:
            jax.eval_shape(lambda law: law(jnp.zeros(()), truth.conditions), truth.law)
    except KeyError as missing:
        lacking = [str(missing.args[0])]
    if lacking:
        raise InputError(
            f"The law depends on {listed(lacking)}, whose value is not given; state it by "
            f"--condition {lacking[0]}=NUMBER."
        )
    values, gradient, found = _peak(truth.law, truth.conditions, truth.slip_limit)
    if not bool(found):
        raise InputError(
            f"The law has no peak between slip 0 and {truth.slip_limit:g}{truth.slip_unit}, so "
            "that there is no mu_max to plan for; name another curve, which has one."
        )
    mu_max, slip_opt = np.asarray(values).tolist()
    return PeakOfTruth(mu_max, slip_opt, np.asarray(gradient))


def sensitivity_of(truth: Truth, slip: Float[np.ndarray, " points"]) -> Sensitivity:
    """The sensitivity at each slip."""
    padded = np.full(-(-slip.size // _CHUNK) * _CHUNK, _AT_REST)
    padded[: slip.size] = np.where(slip == 0, _AT_REST, slip)
    parts = [
        _sensitivity(truth.law, chunk, truth.conditions) for chunk in padded.reshape(-1, _CHUNK)
    ]
    adhesion, slope, by_parameters = (
        np.concatenate([np.asarray(part[place]) for part in parts], axis=-1)[..., : slip.size]
        for place in range(3)
    )
    return Sensitivity(adhesion, slope, by_parameters)


def standard_errors(
    peak: PeakOfTruth,
    curvature: Float[np.ndarray, "plans free free"],
    score: Float[np.ndarray, "plans free free"],
) -> Float[np.ndarray, "plans 2"]:
    """Of mu_max and slip_opt, by the delta method; infinite where a parameter is undetermined.

    For each plan the curvature of what a fit minimises, and the covariance of its gradient.
    """
    scale = np.sqrt(np.maximum(np.diagonal(curvature, axis1=1, axis2=2), 1e-300))[:, None]
    values, vectors = eigh(curvature / (scale * scale.mT))
    determined = values.min(axis=1, keepdims=True) > _ROUNDING
    values = np.where(determined, values, 1.0)[:, None]
    along = (peak.gradient / scale) @ vectors / values @ vectors.mT / scale
    variance = np.einsum("nqi,nij,nqj->nq", along, score, along)
    return np.where(determined, np.sqrt(variance), np.inf)


@kept()
def _peak(
    law: Law, conditions: Conditions, slip_limit: Scalar
) -> tuple[Float[Array, "2"], Float[Array, "2 free"], Bool[Array, ""]]:
    def values(parameters: Float[Array, " free"]) -> Float[Array, "2"]:
        peak = with_parameters(law, parameters).peak(conditions, slip_limit)
        return jnp.stack([peak.adhesion, peak.slip])

    parameters = free_values(curve_of(law))
    found = law.peak(conditions, slip_limit).found
    return values(parameters), jax.jacfwd(values)(parameters), found


@kept()
def _sensitivity(
    law: Law, slip: Float[Array, " points"], conditions: Conditions
) -> tuple[Float[Array, " points"], Float[Array, " points"], Float[Array, "free points"]]:
    def adhesion(parameters: Float[Array, " free"], slip: Array) -> Array:
        return with_parameters(law, parameters)(slip, conditions)

    parameters = free_values(curve_of(law))
    value, slope = jax.jvp(lambda slip: adhesion(parameters, slip), (slip,), (jnp.ones_like(slip),))
    by_parameters = jax.jacfwd(lambda parameters: adhesion(parameters, slip))(parameters)
    return value, slope, by_parameters.T
