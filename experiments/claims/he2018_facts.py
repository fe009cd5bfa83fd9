"""What He et al. 2018 say beside their experiments, against what they print."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from scipy.stats import qmc

from adhesion_jax.identifiers import IDENTIFIERS, identify
from adhesion_jax.records import Record
from adhesion_jax.scenarios import Scenario
from adhesion_jax.scenarios.rails import RAILS, peak_of
from experiments.claims.claim import (
    ASSUMED,
    CANNOT_BE_CHECKED,
    HE2018,
    PRINTED,
    READ_OFF,
    REPAIRED,
    Claim,
    Verdict,
    below,
    judged,
    near,
    of_settings,
)
from experiments.claims.settings import DRAWS

#: Of the factors of Eq. 4 that are left out: c4 in s/m, slip, speed in m/s, c5 in 1/kN², load of a
#: wheel in kN. c5 is that of a car at one end.
_FACTOR = ((0.001, 0.0, 1.0, 1e-8, 50.0), (0.05, 0.2, 33.0, 1.5e-4, 150.0))

#: Runs of the experiment with a switch in the growing sequence.
_RUNS = 64


def fact_claims(scenario: Scenario, progress: Callable[[str], None]) -> list[Claim]:
    return [
        *_water(),
        _humidity(),
        _left_out(),
        _real_time(),
        _switched(scenario, progress),
    ]


def _water() -> list[Claim]:
    dry = peak_of(RAILS["dry"])[1]
    found = []
    for rail in ("common", "wet"):
        drop = 100 * (1 - peak_of(RAILS[rail])[1] / dry)
        found.append(
            judged(
                HE2018,
                f"Water lowers the adhesion by 40 % (section 1), as Table 1 has it of the {rail} "
                f"rail (to {READ_OFF:.0%})",
                drop,
                "% of the dry rail's largest",
                near(drop, 40.0, READ_OFF),
                PRINTED,
                "Eq. 6 with the parameters of Table 1; the number of section 1 is from a source "
                "that it names.",
                40.0,
            )
        )
    return found


def _humidity() -> Claim:
    return judged(
        HE2018,
        "From 20 to 100 % humidity the adhesion falls by 17 % (section 1)",
        np.nan,
        "%",
        Verdict(CANNOT_BE_CHECKED),
        PRINTED,
        "Nothing in the model depends on humidity; the number is from a source that the paper "
        "names, and the scenario drift uses it.",
        17.0,
    )


def _left_out() -> Claim:
    """The factor exp(-c4 l V) (1 - c5 F^2) of Eq. 4."""
    low, high = map(np.array, _FACTOR)
    share = qmc.Sobol(len(low), rng=0).random(DRAWS)
    c4, slip, speed, c5, load = (low + (high - low) * share).T
    c5 = low[3] * (high[3] / low[3]) ** share[:, 3]
    factor = np.exp(-c4 * slip * speed) * (1 - c5 * load**2)
    return judged(
        HE2018,
        "The last two factors of Eq. 4 are close to 1 (within 5 %)",
        float(np.median(factor)),
        "median factor (1)",
        of_settings(np.abs(factor - 1) < 0.05),
        ASSUMED,
        "c4 and c5 are not printed: c4 from .001 to .05 s/m, slip to .2, 1 to 33 m/s, wheels of 5 "
        "to 15 t, and c5 up to that of a car, .00015 1/kN², with which a locomotive would have no "
        f"adhesion; the least factor is {factor.min():.2g}.",
        1.0,
    )


def _real_time() -> Claim:
    return judged(
        HE2018,
        "The method identifies in real time (section 3)",
        20 * 300 * 500 / 1e6,
        "million points of the curve a block, at most",
        Verdict(CANNOT_BE_CHECKED),
        PRINTED,
        "20 members and 300 generations by Table 2, and 500 points; the time of a block is not "
        "printed.",
    )


def _switched(scenario: Scenario, progress: Callable[[str], None]) -> Claim:
    """Experiment 1 on a rail that gets common in the middle of its one growing sequence."""
    known, sigma = scenario.known, scenario.noise.sigma
    slip = jnp.linspace(0.0, 0.5, 500)
    half = jnp.arange(500) < 250
    clean = jnp.where(half, RAILS["dry"](slip, {}), RAILS["common"](slip, {}))
    mask = jnp.ones(500, dtype=bool)

    @jax.jit
    @jax.vmap
    def largest(key: jax.Array) -> jax.Array:
        adhesion = clean + sigma * jax.random.normal(key, clean.shape)
        record = Record(slip[None], adhesion[None], mask[None], mask[None], {})
        return identify(IDENTIFIERS["ml-exact"], known, record, key).values["mu_max"][-1]

    found = np.asarray(largest(jax.random.split(jax.random.key(0), _RUNS)))
    progress("switched rail")
    truth = peak_of(RAILS["common"])[1]
    off = 100 * np.abs(found / truth - 1)
    error = float(off.std(ddof=1) / np.sqrt(_RUNS))
    return judged(
        HE2018,
        "Exp. 1 considers a rail that is switched: mu_max at the end is near the true value "
        "(within 5 %)",
        float(off.mean()),
        "% of truth",
        below(float(off.mean()), error, 5.0, _RUNS),
        REPAIRED,
        "Dry to slip .25, common from there on, in the one growing sequence of Experiment 1: all "
        "points weigh the same, and the curve that is found is neither rail. The blocks of "
        "Experiment 2 are what follows a switch.",
        error=error,
    )
