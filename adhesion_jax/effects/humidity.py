import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Effect, Facts, Multiplier, Scalar, Values


class Humidity(Multiplier):
    """A wide w is linear, a centre c at an end saturates, a narrow w is a threshold."""

    k: Scalar
    centre: Scalar
    width: Scalar
    reference: Scalar

    FACTS = Facts(
        source="Beagley and Pritchard 1975, Wear 35:299; Zhu et al. 2015, Tribol. Lett. 57:12",
        described={
            "k": ("1", -0.9, 0.9, "half the change over the range"),
            "centre": ("%", -20.0, 120.0, "humidity of the steepest change"),
            "width": ("%", 4.0, 200.0, "range of the change"),
            "reference": ("%", 0.0, 100.0, "humidity at which nothing changes"),
        },
        strengths=("k",),
        starts=(),
        references={"reference": "relative_humidity_pct"},
        needs=("relative_humidity_pct",),
        sentence="Humidity of the air changes adhesion: linearly, with saturation, or beyond a "
        "threshold.",
        formula="mu (1 + k (s(H) - s(H0))), s(H) = tanh((H - c)/w)/tanh(50/w), H the relative "
        "humidity in %",
        phrase="humidity",
        family="humidity",
        same_as=("covariate:relative_humidity_pct",),
    )

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        def share(humidity: Values | Scalar) -> Values:
            return jnp.tanh((humidity - self.centre) / self.width) / jnp.tanh(50 / self.width)

        change = share(conditions["relative_humidity_pct"]) - share(self.reference)
        return jnp.maximum(1 + self.k * change, 0.0)

    @classmethod
    def starts(cls, columns: Columns) -> list[Effect]:
        reference = float(np.median(columns["relative_humidity_pct"]))
        low, high = np.quantile(columns["relative_humidity_pct"], [0.05, 0.95])
        grid = [(reference, 150.0), *((c, 15.0) for c in np.linspace(low, high, 5))]
        return [cls(k=0.03, centre=float(c), width=w, reference=reference) for c, w in grid]
