"""The option --list: all names that may stand in the other options of a command."""

from collections.abc import Callable, Iterable, Mapping

import click


def listing(**kinds: Iterable[str]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A decorator that gives a command the option; names may be mapped to words about them."""

    def tell(context: click.Context, _: click.Parameter, wanted: bool) -> None:
        if not wanted or context.resilient_parsing:
            return
        for kind, names in kinds.items():
            told = names if isinstance(names, Mapping) else dict.fromkeys(names, "")
            width = max(map(len, told))
            click.echo(kind)
            for name, words in told.items():
                click.echo(f"  {name:<{width}}  {words}".rstrip())
        context.exit()

    return click.option(
        "--list",
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=tell,
        help="Show the names that the options know.",
    )
