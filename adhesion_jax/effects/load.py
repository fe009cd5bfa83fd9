"""What the normal load does to the curve."""

from functools import partial

import jax.numpy as jnp

from adhesion_jax.effects.api import (
    Conditions,
    Facts,
    Multiplier,
    Scalar,
    Signal,
    SlipTransform,
    Values,
)

#: What the two facts of a power of the load have in common.
_of_load = partial(
    Facts,
    described={
        "p": ("1", -3.0, 3.0, "power of the load"),
        "reference": ("N", 0.001, 1e6, "load at which nothing changes"),
    },
    strengths=("p",),
    starts=({"p": 0.05},),
    references={"reference": "normal_load_N"},
    needs=("normal_load_N",),
    family="load",
    same_as=("covariate:normal_load_N",),
)


class LoadPeak(Multiplier):
    """Near F0 it is Burckhardt's 1 - c5 F^2 with p = 2 c5 F0^2/(1 - c5 F0^2).

    The power is how tyres and Hertzian contacts are described.
    """

    p: Scalar
    reference: Scalar

    FACTS = _of_load(
        source="Burckhardt 1993; Persson 2001, J. Chem. Phys. 115:3840",
        sentence="The level of adhesion depends on the normal load.",
        formula="mu (F/F0)^-p, F the normal load in N, F0 its median in the data",
        phrase="normal load on the peak",
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        return (conditions["normal_load_N"] / self.reference) ** (-self.p)


class LoadSlope(SlipTransform):
    """The stiffness of a Hertzian contact over its load goes as F^(-1/3)."""

    p: Scalar
    reference: Scalar

    FACTS = _of_load(
        source="Kalker 1967, thesis, Delft; Hertz",
        sentence="The steepness of the rise depends on the normal load.",
        formula="mu(l (F/F0)^-p): adhesion rises less steeply under load, its level stays",
        phrase="normal load on the slope",
    )

    def before(self, slip: Signal, conditions: Conditions) -> Signal:
        return slip * (conditions["normal_load_N"] / self.reference) ** (-self.p)


class LoadTransfer(Multiplier):
    """The adhesion is taken for the load at rest."""

    k: Scalar

    FACTS = Facts(
        source="Iwnicki 2006, Handbook of Railway Vehicle Dynamics, chapter 7",
        described={"k": ("s^2/m", -1.0, 1.0, "relative change with acceleration")},
        strengths=("k",),
        starts=({"k": 0.02},),
        needs=("acceleration_mps2",),
        sentence="Acceleration shifts load between axles.",
        formula="mu (1 + k a), a the acceleration of the vehicle in m/s^2",
        phrase="load transfer",
        family="load_transfer",
        same_as=("covariate:acceleration_mps2",),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        return jnp.maximum(1 + self.k * conditions["acceleration_mps2"], 0.0)
