import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Effect, Facts, Multiplier, Scalar, Values


class Drift(Multiplier):
    """A wide w is linear, a narrow one a step, a centre at the start an exponential approach."""

    k: Scalar
    centre: Scalar
    width: Scalar
    reference: Scalar

    FACTS = Facts(
        source="any calibration",
        described={
            "k": ("1", -0.9, 0.9, "half the change"),
            "centre": ("1", -0.5, 1.5, "time of the steepest change"),
            "width": ("1", 0.01, 4.0, "duration of the change"),
            "reference": ("1", 0.0, 1.0, "time at which nothing changes"),
        },
        strengths=("k",),
        references={"reference": "campaign_time"},
        needs=("campaign_time",),
        sentence="Adhesion changes over the campaign: slowly, in a step, or levelling off.",
        formula="mu (1 + k (s(t) - s(t0))), s(t) = tanh((t - c)/w), t from 0 to 1 over the "
        "campaign",
        phrase="a drift over the campaign",
        family="calendar",
        same_as=("covariate:time_s", "covariate:campaign_time"),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        def share(time: Values | Scalar) -> Values:
            return jnp.tanh((time - self.centre) / self.width) / jnp.tanh(1 / self.width)

        change = share(conditions["campaign_time"]) - share(self.reference)
        return jnp.maximum(1 + self.k * change, 0.0)

    @classmethod
    def starts(cls, columns: Columns) -> list[Effect]:
        grid = [(0.5, 3.0), (0.0, 0.3), *((float(c), 0.03) for c in np.linspace(0.15, 0.85, 8))]
        return [cls(k=0.03, centre=c, width=w, reference=0.5) for c, w in grid]
