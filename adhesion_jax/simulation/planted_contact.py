"""Causes in the contact of wheel and rail, as they are planted in simulated runs."""

from collections.abc import Mapping

import numpy as np

from adhesion_jax.effects.axle_position import AxlePosition
from adhesion_jax.effects.cleaning import Cleaning
from adhesion_jax.effects.contact_heating import ContactHeating
from adhesion_jax.effects.falling_friction import FallingFriction
from adhesion_jax.effects.lateral_creep import LateralCreep
from adhesion_jax.effects.load_peak import LoadPeak
from adhesion_jax.effects.load_slope import LoadSlope
from adhesion_jax.effects.load_transfer import LoadTransfer
from adhesion_jax.effects.mode_asymmetry import ModeAsymmetry
from adhesion_jax.effects.sanding import Sanding
from adhesion_jax.effects.slip_speed import SlipSpeed
from adhesion_jax.effects.speed import Speed
from adhesion_jax.simulation.planting import (
    CleanRuns,
    OpenEffect,
    Planted,
    Planting,
    by_factor,
    by_its_formula,
    chosen,
    of_strength,
    planted,
)


def speed_otherwise(runs: CleanRuns) -> OpenEffect:
    """1/(1 + a V/20)."""
    return by_factor(lambda a: 1 / (1 + a * runs.speed / 20), 5.0)


def slip_speed_otherwise(runs: CleanRuns) -> OpenEffect:
    """1/(1 + a w)^2, w the slip velocity."""
    return by_factor(lambda a: 1 / (1 + a * runs.slip_velocity) ** 2, 5.0)


def falling_friction(runs: CleanRuns) -> OpenEffect:
    b = runs.generator.uniform(0.3, 1.5)
    return by_its_formula(lambda drop: FallingFriction(drop=drop, b=b), 0.9, runs)


def falling_friction_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 - a + a/(1 + w/.6), w the slip velocity."""
    return by_factor(lambda a: 1 - a + a / (1 + runs.slip_velocity / 0.6), 0.95)


def load_peak_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 - a (F/150 kN)^2."""
    square = (runs.columns["normal_load_N"] / 150e3) ** 2
    return by_factor(lambda a: 1 - a * square, 0.95)


def load_slope_otherwise(runs: CleanRuns) -> OpenEffect:
    """l/(1 + a (F/F0)^2)."""
    square = (runs.columns["normal_load_N"] / runs.middle("normal_load_N")) ** 2
    return OpenEffect(lambda a: planted(a, 0, before=lambda slip: slip / (1 + a * square)), 5.0)


def contact_heating_otherwise(runs: CleanRuns) -> OpenEffect:
    """1/(1 + a |l| sqrt(V))."""
    flash = np.abs(runs.slip) * np.sqrt(runs.speed)
    return by_factor(lambda a: 1 / (1 + a * flash), 20.0)


def cleaning(runs: CleanRuns) -> OpenEffect:
    work = runs.generator.uniform(0.3, 1.0)
    return by_its_formula(lambda k: Cleaning(k=k, work=work, load_power=1.0), 4.0, runs)


def cleaning_otherwise(runs: CleanRuns) -> OpenEffect:
    """(1 - s) dirty + s clean, s = 1 - exp(-W/W0): two curves, as in Voltr and Lata 2015."""
    power = np.abs(runs.curve(runs.slip)) * runs.slip_velocity
    clean = -np.expm1(-np.cumsum(power * runs.step, axis=1) / runs.generator.uniform(0.3, 1.0))
    flatter = runs.curve(0.6 * runs.slip) / runs.curve(runs.slip)
    return by_factor(lambda a: (1 - clean) * ((1 - a) * flatter**a) + clean, 0.95)


def sanding(runs: CleanRuns) -> OpenEffect:
    decay = runs.generator.uniform(3.0, 10.0)
    return by_its_formula(lambda k: Sanding(k=k, build_up=1.0, decay=decay), 2.5, runs)


def sanding_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 + a s: sand arrives at once after .5 to 1 s and wears off linearly over 4 to 8 s."""
    dead = round(runs.generator.uniform(0.5, 1.0) / runs.step)
    flag = np.pad(runs.columns["sanding"], ((0, 0), (dead, 0)))[:, : runs.slip.shape[1]]
    loss = runs.step / runs.generator.uniform(4.0, 8.0)
    sand = flag.copy()
    for k in range(1, sand.shape[1]):
        sand[:, k] = np.maximum(flag[:, k], sand[:, k - 1] - loss)
    return by_factor(lambda a: 1 + a * sand, 2.5)


def axle_position(runs: CleanRuns) -> OpenEffect:
    return by_its_formula(
        lambda a: AxlePosition(k1=0.4 * a, k2=0.7 * a, k3=1.0 * a, k4=1.0 * a, k5=1.0 * a),
        2.5,
        runs,
    )


def axle_position_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 + a (1 - 2^-(j - 1)) at axle j, counted from 1."""
    clean = 1 - 0.5 ** (runs.columns["axle"] - 1)
    return by_factor(lambda a: 1 + a * clean, 2.5)


def lateral_creep_otherwise(runs: CleanRuns) -> OpenEffect:
    """The powers of 1.6 add up instead of the squares."""
    lateral = np.abs(np.tan(np.deg2rad(runs.columns["angle_of_attack_deg"])))

    def total(slip: np.ndarray, amount: float) -> np.ndarray:
        return (np.abs(slip) ** 1.6 + (amount * lateral) ** 1.6) ** (1 / 1.6)

    def make(amount: float) -> Planted:
        share = np.abs(runs.slip) / total(runs.slip, amount)
        return planted(
            amount,
            0,
            before=lambda slip: np.sign(slip) * total(slip, amount),
            after=lambda adhesion: adhesion * share,
        )

    return OpenEffect(make, 30.0)


def load_transfer_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 + a tanh(dV/dt/.5)."""
    change = np.tanh(runs.rate(runs.speed) / 0.5)
    return by_factor(lambda a: 1 + a * change, 0.9)


def mode_asymmetry_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 - a |l|/(|l| + .01) in braking."""
    braking = (runs.slip < 0) * np.abs(runs.slip) / (np.abs(runs.slip) + 0.01)
    return by_factor(lambda a: 1 - a * braking, 0.95)


CONTACT: Mapping[str, Planting] = {
    "speed": Planting(of_strength(Speed, 3.0), speed_otherwise),
    "slip_speed": Planting(of_strength(SlipSpeed, 1.5), slip_speed_otherwise),
    "falling_friction": Planting(falling_friction, falling_friction_otherwise),
    "load_peak": Planting(of_strength(LoadPeak, 2.8), load_peak_otherwise),
    "load_slope": Planting(of_strength(LoadSlope, 2.8), load_slope_otherwise),
    "contact_heating": Planting(of_strength(ContactHeating, 15.0), contact_heating_otherwise),
    "cleaning": Planting(cleaning, cleaning_otherwise),
    "sanding": Planting(sanding, sanding_otherwise),
    "axle_position": Planting(axle_position, axle_position_otherwise, chosen("axle")),
    "lateral_creep": Planting(
        of_strength(LateralCreep, 45.0, offset=0.0),
        lateral_creep_otherwise,
        chosen("angle_of_attack_deg"),
    ),
    "load_transfer": Planting(of_strength(LoadTransfer, 0.9), load_transfer_otherwise),
    "mode_asymmetry": Planting(of_strength(ModeAsymmetry, 0.9), mode_asymmetry_otherwise),
}
