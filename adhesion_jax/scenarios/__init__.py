"""What is to be identified: rail, excitation and noise. A new scenario is one line in SCENARIOS."""

import tomllib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from adhesion_jax.options import Options as Options
from adhesion_jax.options import arguments_of, check, declared
from adhesion_jax.scenarios.base import Scenario as Scenario
from adhesion_jax.scenarios.catalogue import (
    fang2018_slope,
    he2018_1,
    he2018_blocks,
    qian2024,
    qian2024_switch,
    single,
    stream,
)
from adhesion_jax.scenarios.course import Group as Group
from adhesion_jax.scenarios.excitation import Wave

_Builds = Callable[..., Scenario]


def _case(build: _Builds, words: str, **options: Any) -> _Builds:
    """A scenario with other defaults of its options, described in these words."""
    case = partial(build, **arguments_of(build, Options(**options)))
    case.__doc__ = words
    return case


#: Command-line name to the function that builds the scenario; its arguments are the options that a
#: user may change, with their defaults.
SCENARIOS: dict[str, _Builds] = {
    "single": single,
    "he2018-1": he2018_1,
    "he2018-blocks": he2018_blocks,
    "qian2024": qian2024,
    "qian2024-switch": qian2024_switch,
    "fang2018-slope": fang2018_slope,
    "stream": stream,
    "stream-loop": _case(
        partial(stream, slips=Wave(points=1000, slip_max=0.2)),
        "As stream-coloured, but the slip moves slowly across the peak, as in a control loop.",
        autocorrelation=0.84,
    ),
}
SCENARIOS |= {
    name: _case(SCENARIOS[one.pop("of")], **one)
    for name, one in tomllib.loads(
        Path(__file__).with_name("cases.toml").read_text(encoding="utf-8")
    ).items()
}


def build(name: str, options: Options = Options()) -> Scenario:
    """The scenario of this name with a user's options; InputError where they do not fit it."""
    check(name, declared(SCENARIOS[name]), options)
    return SCENARIOS[name](**arguments_of(SCENARIOS[name], options))


def needs_options(name: str) -> bool:
    """Whether the scenario cannot be built without something that only a user can give."""
    return any(one.required for one in declared(SCENARIOS[name]).values())
