"""What can be planted in simulated runs: how, every cause of the catalogue, and five it lacks."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions
from adhesion_jax.effects import EFFECTS, Covariate, Periodic
from adhesion_jax.effects.api import Effect
from adhesion_jax.effects.shape import ShapeTerm

#: Arrays [runs, points] to the like: slip to slip or to adhesion, adhesion to adhesion.
Bend = Callable[[np.ndarray], np.ndarray]


def unchanged(signal: np.ndarray) -> np.ndarray:
    return signal


class CleanRuns(NamedTuple):
    """Runs without any effect, arrays [runs, points], and the chance of one that is planted."""

    slip: np.ndarray  # the true slip ratio, negative in braking runs
    columns: Mapping[str, np.ndarray]  # every other column of the simulated runs
    conditions: Conditions  # the columns, completed by what follows from them
    curve: Bend  # the base curve of these runs, slip to adhesion
    generator: np.random.Generator  # draws what is not the strength of the effect
    phase: float = 0.0  # of an effect that is a wave, rad

    def middle(self, column: str) -> float:
        """Median of a column."""
        return float(np.median(self.columns[column]))


class Planted(NamedTuple):
    """One effect on all runs: adhesion = after(curve(before(slip))), lowest order first."""

    order: int
    before: Bend
    after: Bend
    measured: Bend  # the slip signal that the table is given for the true slip
    parameters: Mapping[str, float]


class OpenEffect(NamedTuple):
    """An effect whose strength is open: `make(amount)`, amount from 0 to `limit`."""

    make: Callable[[float], Planted]
    limit: float


#: An effect in simulated runs: its strength is open, the rest drawn.
Form = Callable[[CleanRuns], OpenEffect]

#: Columns [runs, points] from those that every run has.
Extra = Callable[[Mapping[str, np.ndarray], np.random.Generator], Mapping[str, np.ndarray]]


def chosen(*names: str) -> Extra:
    """These of the columns."""
    return lambda columns, _: {name: columns[name] for name in names}


class Planting(NamedTuple):
    """How an effect is planted in simulated runs: the form, and the columns that it needs besides.

    Noise has no formula, so that no phase of a wave is drawn for it.
    """

    form: Form
    extra: Extra = chosen()
    is_noise: bool = False


def of_strength(kind: type[Effect], limit: float, **others: float | tuple[float, float]) -> Form:
    """An effect of one strength up to a limit by its own formula, references being medians.

    The other parameters have a value, or one that is drawn between two.
    """
    (strength,) = kind.FACTS.strengths

    def form(runs: CleanRuns) -> OpenEffect:
        fixed = {
            name: runs.generator.uniform(*one) if isinstance(one, tuple) else one
            for name, one in others.items()
        }
        fixed |= kind.medians(runs.columns)
        return by_its_formula(lambda a: kind(**{strength: a}, **fixed), limit, runs)

    return form


def by_its_formula(build: Callable[[float], Effect], limit: float, runs: CleanRuns) -> OpenEffect:
    """The effect itself, `build(amount)`, on the runs."""
    true_slip = jnp.asarray(runs.slip)

    def make(amount: float) -> Planted:
        effect = build(amount)
        arrays = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), effect)
        values = {
            field: float(getattr(effect, field))
            for field in effect.FACTS.parameters
            if isinstance(getattr(effect, field), float)
        }

        def before(slip: np.ndarray) -> np.ndarray:
            return np.asarray(_before(arrays, jnp.asarray(slip), runs.conditions))

        def after(adhesion: np.ndarray) -> np.ndarray:
            return np.asarray(_after(arrays, jnp.asarray(adhesion), true_slip, runs.conditions))

        if effect.ORDER > 0:  # no effect of the adhesion bends the slip as well
            return Planted(effect.ORDER, unchanged, after, unchanged, values)
        return Planted(effect.ORDER, before, after, unchanged, values)

    return OpenEffect(make, limit)


@eqx.filter_jit
def _before(
    effect: Effect, slip: Float[Array, "runs points"], conditions: Conditions
) -> Float[Array, "runs points"]:
    return jax.vmap(lambda slip, conditions: effect.before(slip, conditions))(slip, conditions)


@eqx.filter_jit
def _after(
    effect: Effect,
    adhesion: Float[Array, "runs points"],
    slip: Float[Array, "runs points"],
    conditions: Conditions,
) -> Float[Array, "runs points"]:
    if isinstance(effect, ShapeTerm):  # those planted here act on the level
        return adhesion * jnp.exp(jax.vmap(effect.log_factor)(conditions))
    return jax.vmap(lambda *run: effect.after(*run))(adhesion, slip, conditions)


# ------------------------------------------------------------------------------------ the causes


def axle_position(runs: CleanRuns) -> OpenEffect:
    shares = {"k1": 0.4, "k2": 0.7, "k3": 1.0, "k4": 1.0, "k5": 1.0}
    kind = EFFECTS["axle_position"]
    return by_its_formula(
        lambda a: kind(**{name: share * a for name, share in shares.items()}), 2.5, runs
    )


def humidity(runs: CleanRuns) -> OpenEffect:
    kinds = ((62.0, 150.0), (35.0, 25.0), (72.0, 8.0))
    centre, width = kinds[runs.generator.integers(len(kinds))]
    reference, kind = runs.middle("relative_humidity_pct"), EFFECTS["humidity"]
    return by_its_formula(
        lambda a: kind(k=-a, centre=centre, width=width, reference=reference), 0.9, runs
    )


def patch(runs: CleanRuns) -> OpenEffect:
    centre = float(np.quantile(runs.columns["position_m"], runs.generator.uniform(0.3, 0.7)))
    width, kind = runs.generator.uniform(50.0, 110.0), EFFECTS["patch"]
    return by_its_formula(
        lambda depth: kind(depth=depth, centre=centre, width=width, flatness=2.0), 0.9, runs
    )


def wheel_order(runs: CleanRuns) -> OpenEffect:
    return _wave("wheel_order", float(runs.generator.integers(1, 4)), runs)


def rail_joint(runs: CleanRuns) -> OpenEffect:
    return _wave("rail_joint", runs.generator.uniform(9.0, 33.0), runs)


def _wave(name: str, place: float, runs: CleanRuns) -> OpenEffect:
    """A wave without a second harmonic, of this order or length."""
    sine, cosine = np.sin(runs.phase), np.cos(runs.phase)
    return by_its_formula(lambda a: EFFECTS[name](a * sine, a * cosine, 0.0, 0.0, place), 0.9, runs)


def drift(runs: CleanRuns) -> OpenEffect:
    kinds = ((0.5, 3.0), (runs.generator.uniform(0.3, 0.7), 0.03))
    centre, width = kinds[runs.generator.integers(len(kinds))]
    kind = EFFECTS["drift"]
    return by_its_formula(lambda k: kind(k=k, centre=centre, width=width, reference=0.5), 0.9, runs)


def slip_noise(runs: CleanRuns) -> OpenEffect:
    """White noise of `sigma` on the slip signal, after the adhesion was made."""
    noise = runs.generator.standard_normal(runs.slip.shape)

    def make(amount: float) -> Planted:
        return Planted(
            4, unchanged, unchanged, lambda slip: slip + amount * noise, {"sigma": amount}
        )

    return OpenEffect(make, 0.02)


def torsion(runs: CleanRuns) -> OpenEffect:
    """Mu + a sin(2 pi f t + phase of the run), f .5 to 3 Hz, t from the start of the run."""
    time = runs.columns["time_s"] - runs.columns["time_s"][:, :1]
    frequency = runs.generator.uniform(0.5, 3.0)
    phases = runs.generator.uniform(0, 2 * np.pi, (len(time), 1))
    wave = np.sin(2 * np.pi * frequency * time + phases)

    def make(amount: float) -> Planted:
        values = {"amplitude": amount, "frequency_hz": frequency}
        return Planted(3, unchanged, lambda adhesion: adhesion + amount * wave, unchanged, values)

    return OpenEffect(make, 0.3)


def unknown_column(runs: CleanRuns) -> OpenEffect:
    """The level falls with a column that no cause of the catalogue knows."""
    place, spread = runs.middle("rail_age_days"), float(np.std(runs.columns["rail_age_days"]))
    return by_its_formula(lambda a: Covariate(-a, place, spread, "rail_age_days"), 0.9, runs)


def product(runs: CleanRuns) -> OpenEffect:
    """Mu exp(k u v), u and v two columns less their means, over their standard deviations."""
    columns = [runs.columns[name] for name in ("gradient_permille", "temperature_C")]
    u, v = ((values - np.mean(values)) / np.std(values) for values in columns)
    first, second = (float(np.std(values)) for values in columns)

    def make(amount: float) -> Planted:
        change = np.exp(amount * u * v)
        values = {"k": amount, "first_scale": first, "second_scale": second}
        return Planted(ShapeTerm.ORDER, unchanged, lambda mu: mu * change, unchanged, values)

    return OpenEffect(make, 0.9)


def periodic(runs: CleanRuns) -> OpenEffect:
    """A wave along a column that is neither a position nor an angle."""
    sine, cosine = float(np.sin(runs.phase)), float(np.cos(runs.phase))
    frequency = 1 / runs.generator.uniform(11.0, 29.0)
    return by_its_formula(
        lambda a: Periodic(a * sine, a * cosine, frequency, "groove_depth_um"), 0.9, runs
    )


_OF_CATALOGUE = {
    "speed": Planting(of_strength(EFFECTS["speed"], 3.0)),
    "slip_speed": Planting(of_strength(EFFECTS["slip_speed"], 1.5)),
    "falling_friction": Planting(of_strength(EFFECTS["falling_friction"], 0.9, b=(0.3, 1.5))),
    "load_peak": Planting(of_strength(EFFECTS["load_peak"], 2.8)),
    "load_slope": Planting(of_strength(EFFECTS["load_slope"], 2.8)),
    "contact_heating": Planting(of_strength(EFFECTS["contact_heating"], 15.0)),
    "cleaning": Planting(of_strength(EFFECTS["cleaning"], 4.0, work=(0.3, 1.0), load_power=1.0)),
    "sanding": Planting(of_strength(EFFECTS["sanding"], 2.5, build_up=1.0, decay=(3.0, 10.0))),
    "axle_position": Planting(axle_position, chosen("axle")),
    "lateral_creep": Planting(
        of_strength(EFFECTS["lateral_creep"], 45.0, offset=0.0), chosen("angle_of_attack_deg")
    ),
    "load_transfer": Planting(of_strength(EFFECTS["load_transfer"], 0.9)),
    "mode_asymmetry": Planting(of_strength(EFFECTS["mode_asymmetry"], 0.9)),
    "humidity": Planting(humidity),
    "temperature": Planting(of_strength(EFFECTS["temperature"], 0.09)),
    "patch": Planting(patch),
    "curve": Planting(of_strength(EFFECTS["curve"], 280.0)),
    "wheel_order": Planting(wheel_order, chosen("wheel_angle_rad")),
    "rail_joint": Planting(rail_joint),
    "drift": Planting(drift),
    "relaxation": Planting(of_strength(EFFECTS["relaxation"], 90.0)),
    "delay": Planting(of_strength(EFFECTS["delay"], 4.0)),
    "lag": Planting(of_strength(EFFECTS["lag"], 15.0)),
    "hysteresis": Planting(of_strength(EFFECTS["hysteresis"], 0.9, rate=(0.01, 0.04), memory=0.0)),
    "slip_bias": Planting(of_strength(EFFECTS["slip_bias"], 0.045)),
    "torque_offset": Planting(of_strength(EFFECTS["torque_offset"], 0.4)),
    "inertia": Planting(of_strength(EFFECTS["inertia"], 0.9)),
}

#: Everything that can be planted, by its name: the causes in the order of the catalogue, and those
#: that it lacks.
PLANTABLE: dict[str, Planting] = {
    **{name: _OF_CATALOGUE[name] for name in EFFECTS if name in _OF_CATALOGUE},
    "slip_noise": Planting(slip_noise, is_noise=True),
    "torsion": Planting(torsion, is_noise=True),
    "unknown_column": Planting(unknown_column),
    "product": Planting(product, chosen("gradient_permille")),
    "periodic": Planting(periodic, chosen("groove_depth_um")),
}
