"""What changes about the rail: humidity, temperature, and whatever drifts over a campaign."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Effect, Facts, Multiplier, Scalar, Values


class _Transition(Multiplier):
    """mu (1 + k (s(z) - s(z0))), s(z) = tanh((z - c)/w)/tanh(h/w), z the column that it needs."""

    k: Scalar
    centre: Scalar
    width: Scalar
    reference: Scalar

    HALF: eqx.AbstractClassVar[float]  # h: the change of z for which k is that of adhesion

    def factor(self, slip: Values, conditions: Conditions) -> Values:
        def share(z: Values | Scalar) -> Values:
            return jnp.tanh((z - self.centre) / self.width) / jnp.tanh(self.HALF / self.width)

        (column,) = self.FACTS.needs
        change = share(conditions[column]) - share(self.reference)
        return jnp.maximum(1 + self.k * change, 0.0)


class Humidity(_Transition):
    """A wide w is linear, a centre c at an end saturates, a narrow w is a threshold."""

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
    HALF = 50

    @classmethod
    def starts(cls, columns: Columns) -> list[Effect]:
        reference = float(np.median(columns["relative_humidity_pct"]))
        low, high = np.quantile(columns["relative_humidity_pct"], [0.05, 0.95])
        grid = [(reference, 150.0), *((c, 15.0) for c in np.linspace(low, high, 5))]
        return [cls(k=0.03, centre=float(c), width=w, reference=reference) for c, w in grid]


#: Where a step of the calendar is looked for.
_STEPS = np.linspace(0.15, 0.85, 8).tolist()


class Drift(_Transition):
    """A wide w is linear, a narrow one a step, a centre at the start an exponential approach."""

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
        formula="mu (1 + k (s(t) - s(t0))), s(t) = tanh((t - c)/w)/tanh(1/w), t from 0 to 1 "
        "over the campaign",
        phrase="a drift over the campaign",
        family="calendar",
        same_as=("covariate:time_s", "covariate:campaign_time"),
    )
    HALF = 1


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
