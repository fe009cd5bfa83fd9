"""Causes in the signals and in the dynamics of the contact, as they are planted."""

from collections.abc import Mapping

import numpy as np

from adhesion_jax.effects.delay import Delay
from adhesion_jax.effects.hysteresis import Hysteresis
from adhesion_jax.effects.inertia import Inertia
from adhesion_jax.effects.lag import Lag
from adhesion_jax.effects.relaxation import Relaxation
from adhesion_jax.effects.slip_bias import SlipBias
from adhesion_jax.effects.torque_offset import TorqueOffset
from adhesion_jax.simulation.planting import (
    CleanRuns,
    OpenEffect,
    Planted,
    Planting,
    by_factor,
    by_its_formula,
    of_strength,
    planted,
    unchanged,
)


def relaxation_otherwise(runs: CleanRuns) -> OpenEffect:
    """The length shrinks as the contact slides: s/(1 + |l|/.05)."""
    share = 1 / (1 + np.abs(runs.slip) / 0.05) / runs.speed
    return OpenEffect(
        lambda a: planted(a, 2, after=lambda adhesion: runs.lagged(adhesion, a * share)), 90.0
    )


def delay_otherwise(runs: CleanRuns) -> OpenEffect:
    """Not the same in every run: a tenth of spread."""
    clock = runs.columns["time_s"] - runs.columns["time_s"][:, :1]
    spread = 1 + 0.1 * runs.generator.standard_normal((len(clock), 1))

    def late(adhesion: np.ndarray, amount: float) -> np.ndarray:
        each = zip(clock - amount * spread, clock, adhesion, strict=True)
        return np.stack([np.interp(*run) for run in each])

    return OpenEffect(lambda a: planted(a, 2, after=lambda adhesion: late(adhesion, a)), 4.0)


def lag_otherwise(runs: CleanRuns) -> OpenEffect:
    """Two filters of half the time constant, one after the other."""

    def twice(adhesion: np.ndarray, amount: float) -> np.ndarray:
        return runs.lagged(runs.lagged(adhesion, amount / 2), amount / 2)

    return OpenEffect(lambda a: planted(a, 2, after=lambda adhesion: twice(adhesion, a)), 10.0)


def hysteresis(runs: CleanRuns) -> OpenEffect:
    rate = runs.generator.uniform(0.01, 0.04)
    return by_its_formula(lambda k: Hysteresis(k=k, rate=rate, memory=0.0), 0.9, runs)


def hysteresis_otherwise(runs: CleanRuns) -> OpenEffect:
    """1 + a h, h the last direction in which slip went, forgotten over .3 s."""
    memory = runs.lagged(np.sign(runs.rate(np.abs(runs.slip))), 0.3)
    return by_factor(lambda a: 1 + a * memory, 0.9)


def slip_bias_otherwise(_: CleanRuns) -> OpenEffect:
    """A wrong radius stretches the slip a little as well: l + a sign(l) (1 + |l|)."""

    def biased(slip: np.ndarray, amount: float) -> np.ndarray:
        return slip + amount * np.sign(slip) * (1 + np.abs(slip))

    return OpenEffect(lambda a: planted(a, 0, before=lambda slip: biased(slip, a)), 0.04)


def torque_offset_otherwise(runs: CleanRuns) -> OpenEffect:
    """Mu + a (1 + .3 V/15) sign(l): friction in the bearings grows with the speed."""
    loss = (1 + 0.3 * runs.speed / 15) * np.sign(runs.slip)
    return OpenEffect(lambda a: planted(a, 1, after=lambda adhesion: adhesion + a * loss), 0.3)


def inertia_otherwise(runs: CleanRuns) -> OpenEffect:
    """The acceleration has passed a filter of .15 s."""
    filtered = runs.lagged(runs.rate(runs.speed * (1 + runs.slip)), 0.15)
    return OpenEffect(lambda a: planted(a, 2, after=lambda adhesion: adhesion + a * filtered), 0.9)


def slip_noise_otherwise(runs: CleanRuns) -> OpenEffect:
    """White noise of `sigma` on the slip signal, after the adhesion was made."""
    noise = runs.generator.standard_normal(runs.slip.shape)

    def make(amount: float) -> Planted:
        return Planted(
            3, unchanged, unchanged, lambda slip: slip + amount * noise, {"sigma": amount}
        )

    return OpenEffect(make, 0.02)


SIGNALS: Mapping[str, Planting] = {
    "relaxation": Planting(of_strength(Relaxation, 90.0), relaxation_otherwise),
    "delay": Planting(of_strength(Delay, 4.0), delay_otherwise),
    "lag": Planting(of_strength(Lag, 15.0), lag_otherwise),
    "hysteresis": Planting(hysteresis, hysteresis_otherwise),
    "slip_bias": Planting(of_strength(SlipBias, 0.045), slip_bias_otherwise),
    "torque_offset": Planting(of_strength(TorqueOffset, 0.4), torque_offset_otherwise),
    "inertia": Planting(of_strength(Inertia, 0.9), inertia_otherwise),
    "slip_noise": Planting(None, slip_noise_otherwise),
}
