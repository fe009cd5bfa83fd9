"""What is to be identified: rail, excitation and noise. A new scenario is one line in SCENARIOS."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from adhesion_jax.options import Options as Options
from adhesion_jax.options import built, check, declared
from adhesion_jax.scenarios.base import Scenario as Scenario
from adhesion_jax.scenarios.blocks import he2018_blocks, single
from adhesion_jax.scenarios.change import Change
from adhesion_jax.scenarios.corrected import corrected
from adhesion_jax.scenarios.course import Group as Group
from adhesion_jax.scenarios.excitation import RandomSlips, Wave
from adhesion_jax.scenarios.growing import he2018_1, qian2024
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.slope import fang2018_slope
from adhesion_jax.scenarios.stream import qian2024_switch, stream

_Builds = Callable[..., Scenario]


def _case(words: str, scenario: _Builds, **defaults: Any) -> _Builds:
    """A scenario with other defaults of its options, described in these words."""
    case = partial(scenario, **defaults)
    case.__doc__ = words
    return case


#: Command-line name to the function that builds the scenario; its arguments are the options that a
#: user may change, with their defaults.
SCENARIOS: Mapping[str, _Builds] = {
    "single": single,
    "coloured": _case(
        "As single, but neighbouring points share their noise (AR(1), 0.8).",
        single,
        noise=Noise(autocorrelation=0.8),
    ),
    "he2018-1": he2018_1,
    "he2018-blocks": he2018_blocks,
    "qian2024": qian2024,
    "qian2024-switch": qian2024_switch,
    "drift": _case(
        "1000 samples while humidity rises from 20 to 100 %, which takes 17 % of the adhesion.",
        stream,
        change=Change(fall=0.17),
    ),
    "fang2018-slope": fang2018_slope,
    "mismatch": _case(
        "As single, but the rail follows Polach's law while Burckhardt's curve is assumed.",
        single,
        truth="polach",
    ),
    "mismatch-kiencke": _case(
        "As mismatch, but Kiencke's curve is assumed, its initial slope known to be the true one.",
        single,
        truth="polach",
        told="kiencke",
    ),
    "corrected": corrected,
    "stream": stream,
    "stream-coloured": _case(
        "As stream, but neighbouring samples share their noise (AR(1), 0.84).",
        stream,
        noise=Noise(autocorrelation=0.84),
    ),
    "stream-outliers": _case(
        "As stream, but 3 % of the samples have ten times the noise.",
        stream,
        noise=Noise(outliers=0.03),
    ),
    "stream-slip-noise": _case(
        "As stream, but the slip is measured with noise of its own (0.001).",
        stream,
        slips=RandomSlips(slip_noise=0.001),
    ),
    "stream-loop": _case(
        "As stream-coloured, but the slip moves slowly across the peak, as in a control loop.",
        stream,
        slips=Wave(points=1000, slip_max=0.2),
        noise=Noise(autocorrelation=0.84),
    ),
    "stream-burckhardt": _case(
        "As stream, but the rail has Burckhardt's curve while Kiencke's is assumed.",
        stream,
        truth="burckhardt",
    ),
    "stream-polach": _case(
        "As stream, but the rail follows Polach's law while Kiencke's curve is assumed.",
        stream,
        truth="polach",
    ),
    "drift-slow": _case(
        "As drift, but ten times as slow: 1.7 % of the adhesion in 1000 samples.",
        stream,
        change=Change(fall=0.017),
    ),
    "drift-fast": _case(
        "As drift, but three times as fast: 51 % of the adhesion in 1000 samples.",
        stream,
        change=Change(fall=0.51),
    ),
    "drift-peak": _case(
        "As drift, while the slip of the peak grows by half.",
        stream,
        change=Change(fall=0.17, shift=0.5),
    ),
    "drift-coloured": _case(
        "As drift, but neighbouring samples share their noise (AR(1), 0.84).",
        stream,
        change=Change(fall=0.17),
        noise=Noise(autocorrelation=0.84),
    ),
    "wave": _case(
        "1000 samples while the adhesion goes up and down by 10 % in 500 samples.",
        stream,
        change=Change(wave=0.1),
    ),
    "switch-drift": _case(
        "From dry to common rail at sample 500, while 17 % of the adhesion are lost in all.",
        stream,
        then="common",
        change=Change(fall=0.17),
    ),
    "recovery": _case(
        "30 % of the adhesion are lost at sample 500 and come back with a time constant of 200.",
        stream,
        change=Change(fall=0.3, recovery=200.0),
    ),
}


def build(name: str, options: Options = Options()) -> Scenario:
    """The scenario of this name with a user's options; InputError where they do not fit it."""
    check(name, declared(SCENARIOS[name]), options)
    return built(SCENARIOS[name], options)


def needs_options(name: str) -> bool:
    """Whether the scenario cannot be built without something that only a user can give."""
    return any(one.required for one in declared(SCENARIOS[name]).values())
