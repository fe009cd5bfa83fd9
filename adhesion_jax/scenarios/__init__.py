"""What is to be identified. A new scenario is one file here and one line in SCENARIOS."""

from collections.abc import Callable, Mapping

from adhesion_jax.options import Options as Options
from adhesion_jax.options import built, check, declared
from adhesion_jax.scenarios.base import Scenario as Scenario
from adhesion_jax.scenarios.blocks import coloured, he2018_blocks, single
from adhesion_jax.scenarios.corrected import corrected
from adhesion_jax.scenarios.course import Group as Group
from adhesion_jax.scenarios.growing import he2018_1, qian2024
from adhesion_jax.scenarios.mismatch import mismatch, mismatch_kiencke
from adhesion_jax.scenarios.slope import fang2018_slope
from adhesion_jax.scenarios.stream import drift, qian2024_switch

#: Command-line name to the function that builds the scenario; its arguments are the options that a
#: user may change, with their defaults.
SCENARIOS: Mapping[str, Callable[..., Scenario]] = {
    "single": single,
    "coloured": coloured,
    "he2018-1": he2018_1,
    "he2018-blocks": he2018_blocks,
    "qian2024": qian2024,
    "qian2024-switch": qian2024_switch,
    "drift": drift,
    "fang2018-slope": fang2018_slope,
    "mismatch": mismatch,
    "mismatch-kiencke": mismatch_kiencke,
    "corrected": corrected,
}


def build(name: str, options: Options = Options()) -> Scenario:
    """The scenario of this name with a user's options; InputError where they do not fit it."""
    check(name, declared(SCENARIOS[name]), options)
    return built(SCENARIOS[name], options)


def needs_options(name: str) -> bool:
    """Whether the scenario cannot be built without something that only a user can give."""
    return any(one.required for one in declared(SCENARIOS[name]).values())
