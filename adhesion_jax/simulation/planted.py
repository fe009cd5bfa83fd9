"""Effects to plant in simulated adhesion: the catalogue's own classes, and what is no effect."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from adhesion_jax.curves import Conditions
from adhesion_jax.effects import (
    EFFECTS,
    Covariate,
    Effect,
    Periodic,
    Product,
    ShapeTerm,
)
from adhesion_jax.simulation.runs import Columns, Runs

#: Causes that have no class in the catalogue.
BEYOND = ("torsion", "unknown_column", "product", "periodic")

#: Every name that can be planted.
PLANTABLE = (*EFFECTS, *BEYOND)

#: Columns that a table has only where an effect rests on them.
EXTRA_COLUMNS: Mapping[str, str] = {
    "axle_position": "axle",
    "lateral_creep": "angle_of_attack_deg",
    "wheel_order": "wheel_angle_rad",
    "product": "gradient_permille",
    "periodic": "groove_depth_um",
}

#: Arrays [runs, points] to the like: slip to slip or to adhesion, adhesion to adhesion.
Bend = Callable[[np.ndarray], np.ndarray]


def unbent(signal: np.ndarray) -> np.ndarray:
    return signal


class Planted(NamedTuple):
    """One effect on all runs: adhesion = after(curve(before(slip))), lowest order first."""

    order: int
    before: Bend
    after: Bend
    measured: Bend  # the slip signal that the table is given for the true slip
    parameters: Mapping[str, float]


class Plan(NamedTuple):
    """An effect whose strength is open: `make(amount)`, amount from 0 to `limit`."""

    make: Callable[[float], Planted]
    limit: float


def exact(name: str, runs: Runs, conditions: Conditions, generator: np.random.Generator) -> Plan:
    """The catalogue's own effect; what is open is its strength, the rest is drawn.

    `conditions` are the columns of the runs, completed by what follows from them.
    """
    build = _builder(name, runs.columns, generator)
    true_slip = jnp.asarray(runs.slip)

    def make(amount: float) -> Planted:
        effect = build(amount)
        arrays = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype=float), effect)
        values = {
            field: float(getattr(effect, field))
            for field in (*effect.PARAMETERS,)
            if isinstance(getattr(effect, field), float)
        }

        def before(slip: np.ndarray) -> np.ndarray:
            return np.asarray(_before(arrays, jnp.asarray(slip), conditions))

        def after(adhesion: np.ndarray) -> np.ndarray:
            return np.asarray(_after(arrays, jnp.asarray(adhesion), true_slip, conditions))

        if effect.ORDER > 0:  # no effect of the adhesion bends the slip as well
            return Planted(effect.ORDER, unbent, after, unbent, values)
        return Planted(effect.ORDER, before, after, unbent, values)

    return Plan(make, LIMITS.get(name, 0.9))


def slip_noise(shape: tuple[int, ...], generator: np.random.Generator) -> Plan:
    """White noise of `sigma` on the slip signal, after the adhesion was made."""
    noise = generator.standard_normal(shape)

    def make(amount: float) -> Planted:
        return Planted(3, unbent, unbent, lambda slip: slip + amount * noise, {"sigma": amount})

    return Plan(make, 0.02)


def torsion(columns: Columns, generator: np.random.Generator) -> Plan:
    """Mu + a sin(2 pi f t + phase of the run), f .5 to 3 Hz, t from the start of the run."""
    time = columns["time_s"] - columns["time_s"][:, :1]
    frequency = generator.uniform(0.5, 3.0)
    phase = generator.uniform(0, 2 * np.pi, (len(time), 1))
    wave = np.sin(2 * np.pi * frequency * time + phase)

    def make(amount: float) -> Planted:
        values = {"amplitude": amount, "frequency_hz": frequency}
        return Planted(2, unbent, lambda adhesion: adhesion + amount * wave, unbent, values)

    return Plan(make, 0.3)


#: Largest strength of an effect, inside the bounds of its parameter.
LIMITS: Mapping[str, float] = {
    "speed": 3.0,
    "slip_speed": 1.5,
    "load_peak": 2.8,
    "load_slope": 2.8,
    "temperature": 0.09,
    "contact_heating": 15.0,
    "cleaning": 4.0,
    "sanding": 2.5,
    "axle_position": 2.5,
    "relaxation": 90.0,
    "delay": 4.0,
    "lag": 15.0,
    "curve": 280.0,
    "lateral_creep": 45.0,
    "slip_bias": 0.045,
    "torque_offset": 0.4,
}

Builder = Callable[[float], Effect]


def _builder(name: str, columns: Columns, generator: np.random.Generator) -> Builder:
    """The effect at a strength; whatever else it has is drawn here, once."""
    draw = generator.uniform
    angle = draw(0, 2 * np.pi)
    sine, cosine = float(np.sin(angle)), float(np.cos(angle))

    def middle(column: str) -> float:
        return float(np.median(columns[column]))

    def build(**fixed: Any) -> Callable[..., Effect]:
        kind = EFFECTS[name]
        return lambda **strengths: kind(**fixed, **strengths)

    match name:
        case "speed":
            return _strength("k", build(reference=middle("vehicle_speed_mps")))
        case "load_peak" | "load_slope":
            return _strength("p", build(reference=middle("normal_load_N")))
        case "temperature":
            return _strength("k", build(reference=middle("temperature_C")))
        case "slip_speed":
            return _strength("c4", build())
        case "falling_friction":
            return _strength("drop", build(b=draw(0.3, 1.5)))
        case "humidity":
            centre, width = ((62.0, 150.0), (35.0, 25.0), (72.0, 8.0))[generator.integers(3)]
            fixed = build(centre=centre, width=width, reference=middle("relative_humidity_pct"))
            return lambda amount: fixed(k=-amount)
        case "patch":
            centre = float(np.quantile(columns["position_m"], draw(0.3, 0.7)))
            return _strength("depth", build(centre=centre, width=draw(50.0, 110.0), flatness=2.0))
        case "cleaning":
            return _strength("k", build(work=draw(0.3, 1.0), load_power=1.0))
        case "sanding":
            return _strength("k", build(build_up=1.0, decay=draw(3.0, 10.0)))
        case "axle_position":
            fixed = build()
            shares = {"k1": 0.4, "k2": 0.7, "k3": 1.0, "k4": 1.0, "k5": 1.0}
            return lambda amount: fixed(**{k: share * amount for k, share in shares.items()})
        case "relaxation":
            return _strength("length", build())
        case "delay":
            return _strength("delay", build())
        case "lag":
            return _strength("time_constant", build())
        case "hysteresis":
            return _strength("k", build(rate=draw(0.01, 0.04), memory=0.0))
        case "lateral_creep":
            return _strength("gain", build(offset=0.0))
        case "slip_bias":
            return _strength("bias", build())
        case "torque_offset":
            return _strength("offset", build())
        case "wheel_order" | "rail_joint":
            wave = (
                build(sine2=0.0, cosine2=0.0, order=float(generator.integers(1, 4)))
                if name == "wheel_order"
                else build(sine2=0.0, cosine2=0.0, length=draw(9.0, 33.0))
            )
            return lambda amount: wave(sine=amount * sine, cosine=amount * cosine)
        case "drift":
            centre, width = ((0.5, 3.0), (draw(0.3, 0.7), 0.03))[generator.integers(2)]
            return _strength("k", build(centre=centre, width=width, reference=0.5))
        case "unknown_column":
            age = columns["rail_age_days"]
            place, spread = float(np.median(age)), float(np.std(age))
            return lambda amount: Covariate(-amount, place, spread, "rail_age_days")
        case "product":
            pair = ("gradient_permille", "temperature_C")
            first, second = (float(np.std(columns[column])) for column in pair)
            one, other = (float(np.mean(columns[column])) for column in pair)
            return lambda amount: Product(amount, one / first, other / second, first, second, *pair)
        case "periodic":
            frequency = 1 / draw(11.0, 29.0)
            return lambda amount: Periodic(
                amount * sine, amount * cosine, frequency, "groove_depth_um"
            )
        case _:  # contact_heating, curve, load_transfer, mode_asymmetry, inertia
            return _strength("k", build())


def _strength(field: str, fixed: Callable[..., Effect]) -> Builder:
    return lambda amount: fixed(**{field: amount})


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
