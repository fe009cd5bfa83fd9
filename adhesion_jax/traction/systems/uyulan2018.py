"""The multiple unit of Uyulan, Gokasan and Bogosyan 2018, 10.1007/s40534-018-0158-x."""

import math

from adhesion_jax.traction.controllers import CONTROLLERS
from adhesion_jax.traction.driver import Driver
from adhesion_jax.traction.observers import OBSERVERS
from adhesion_jax.traction.rails import by_time
from adhesion_jax.traction.seekers import SEEKERS, Seeker
from adhesion_jax.traction.sensors import Noise
from adhesion_jax.traction.systems.base import Case, System, exponential

STEP = 1e-4

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

_METHODS = (
    ("true optimum", SEEKERS["true-optimum"]),
    ("as printed", SEEKERS["gradient-uyulan2018"]),
)


def _case(names: tuple[str, ...], method: str, seeker: Seeker) -> Case:
    # Every ten seconds a switch: from the second rail to itself, where a column has only two.
    three = (*names, names[-1])[:3]
    rails = by_time([SURFACES[name] for name in three], [0.0, 10.0, 20.0], STEP)
    observer, controller = OBSERVERS["super-twisting"], CONTROLLERS["adaptive-robust"]
    return Case("-".join(names), method, three, rails, observer, seeker, controller)


SYSTEM = System(
    title="Optimal slip seeking with an adaptive robust controller, Uyulan et al. 2018",
    plant="uyulan2018",
    step=STEP,
    control_period=STEP,  # the paper has no control period
    duration=30.0,
    train_speed=10.5,
    slip=50 * 0.31 - 10.5,
    slope=math.radians(6.5),
    driver=Driver(traction=17.67e3),
    noise=Noise(motor=0.02, train=5e-3),
    cases=[_case(names, method, seeker) for names in PRINTED for method, seeker in _METHODS],
)
