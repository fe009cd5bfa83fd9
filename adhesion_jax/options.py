"""What a user may change about a scenario: each scenario declares it by the arguments it takes.

An argument is an option, or a part of the scenario (noise, excitation) whose fields are options:
they are declared once, and the default of the argument gives their defaults.
"""

import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import is_dataclass, replace
from typing import Annotated, Any, NamedTuple, get_args, get_origin

from adhesion_jax.errors import InputError

#: The default of an argument that has none.
_NONE = inspect.Parameter.empty


class Option(NamedTuple):
    """How an argument of a scenario is asked for on the command line."""

    help: str
    low: float | None = None
    high: float | None = None
    low_open: bool = False  # whether the bound itself is left out
    high_open: bool = False

    def holds(self, number: float) -> bool:
        """Whether the number lies in the range."""
        low, high = self.low, self.high
        above = low is None or number > low or (number == low and not self.low_open)
        return above and (high is None or number < high or (number == high and not self.high_open))

    def range(self) -> str:
        """`from 0 to 10`."""
        ends = (("from", self.low), ("to", self.high))
        return " ".join(f"{word} {end:g}" for word, end in ends if end is not None)


#: What can be stated of the noise of a measurement that is planned.
NOISE: dict[str, Option] = {
    "sigma": Option("Standard deviation of the noise of adhesion.", 1e-9, 10),
    "autocorrelation": Option(
        "Correlation of that noise from sample to sample.", 0, 1, high_open=True
    ),
    "run_scatter": Option(
        "Standard deviation of the level of a run, as a share of adhesion.", 0, 1
    ),
    "slow_level": Option("The same of a level that varies slowly within a run.", 0, 1),
    "slow_rows": Option(
        "Samples after which the correlation of the slow level has fallen to 1/e.", 0, 10**9
    ),
    "slip_noise": Option(
        "Standard deviation of the noise of the slip, or of the wheel speed in m/s of a LOG with a "
        "vehicle speed.",
        0,
        10,
    ),
}


#: Most runs of a job, and most blocks of a run: with more a job would not end, or not fit a memory.
MOST_RUNS, _MOST_BLOCKS = 10**9, 1000

Rail = Annotated[str, Option("Rail of a scenario that has one rail.")]
Then = Annotated[str, Option("Rail of the second half of a stream, after a switch.")]
Truth = Annotated[str, Option("Form of the curve that the rail has.")]
Told = Annotated[str, Option("Form of the curve that identifiers are told.")]
Fall = Annotated[
    float, Option("Share of the adhesion that a rail loses in a run.", -1, 1, high_open=True)
]
Shift = Annotated[
    float, Option("Share by which the slip of the peak grows meanwhile.", -1, 10, low_open=True)
]
WaveHeight = Annotated[
    float, Option("Amplitude of a wave of the adhesion, as a share of it.", 0, 0.5)
]
Period = Annotated[float, Option("Samples of a wave.", 2, 10**6)]
Recovery = Annotated[
    float,
    Option(
        "Time constant in samples with which a rail recovers that loses its share of the adhesion "
        "at once in the middle of the run; 0 for a loss spread over the run.",
        0,
        10**6,
    ),
]
Sigma = Annotated[float, Option("Noise of the adhesion signal.", 0, 10)]
Points = Annotated[int, Option("Points in a block, or samples of a stream.", 4, 10**6)]
SlipMax = Annotated[float, Option("Largest slip of the excitation.", 0, 1, low_open=True)]
SlipNoise = Annotated[float, Option("Standard deviation of the noise of the measured slip.", 0, 1)]
Outliers = Annotated[
    float, Option("Share of points with ten times the noise.", 0, 1, high_open=True)
]
Autocorrelation = Annotated[
    float, Option("Correlation of the noise from sample to sample.", 0, 1, high_open=True)
]
BlockCount = Annotated[int, Option("Blocks of a run.", 1, _MOST_BLOCKS)]


class Options(Mapping[str, Any]):
    """The options that were asked for, by name; what is None was not. Equal ones hash alike."""

    def __init__(self, **asked: object) -> None:
        self._asked = {name: value for name, value in asked.items() if value is not None}

    def __getitem__(self, name: str) -> Any:
        return self._asked[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._asked)

    def __len__(self) -> int:
        return len(self._asked)

    def __hash__(self) -> int:
        return hash(tuple(sorted(self._asked.items())))

    def __repr__(self) -> str:
        return f"Options({', '.join(f'{name}={value!r}' for name, value in self.items())})"


class Declared(NamedTuple):
    """An argument of a scenario."""

    kind: type
    option: Option
    required: bool


def declared(build: Callable[..., Any]) -> Mapping[str, Declared]:
    """The options of a scenario by name, from the annotations of the function that builds it."""
    found: dict[str, Declared] = {}
    for name, argument in _arguments(build).items():
        own = {name: argument}
        if _is_part(argument):
            part = argument.default
            own = {
                field: one if part is _NONE else one.replace(default=getattr(part, field))
                for field, one in _fields(argument).items()
            }
        found |= {field: _declared(one) for field, one in own.items()}
    return found


def arguments_of(build: Callable[..., Any], options: Options) -> dict[str, Any]:
    """The arguments of a scenario that some of its options make; its parts are made of theirs."""
    arguments: dict[str, Any] = {}
    for name, argument in _arguments(build).items():
        if _is_part(argument):
            part = argument.default
            own = {n: options[n] for n in _fields(argument) if n in options}
            arguments[name] = argument.annotation(**own) if part is _NONE else replace(part, **own)
        elif name in options:
            arguments[name] = options[name]
    return arguments


def _fields(argument: inspect.Parameter) -> Mapping[str, inspect.Parameter]:
    """Those of a part: of the kind that is the default, which may be a special one."""
    part = argument.default
    return _arguments(argument.annotation if part is _NONE else type(part))


def _arguments(build: Callable[..., Any]) -> Mapping[str, inspect.Parameter]:
    return inspect.signature(build, eval_str=True).parameters


def _is_part(argument: inspect.Parameter) -> bool:
    return isinstance(argument.annotation, type) and is_dataclass(argument.annotation)


def _declared(argument: inspect.Parameter) -> Declared:
    # Where a scenario works out the default itself, the annotation is a union with None.
    kinds = (argument.annotation, *get_args(argument.annotation))
    annotated = next(kind for kind in kinds if get_origin(kind) is Annotated)
    kind, option = get_args(annotated)
    return Declared(kind, option, argument.default is _NONE)


def check(name: str, known: Mapping[str, Declared], options: Options) -> None:
    """InputError where the scenario of this name does not take an option, or lacks one."""
    for option in options:
        if option not in known:
            raise InputError(
                f"--{_dashed(option)} does not go with --scenario {name}, which takes "
                f"{', '.join(f'--{_dashed(other)}' for other in known)}."
            )
    for option, one in known.items():
        if one.required and option not in options:
            raise InputError(f"--scenario {name} needs --{_dashed(option)}. {one.option.help}")


def check_accepted(identifier: str, scenario: str, reason: str | None) -> None:
    """InputError where there is a reason why an identifier cannot work on a scenario."""
    if reason is not None:
        raise InputError(f"{identifier} cannot be run on {scenario}: {reason}.")


def _dashed(name: str) -> str:
    return name.replace("_", "-")
