"""What is public tells its arguments or fields one a line, as the page of public names shows."""

import re
from dataclasses import is_dataclass
from inspect import Parameter, getdoc, isfunction, signature

import equinox as eqx
import pytest

import adhesion_jax

PUBLIC = {name: getattr(adhesion_jax, name) for name in adhesion_jax.__all__}
STARS = {Parameter.VAR_KEYWORD: "**"}


def section(of, title):
    """The names in a section of a docstring, each with words behind it."""
    _, _, after = getdoc(of).partition(f"\n{title}:\n")
    lines = re.match(r"(?: {4}.*\n?|\n(?= {4}))*", after)[0]
    return re.findall(r"^ {4}(\**\w+): \S", lines, re.MULTILINE)


@pytest.mark.parametrize("name", [name for name, one in PUBLIC.items() if isfunction(one)])
def test_a_function_tells_its_arguments_and_what_it_raises(name):
    known = signature(PUBLIC[name])
    arguments = [f"{STARS.get(one.kind, '')}{one.name}" for one in known.parameters.values()]
    assert section(PUBLIC[name], "Args") == arguments
    if known.return_annotation not in (None, "None"):
        assert "\nReturns:\n    " in getdoc(PUBLIC[name])
        assert section(PUBLIC[name], "Raises") == ["InputError"]


FIELDS = {
    name: [
        field
        for kind in reversed(one.__mro__)  # of a result also those that the reports read of it
        if kind is one or (is_dataclass(kind) and not issubclass(kind, eqx.Module))
        for field in vars(kind).get("__annotations__", ())
        if not field.isupper()
    ]
    for name, one in PUBLIC.items()
    if isinstance(one, type)
}


@pytest.mark.parametrize("name", [name for name, fields in FIELDS.items() if fields])
def test_a_class_tells_its_fields(name):
    told = section(PUBLIC[name], "Attributes")
    assert [one for one in told if not one.isupper()] == FIELDS[name]
