"""What can be planted in simulated runs: every cause of the catalogue, and four that it lacks."""

import numpy as np

from adhesion_jax.effects import EFFECTS, Covariate, Periodic, Product
from adhesion_jax.simulation.planted_contact import CONTACT
from adhesion_jax.simulation.planted_signals import SIGNALS
from adhesion_jax.simulation.planted_surroundings import SURROUNDINGS
from adhesion_jax.simulation.planting import (
    CleanRuns,
    OpenEffect,
    Planted,
    Planting,
    by_factor,
    by_its_formula,
    chosen,
    unchanged,
)


def torsion_otherwise(runs: CleanRuns) -> OpenEffect:
    """Mu + a sin(2 pi f t + phase of the run), f .5 to 3 Hz, t from the start of the run."""
    time = runs.columns["time_s"] - runs.columns["time_s"][:, :1]
    frequency = runs.generator.uniform(0.5, 3.0)
    phases = runs.generator.uniform(0, 2 * np.pi, (len(time), 1))
    wave = np.sin(2 * np.pi * frequency * time + phases)

    def make(amount: float) -> Planted:
        values = {"amplitude": amount, "frequency_hz": frequency}
        return Planted(2, unchanged, lambda adhesion: adhesion + amount * wave, unchanged, values)

    return OpenEffect(make, 0.3)


def unknown_column(runs: CleanRuns) -> OpenEffect:
    """The level falls with a column that no cause of the catalogue knows."""
    place, spread = runs.middle("rail_age_days"), float(np.std(runs.columns["rail_age_days"]))
    return by_its_formula(lambda a: Covariate(-a, place, spread, "rail_age_days"), 0.9, runs)


def unknown_column_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 - a (1 - exp(-z/(.4 z_max))), z the age of the rail from its least on."""
    age = runs.columns["rail_age_days"] - runs.columns["rail_age_days"].min()
    old = -np.expm1(-age / (0.4 * age.max()))
    return by_factor(lambda a: 1 - a * old, 0.95)


def product(runs: CleanRuns) -> OpenEffect:
    """The level depends on two columns together."""
    pair = ("gradient_permille", "temperature_C")
    first, second = (float(np.std(runs.columns[column])) for column in pair)
    one, other = (float(np.mean(runs.columns[column])) for column in pair)
    return by_its_formula(
        lambda a: Product(a, one / first, other / second, first, second, *pair), 0.9, runs
    )


def product_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 + a (T - mean)/10 K tanh(gradient/8), .05 at least."""
    celsius = runs.columns["temperature_C"]
    warm = (celsius - np.mean(celsius)) / 10
    steep = np.tanh(runs.columns["gradient_permille"] / 8)
    return by_factor(lambda a: np.maximum(1 + a * warm * steep, 0.05), 0.6)


def periodic(runs: CleanRuns) -> OpenEffect:
    """A wave along a column that is neither a position nor an angle."""
    sine, cosine = float(np.sin(runs.phase)), float(np.cos(runs.phase))
    frequency = 1 / runs.generator.uniform(11.0, 29.0)
    return by_its_formula(
        lambda a: Periodic(a * sine, a * cosine, frequency, "groove_depth_um"), 0.9, runs
    )


def periodic_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 + a sign(s) |s|^.6, s the sine of the phase."""
    wave = np.sin(2 * np.pi * runs.columns["groove_depth_um"] / runs.generator.uniform(11.0, 29.0))
    return by_factor(lambda a: 1 + a * np.sign(wave) * np.abs(wave) ** 0.6, 0.9)


#: Causes that have no class in the catalogue.
_BEYOND = {
    "torsion": Planting(None, torsion_otherwise),
    "unknown_column": Planting(unknown_column, unknown_column_otherwise),
    "product": Planting(product, product_otherwise, chosen("gradient_permille")),
    "periodic": Planting(periodic, periodic_otherwise, chosen("groove_depth_um")),
}

_OF_CATALOGUE = {**CONTACT, **SURROUNDINGS, **SIGNALS}

#: Everything that can be planted, by its name, the causes in the order of the catalogue.
PLANTABLE: dict[str, Planting] = {
    **{name: _OF_CATALOGUE[name] for name in EFFECTS if name in _OF_CATALOGUE},
    **_BEYOND,
}
