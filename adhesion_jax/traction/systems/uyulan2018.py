"""The multiple unit of Uyulan, Gokasan and Bogosyan 2018, 10.1007/s40534-018-0158-x."""

import math

from jaxtyping import Array, Float

from adhesion_jax.traction.controllers import CONTROLLERS
from adhesion_jax.traction.controllers.adaptive_robust import AdaptiveRobust
from adhesion_jax.traction.driver import Driver
from adhesion_jax.traction.observers import OBSERVERS
from adhesion_jax.traction.plants.base import GRAVITY
from adhesion_jax.traction.plants.elastic_axles import ElasticAxles
from adhesion_jax.traction.rails import by_time
from adhesion_jax.traction.seekers import SEEKERS, Seeker
from adhesion_jax.traction.surface import exponential
from adhesion_jax.traction.systems.base import Case, System, papers

#: As printed in the second appendix.
SURFACES = {
    "dry": exponential(0.54, 1.2, 1.0),
    "wet": exponential(0.54, 1.2, 0.35),
    "low": exponential(0.54, 1.2, 0.1),
    "very low": exponential(0.54, 1.0, 0.05),
}

#: Table 1: the rails of each column, and what it prints in m/s for tracking and for estimation.
PRINTED = {
    ("dry", "low"): (0.1874, 0.1043),
    ("dry", "low", "very low"): (0.1876, 0.1217),
    ("dry", "very low"): (0.1880, 0.1445),
    ("dry", "wet"): (0.1868, 0.1061),
    ("dry", "wet", "low"): (0.1869, 0.1054),
    ("dry", "wet", "very low"): (0.1870, 0.1248),
}

#: The best slips that the text of section 5 prints, m/s.
PRINTED_BEST_SLIP = {"dry": 1.1841, "wet": 1.1852, "low": 1.1864, "very low": 1.3272}

#: The coefficient of the resistance at rest, as printed, N.
_RESISTANCE = 1109.8

_METHODS = (
    ("true optimum", SEEKERS["true-optimum"]),
    ("as printed", SEEKERS["gradient-uyulan2018"]),
)


#: When a surface may change, s.
STARTS = (0.0, 10.0, 20.0)


def _case(names: tuple[str, ...], method: str, seeker: Seeker, step: float) -> Case:
    # Every ten seconds a switch: from the second rail to itself, where a column has only two.
    three = (*names, names[-1])[:3]
    rails = by_time([SURFACES[name] for name in three], STARTS, step)
    observer, controller = OBSERVERS["super-twisting"], CONTROLLERS["adaptive-robust"]
    segments = (*names, f"{names[-1]} from 20 s")[:3]
    return Case("-".join(names), method, segments, rails, observer, seeker, controller)


def _cases(step: float) -> list[Case]:
    return [_case(names, *method, step) for names in PRINTED for method in _METHODS]


def lyapunov(
    controller: AdaptiveRobust,
    plant: ElasticAxles,
    bound: Float[Array, "*rows axles"],
    error: Float[Array, "*rows axles"],
    largest: Float[Array, "*rows axles"],
) -> Float[Array, "*rows axles"]:
    """L = e^2/2 + (kappa - lam kappa^)^2/(2 sigma lam), in m^2/s^2 (Eq. 31).

    `error` is slip less its reference, `bound` the adapted gain kappa^, `largest` mu_max.
    lam = r i/J_W is what torque does to the slip of a wheel. kappa is the gain that holds slip
    against adhesion and resistance: r (2 W g mu_max r (1/J_W + 1/J_dyn) + r R_0/J_dyn) with
    J_dyn = m_dyn r^2. Eq. 30 lacks the first r.
    """
    radius, inertia = plant.radius, plant.gear_ratio**2 * plant.inertia
    of_train = plant.dynamic_mass * radius**2
    effect = radius * plant.gear_ratio / inertia
    pull = 2 * plant.wheel_load * GRAVITY * largest * radius
    needed = pull * (1 / inertia + 1 / of_train) + radius * _RESISTANCE / of_train
    gap = radius * needed - effect * bound
    return error**2 / 2 + gap**2 / (2 * controller.adaptation * effect)


SYSTEM = System(
    **papers("uyulan2018"),
    plant="uyulan2018",
    step=1e-4,
    control_period=None,  # the paper has none
    duration=30.0,
    train_speed=10.5,
    slip=50 * 0.31 - 10.5,
    slope=math.radians(6.5),
    driver=Driver(traction=17.67e3),
    cases=_cases,
)
