"""The three published control systems by name."""

from collections.abc import Mapping

from adhesion_jax.traction.systems import fang2018, hxd1f, uyulan2018
from adhesion_jax.traction.systems.base import System

SYSTEMS: Mapping[str, System] = {
    "uyulan2018": uyulan2018.SYSTEM,
    "fang2018": fang2018.SYSTEM,
    "hxd1f": hxd1f.SYSTEM,
}
