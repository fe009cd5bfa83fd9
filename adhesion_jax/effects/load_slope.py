from adhesion_jax.effects.api import Conditions, Facts, Scalar, Signal, SlipTransform


class LoadSlope(SlipTransform):
    """The stiffness of a Hertzian contact over its load goes as F^(-1/3)."""

    p: Scalar
    reference: Scalar

    FACTS = Facts(
        source="Kalker 1967, thesis, Delft; Hertz",
        described={
            "p": ("1", -3.0, 3.0, "power of the load"),
            "reference": ("N", 0.001, 1e6, "load at which nothing changes"),
        },
        strengths=("p",),
        starts=({"p": 0.05},),
        references={"reference": "normal_load_N"},
        needs=("normal_load_N",),
        sentence="The steepness of the rise depends on the normal load.",
        formula="mu(l (F/F0)^-p): adhesion rises less steeply under load, its level stays",
        phrase="normal load on the slope",
        family="load",
        same_as=("covariate:normal_load_N",),
    )

    def before(self, slip: Signal, conditions: Conditions) -> Signal:
        return slip * (conditions["normal_load_N"] / self.reference) ** (-self.p)
