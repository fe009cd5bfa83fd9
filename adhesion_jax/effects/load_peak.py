from adhesion_jax.effects.api import Conditions, Facts, Multiplier, Scalar, Values


class LoadPeak(Multiplier):
    """Near F0 it is Burckhardt's 1 - c5 F^2 with p = 2 c5 F0^2/(1 - c5 F0^2).

    The power is how tyres and Hertzian contacts are described.
    """

    p: Scalar
    reference: Scalar

    FACTS = Facts(
        source="Burckhardt 1993; Persson 2001, J. Chem. Phys. 115:3840",
        described={
            "p": ("1", -3.0, 3.0, "power of the load"),
            "reference": ("N", 0.001, 1e6, "load at which nothing changes"),
        },
        strengths=("p",),
        starts=({"p": 0.05},),
        references={"reference": "normal_load_N"},
        needs=("normal_load_N",),
        sentence="The level of adhesion depends on the normal load.",
        formula="mu (F/F0)^-p, F the normal load in N, F0 its median in the data",
        phrase="normal load on the peak",
        family="load",
        same_as=("covariate:normal_load_N",),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        return (conditions["normal_load_N"] / self.reference) ** (-self.p)
