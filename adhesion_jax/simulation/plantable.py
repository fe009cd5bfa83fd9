"""What can be planted in simulated runs: every cause of the catalogue, and four that it lacks."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from adhesion_jax.effects import EFFECTS, Covariate, Periodic, Product
from adhesion_jax.effects.planting import (
    CleanRuns,
    Plan,
    Plantable,
    Planted,
    by_factor,
    by_its_formula,
    unchanged,
)


class Torsion(Plantable):
    """mu + a sin(2 pi f t + phase of the run), f .5 to 3 Hz, t from the start of the run."""

    FAMILY: ClassVar[str] = "torsion"
    SAME_AS: ClassVar[tuple[str, ...]] = ("periodic:time_s",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("time_s", "time_in_run")
    ONE_FORM: ClassVar[bool] = True

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        return cls.planted_otherwise(runs, generator)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        time = runs.columns["time_s"] - runs.columns["time_s"][:, :1]
        frequency = generator.uniform(0.5, 3.0)
        phases = generator.uniform(0, 2 * np.pi, (len(time), 1))
        wave = np.sin(2 * np.pi * frequency * time + phases)

        def make(amount: float) -> Planted:
            values = {"amplitude": amount, "frequency_hz": frequency}
            return Planted(
                2, unchanged, lambda adhesion: adhesion + amount * wave, unchanged, values
            )

        return Plan(make, 0.3)


class UnknownColumn(Plantable):
    """The level falls with a column that no cause of the catalogue knows."""

    FAMILY: ClassVar[str] = "unknown_column"
    SAME_AS: ClassVar[tuple[str, ...]] = ("covariate:rail_age_days",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("rail_age_days",)

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        place, spread = runs.middle("rail_age_days"), float(np.std(runs.columns["rail_age_days"]))
        return by_its_formula(lambda a: Covariate(-a, place, spread, "rail_age_days"), 0.9, runs)

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 - a (1 - exp(-z/(.4 z_max))), z the age of the rail from its least on."""
        age = runs.columns["rail_age_days"] - runs.columns["rail_age_days"].min()
        old = -np.expm1(-age / (0.4 * age.max()))
        return by_factor(lambda a: 1 - a * old, 0.95)


class JointDependence(Plantable):
    """The level depends on two columns together."""

    FAMILY: ClassVar[str] = "product"
    SAME_AS: ClassVar[tuple[str, ...]] = ("product:",)
    SEEN_IN: ClassVar[tuple[str, ...]] = ("gradient_permille", "temperature_C", "position_m")

    @classmethod
    def extra_columns(
        cls, columns: Mapping[str, np.ndarray], generator: np.random.Generator
    ) -> Mapping[str, np.ndarray]:
        return {"gradient_permille": columns["gradient_permille"]}

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        pair = ("gradient_permille", "temperature_C")
        first, second = (float(np.std(runs.columns[column])) for column in pair)
        one, other = (float(np.mean(runs.columns[column])) for column in pair)
        return by_its_formula(
            lambda a: Product(a, one / first, other / second, first, second, *pair), 0.9, runs
        )

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 + a (T - mean)/10 K tanh(gradient/8), .05 at least."""
        celsius = runs.columns["temperature_C"]
        warm = (celsius - np.mean(celsius)) / 10
        steep = np.tanh(runs.columns["gradient_permille"] / 8)
        return by_factor(lambda a: np.maximum(1 + a * warm * steep, 0.05), 0.6)


class WaveAlongColumn(Plantable):
    """A wave along a column that is neither a position nor an angle."""

    FAMILY: ClassVar[str] = "periodic"
    SAME_AS: ClassVar[tuple[str, ...]] = ("periodic:groove_depth_um", "covariate:groove_depth_um")
    SEEN_IN: ClassVar[tuple[str, ...]] = ("groove_depth_um",)

    @classmethod
    def extra_columns(
        cls, columns: Mapping[str, np.ndarray], generator: np.random.Generator
    ) -> Mapping[str, np.ndarray]:
        return {"groove_depth_um": columns["groove_depth_um"]}

    @classmethod
    def planted(cls, runs: CleanRuns, phase: float, generator: np.random.Generator) -> Plan:
        sine, cosine = float(np.sin(phase)), float(np.cos(phase))
        frequency = 1 / generator.uniform(11.0, 29.0)
        return by_its_formula(
            lambda a: Periodic(a * sine, a * cosine, frequency, "groove_depth_um"), 0.9, runs
        )

    @classmethod
    def planted_otherwise(cls, runs: CleanRuns, generator: np.random.Generator) -> Plan:
        """1 + a sign(s) |s|^.6, s the sine of the phase."""
        wave = np.sin(2 * np.pi * runs.columns["groove_depth_um"] / generator.uniform(11.0, 29.0))
        return by_factor(lambda a: 1 + a * np.sign(wave) * np.abs(wave) ** 0.6, 0.9)


#: Causes that have no class in the catalogue.
BEYOND: Mapping[str, type[Plantable]] = {
    "torsion": Torsion,
    "unknown_column": UnknownColumn,
    "product": JointDependence,
    "periodic": WaveAlongColumn,
}

#: Everything that can be planted, by its name.
PLANTABLE: Mapping[str, type[Plantable]] = {**EFFECTS, **BEYOND}


def names_for(name: str) -> tuple[str, ...]:
    """All names that count as a planted effect, its own first.

    A name that ends in a colon counts for every name that begins with it.
    """
    return (name, *PLANTABLE[name].SAME_AS)
