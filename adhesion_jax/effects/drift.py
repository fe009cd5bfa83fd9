import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Conditions, Facts, Multiplier, Scalar, Values

#: Where a step of the calendar is looked for.
_STEPS = np.linspace(0.15, 0.85, 8).tolist()


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
        starts=tuple(
            {"k": 0.03, "centre": centre, "width": width, "reference": 0.5}
            for centre, width in [(0.5, 3.0), (0.0, 0.3), *((c, 0.03) for c in _STEPS)]
        ),
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
