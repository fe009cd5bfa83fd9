import jax.numpy as jnp

from adhesion_jax.effects.api import Conditions, Facts, Multiplier, Scalar, Values


class Temperature(Multiplier):
    k: Scalar
    reference: Scalar

    FACTS = Facts(
        source="Zhu et al. 2015, Tribol. Lett. 57:12; Milliken 1995 for tyres",
        described={
            "k": ("1/K", -0.1, 0.1, "relative change with temperature"),
            "reference": ("degree C", -80.0, 200.0, "temperature at which nothing changes"),
        },
        strengths=("k",),
        starts=({"k": 1e-3},),
        references={"reference": "temperature_C"},
        needs=("temperature_C",),
        sentence="Adhesion changes with the temperature.",
        formula="mu (1 + k (T - T0)), T in degrees Celsius",
        phrase="temperature",
        family="temperature",
        same_as=("covariate:temperature_C",),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        return jnp.maximum(1 + self.k * (conditions["temperature_C"] - self.reference), 0.0)
