from adhesion_jax.effects.api import Conditions, Facts, Scalar
from adhesion_jax.effects.dynamic import Lagging


class Lag(Lagging):
    time_constant: Scalar

    FACTS = Facts(
        source="any filtered signal",
        described={"time_constant": ("s", 0.0, 20.0, "time constant of the filter")},
        strengths=("time_constant",),
        starts=tuple({"time_constant": time} for time in (0.05, 0.2, 0.6, 1.5, 5.0, 15.0)),
        needs=("time_s",),
        sentence="The adhesion signal passes a first-order filter.",
        formula="T dmu/dt + mu = mu_steady, T in s",
        phrase="a lag of the adhesion signal",
        family="in time",
    )

    def time(self, conditions: Conditions) -> Scalar:
        return self.time_constant
