"""The command `adhesion`: its sub-commands, of which only the one that is named is imported."""

from importlib import import_module

import click

from adhesion_jax.command_line.command import run
from adhesion_jax.errors import InputError
from adhesion_jax.wording import listed

#: What is said of each command where all are listed; the name is that of its module.
COMMANDS = {
    "montecarlo": "Identify thousands of noisy adhesion curves and compare the methods.",
    "status": "Say how far a job in shards is, and what its finished runs tell.",
    "identify": "Fit adhesion curves to measured points and say what they are worth.",
    "track": "Follow a log by online methods, and draw what they know over time.",
    "discover": "Find what an adhesion curve lacks in measured runs.",
    "simulate": "Write a simulated log of a locomotive, of which the truth is known.",
    "plan": "Say how many samples, and up to which slip, it takes to know the peak.",
    "traction": "Run a published traction control system on its plant.",
    "rerun": "Repeat the command that wrote the results in a folder.",
}


class Commands(click.Group):
    """Sub-commands that are imported when they are named, for the others take seconds."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return [*COMMANDS]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = import_module(f"adhesion_jax.command_line.{cmd_name}").main
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0] not in COMMANDS and not ctx.resilient_parsing:
            raise InputError(f"{args[0]} is no command; name {listed([*COMMANDS], 'or')}.")
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl([*COMMANDS.items()])


@click.command(cls=Commands, invoke_without_command=True)
@click.version_option(package_name="adhesion-jax", prog_name="adhesion")
@click.pass_context
def adhesion(context: click.Context) -> None:
    """Identify wheel-rail adhesion curves, and learn how well any method can know them."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


def main() -> None:
    """The console command."""
    run(adhesion)
