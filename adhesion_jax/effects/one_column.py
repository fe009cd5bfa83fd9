"""Forms of effects over any one column, for what has no formula of its own."""

import re
from collections.abc import Container
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from adhesion_jax.effects.api import Columns, Conditions, Effect, Form, Scalar, Signal, Values
from adhesion_jax.effects.dynamic import lagged
from adhesion_jax.effects.shape import ShapeTerm, share_below

#: References of a form, which are described alike.
_REFERENCE = {"reference": ("column", -1e12, 1e12, "value at which nothing changes")}
_SCALE = {"scale": ("column", 1e-12, 1e12, "unit of the change")}
_K = {"k": ("1", -3.0, 3.0, "change of g per standard deviation of the column")}


class Covariate(ShapeTerm):
    k: Scalar
    reference: Scalar
    scale: Scalar
    column: str = eqx.field(static=True)

    FACTS = Form(
        source="first term of any smooth dependence",
        described={**_K, **_REFERENCE, **_SCALE},
        strengths=("k",),
        references={"reference": "column", "scale": "column"},
        formula="g = k (z - z0)/s, z any column, z0 its median and s its standard deviation",
        phrase="a dependence on {}",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        return jnp.asarray(self.k * (conditions[self.column] - self.reference) / self.scale)

    @classmethod
    def at_places(cls) -> np.ndarray:
        return np.linspace(-1.5, 1.5, 6)[:, None]

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        return [
            cls(k=0.02, reference=float(np.median(z)), scale=float(np.std(z)), column=name)
            for name, z in columns.items()
        ]


class Constant(ShapeTerm):
    """g = k, beside a form that is zero at the middle of its column.

    A curve takes up what is constant of its level, its slip scale and its fall, and no offset and
    no shift: it passes through the origin.
    """

    k: Scalar

    FACTS = Form(
        source="the term of degree zero of any smooth dependence",
        described={"k": ("1", -3.0, 3.0, "what g is at the middle of the column")},
        strengths=("k",),
        formula="g = k, beside a form that is zero at the middle of its column",
        phrase="a constant beside what {} does",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        return jnp.asarray(self.k)

    @classmethod
    def at_places(cls) -> np.ndarray:
        return np.ones((6, 1))

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        return [cls(0.02)]


class Memory(ShapeTerm):
    """g = k (y - z0)/s with T y' + y = z, z any column, z0 its median and s its spread.

    A run starts settled.
    """

    k: Scalar
    time_constant: Scalar
    reference: Scalar
    scale: Scalar
    column: str = eqx.field(static=True)

    FACTS = Form(
        source="first-order lag",
        described={
            **_K,
            "time_constant": ("s", 1e-3, 1e4, "time constant of the memory"),
            **_REFERENCE,
            **_SCALE,
        },
        strengths=("k",),
        references={"reference": "column", "scale": "column"},
        formula="g = k (y - z0)/s, T y' + y = z, z any column, z0 its median",
        phrase="a dependence on {} with a memory",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        seen = lagged(jnp.asarray(conditions[self.column]), self.time_constant, conditions)
        return jnp.asarray(self.k * (seen - self.reference) / self.scale)

    @classmethod
    def at_places(cls) -> np.ndarray:
        return np.linspace(-1.5, 1.5, 6)[:, None]

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        return [
            cls(0.02, time, float(np.median(z)), float(np.std(z)), column=name)
            for name, z in columns.items()
            if np.ptp(z) > 0
            for time in (0.4, 1.2, 4.0)
        ]


class Threshold(ShapeTerm):
    k: Scalar
    centre: Scalar
    width: Scalar
    reference: Scalar
    column: str = eqx.field(static=True)

    FACTS = Form(
        source="smooth transition: Granger and Teraesvirta 1993, Modelling Nonlinear Economic "
        "Relationships, section 2.3",
        described={
            "k": ("1", -3.0, 3.0, "half the log change over the step"),
            "centre": ("column", -1e12, 1e12, "middle of the step"),
            "width": ("column", 1e-12, 1e12, "half width of the step"),
            **_REFERENCE,
        },
        strengths=("k",),
        references={"reference": "column"},
        formula="g = k (tanh((z - c)/w) - tanh((z0 - c)/w)), z any column and z0 its median",
        phrase="a step over {}",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        def step(z: Values | float | Scalar) -> Values:
            return jnp.tanh((z - self.centre) / self.width)

        return self.k * (step(conditions[self.column]) - step(self.reference))

    @classmethod
    def at_places(cls) -> np.ndarray:
        return np.linspace(-1.0, 1.0, 6)[:, None]

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        return [
            cls(0.02, float(centre), 0.08 * float(np.ptp(z)), float(np.median(z)), name)
            for name, z in columns.items()
            if np.ptp(z) > 0
            for centre in np.unique(np.quantile(z, [0.15, 0.3, 0.5, 0.7, 0.85]))
        ]


_KNOTS = np.linspace(0.0, 1.0, 6)

#: Prior standard deviation of a second difference of g over neighbouring knots, relative to that of
#: g: where runs leave a gap in a column the spline goes on through it nearly straight.
_BENDING = 0.2


def _natural(u: Any) -> list[Any]:
    """The five functions of Eq. 5.4 and 5.5 beside the constant, u from 0 to 1."""
    cubes = [((u - knot) * (u > knot)) ** 3 / (1 - knot) for knot in _KNOTS[:-1]]
    return [u, *(cube - cubes[-1] for cube in cubes[:-1])]


def _turned() -> np.ndarray:
    """What makes the functions uncorrelated and of variance one over u, the smoothest first."""
    grid = np.stack(_natural((np.arange(1000) + 0.5) / 1000), axis=1)
    return np.linalg.inv(np.linalg.qr(grid - grid.mean(axis=0))[1]) * len(grid) ** 0.5


_TURNED, _MIDDLE = _turned(), np.array(_natural(0.5))


class Spline(ShapeTerm):
    """g = s(u), s a natural cubic spline with six knots on the share u of the data below z.

    u is the logistic distribution of the mean and the standard deviation of the column.
    """

    k1: Scalar
    k2: Scalar
    k3: Scalar
    k4: Scalar
    k5: Scalar
    mean: Scalar
    spread: Scalar
    column: str = eqx.field(static=True)

    FACTS = Form(
        source="Hastie, Tibshirani and Friedman 2009, The Elements of Statistical Learning, Eq. "
        "5.4 and 5.5",
        described={
            **{f"k{j}": ("1", -50.0, 50.0, f"weight of basis function {j}") for j in range(1, 6)},
            "mean": ("column", -1e12, 1e12, "mean of the data"),
            "spread": ("column", 1e-12, 1e12, "standard deviation of the data"),
        },
        strengths=("k1", "k2", "k3", "k4", "k5"),
        references={"mean": "column", "spread": "column"},
        formula="g = s(u), s a natural cubic spline with six knots on the share u of data below z",
        phrase="a smooth dependence on {}",
    )

    def log_factor(self, conditions: Conditions) -> Values:
        weights = _TURNED @ jnp.stack([self.k1, self.k2, self.k3, self.k4, self.k5])
        functions = _natural(share_below(conditions[self.column], self.mean, self.spread))
        terms = zip(weights, functions, _MIDDLE, strict=True)
        return sum(weight * (one - middle) for weight, one, middle in terms)

    @classmethod
    def at_places(cls) -> np.ndarray:
        places = (np.stack(_natural(_KNOTS), axis=1) - _MIDDLE) @ _TURNED
        return np.concatenate([places, np.diff(places, n=2, axis=0) / _BENDING])

    @classmethod
    def starts(cls, columns: Columns) -> list[ShapeTerm]:
        return [
            cls(0.02, 0.02, 0.02, 0.02, 0.02, float(z.mean()), float(z.std()), column=name)
            for name, z in columns.items()
            if np.ptp(z) > 0
        ]


_DAY = re.compile(
    r"(local|clock|start|utc)? ?(hours?|stunden?|tagesstunde|uhrzeit|tageszeit|tod|time ?of ?day)"
    r"( ?of ?(the ?)?day)?( (h|hr|hrs|hours?|local|utc|start))?"
)
_DIRECTIONS = {"dir", "direction", "heading", "azimuth", "richtung"}


def turn_of(column: str) -> float:
    """The values after which a column of directions or times of day begins anew; 0: none."""
    words = re.findall(r"[a-z]+", column.lower())
    if _DAY.fullmatch(" ".join(words)):
        return 24.0
    return 360.0 if _DIRECTIONS & {*words} else 0.0


class Periodic(Effect):
    sine: Scalar
    cosine: Scalar
    frequency: Scalar
    column: str = eqx.field(static=True)

    FACTS = Form(
        source="Fourier",
        described={
            "sine": ("1", -0.9, 0.9, "amplitude of the sine"),
            "cosine": ("1", -0.9, 0.9, "amplitude of the cosine"),
            "frequency": ("1/column", 0.0, 1e12, "waves per unit of the column"),
        },
        strengths=("sine", "cosine"),
        formula="mu (1 + a sin(2 pi f z) + b cos(2 pi f z)), f in waves a unit of the column z",
        phrase="a wave along {}",
    )

    @property
    def held(self) -> Container[str]:
        """The frequency, where the name of the column tells when it begins anew."""
        return ("frequency",) if turn_of(self.column) else ()

    def after(self, adhesion: Signal, slip: Signal, conditions: Conditions) -> Signal:
        phase = 2 * jnp.pi * self.frequency * conditions[self.column]
        return adhesion * (1 + self.sine * jnp.sin(phase) + self.cosine * jnp.cos(phase))

    @classmethod
    def starts(cls, columns: Columns) -> list[Effect]:
        """One wave over the range; a spectrum of the residual gives better ones."""
        return [
            cls(sine=0.03, cosine=0.03, frequency=1 / float(np.ptp(z)), column=name)
            for name, z in columns.items()
            if np.ptp(z) > 0
        ]
