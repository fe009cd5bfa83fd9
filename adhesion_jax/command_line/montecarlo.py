"""`adhesion montecarlo`: how well each method knows thousands of noisy adhesion curves."""

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import Any

import click

from adhesion_jax.command_line.catalogue import Scenario, catalogue
from adhesion_jax.command_line.command import (
    SEED,
    Name,
    Names,
    Recorded,
    begin,
    command,
    in_shards,
    listing,
    number_in,
    out_folder,
    record,
    start,
)
from adhesion_jax.options import MOST_RUNS, Declared, Options, check, check_accepted, declared
from adhesion_jax.plugins import part, use

KNOWN = catalogue()
NAMES = KNOWN.names

#: In the place of a scenario: every one that needs no option.
ALL = "all"

#: What is asked of the job; all other options are those of the scenario.
_OF_JOB = ("runs", "seed", "out", "keep", "resume", "extend", "workers", "cluster")


def scenario_options(
    scenarios: Mapping[str, Scenario],
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A decorator that gives a command an option for every argument that some scenario takes."""
    known: dict[str, Declared] = {}
    takers: dict[str, list[str]] = {}
    for scenario, (_, options) in scenarios.items():
        for name, one in options.items():
            known.setdefault(name, one)
            takers.setdefault(name, []).append(scenario)

    def with_options(command: Callable[..., None]) -> Callable[..., None]:
        for name, one in reversed(known.items()):
            some = len(takers[name]) < len(scenarios)
            words = one.option.help + (f" For {', '.join(takers[name])}." if some else "")
            flag = f"--{name.replace('_', '-')}"
            command = click.option(flag, type=_type(name, one), help=words)(command)
        return command

    return with_options


class WithScenario(Recorded):
    """With an option, too, for each argument of a scenario in a file of the user's own."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        pairs = pairwise([word for given in args for word in given.split("=", 1)])
        named = [value for option, value in pairs if option == "--scenario"]
        own = part("scenario", named[-1]) if named else None
        if own is not None:
            start()
            from adhesion_jax.scenarios import SCENARIOS

            scenario = Scenario("", declared(SCENARIOS[use(own)]))
            command = scenario_options({own.name: scenario})(lambda: None)
            ctx.meta[__name__] = click.command()(command).params
        return super().parse_args(ctx, args)

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        own = super().get_params(ctx)
        names = {param.name for param in own}
        return [*own, *(one for one in ctx.meta.get(__name__, ()) if one.name not in names)]


def _type(name: str, one: Declared) -> click.ParamType | type:
    option = one.option
    if name == "rail":
        return Name(NAMES["rails"])
    if one.kind is int:
        return click.IntRange(
            int(option.low or 0), None if option.high is None else int(option.high)
        )
    if one.kind is float:
        return number_in(option)
    return one.kind


@command(
    "montecarlo --scenario single --rail common --runs 200",
    "montecarlo --scenario qian2024-switch --identifiers riv,mine.py:Mine",
    cls=WithScenario,
)
@click.option(
    "--scenario",
    type=Name((*KNOWN.scenarios, ALL), "scenario"),
    help=f"What is identified (by default {' and '.join(NAMES['main_job'])}), FILE.py:NAME, or "
    "all, which says which method to take when.",
)
@click.option(
    "--identifiers",
    type=Names(NAMES["identifiers"], "identifier"),
    help="Names, or FILE.py:NAME, divided by commas; by default all that fit.",
)
@scenario_options(KNOWN.scenarios)
@click.option("--runs", type=click.IntRange(1, MOST_RUNS), default=1000)
@click.option("--seed", type=SEED, default=0)
@out_folder("montecarlo")
@click.option(
    "--keep",
    type=Name(("checkpoints", "all")),
    default="checkpoints",
    help="The blocks whose estimates runs.parquet has: those around a switch and the last, or all.",
)
@in_shards
@listing(
    scenarios={name: scenario.words for name, scenario in KNOWN.scenarios.items()},
    identifiers={
        **dict.fromkeys(NAMES["identifiers"], ""),
        **dict.fromkeys(NAMES["ablations"], "(runs when named)"),
    },
    rails=NAMES["rails"],
)
def main(scenario: Any, identifiers: tuple[Any, ...] | None, **asked: Any) -> None:
    """Identify thousands of noisy adhesion curves and compare the methods."""
    job = {name: asked.pop(name) for name in _OF_JOB}
    for name in identifiers or ():
        if scenario in KNOWN.refusals and name in NAMES["identifiers"]:
            check_accepted(name, scenario, KNOWN.refusals[scenario].get(name))
    if scenario in KNOWN.scenarios:
        check(scenario, KNOWN.scenarios[scenario].options, Options(**asked))
    scenario, names = begin(scenario, identifiers)
    from adhesion_jax.library.montecarlo import montecarlo
    from adhesion_jax.report.montecarlo.tables import told
    from adhesion_jax.runtime import CORES

    job["workers"] = job["workers"] or CORES
    found = montecarlo(scenario, names or None, **job, **asked)
    record(job["out"])
    click.echo(told(found.tables, found.asked.runs, [one.name for one in found.jobs]))
    click.echo(found.remarks, nl=bool(found.remarks))
    click.echo(f"\nWritten to {job['out']} in {found.seconds:.0f} s")
