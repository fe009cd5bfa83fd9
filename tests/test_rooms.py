"""The order of the rooms: each imports from those beneath it alone."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "adhesion_jax"

#: From the ground up; what stands in one line does not import each other.
STOREYS = (
    ("errors", "wording", "keeping"),
    ("runtime", "options"),
    ("programs", "plugins"),
    ("files", "curves"),
    ("records", "optim"),
    ("effects", "metrics"),
    ("scenarios", "simulation", "data"),
    ("identifiers", "traction"),
    ("inference",),
    ("measured", "discovery"),
    ("campaign", "planning"),
    ("studies",),
    ("report",),
    ("library",),
    ("commands",),
    ("command_line",),
    ("__main__",),
)
#: The same within the discovery.
DISCOVERY = ("types", "model", "search", "findings", "engine")

HEIGHT = {room: height for height, storey in enumerate(STOREYS) for room in storey}


def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def imports(tree):
    """The modules of the package that a part of a file imports, lazy imports included."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            if node.module == "adhesion_jax":
                yield from (f"adhesion_jax.{name.name}" for name in node.names)
            elif node.module.startswith("adhesion_jax."):
                yield node.module
        elif isinstance(node, ast.Import):
            yield from (name.name for name in node.names if name.name.startswith("adhesion_jax."))


def room_of(module):
    return module.split(".")[1]


def files():
    return sorted(PACKAGE.rglob("*.py"))


def test_every_room_has_its_storey():
    rooms = {path.relative_to(PACKAGE).parts[0].removesuffix(".py") for path in files()}
    assert rooms - {"__init__"} == set(HEIGHT)


@pytest.mark.parametrize("room", HEIGHT)
def test_no_arrow_points_upwards(room):
    wrong = []
    for path in files():
        if path.relative_to(PACKAGE).parts[0].removesuffix(".py") != room:
            continue
        for module in imports(tree_of(path)):
            other = room_of(module)
            if other != room and HEIGHT[other] >= HEIGHT[room]:
                wrong.append(f"{path.relative_to(PACKAGE)} imports {module}")
    assert not wrong, "\n".join(wrong)


def test_no_import_of_the_package_is_inside_a_function():
    """A lazy import hides a circle. In the command line it is the wiring: help needs no rooms."""
    lazy = []
    for path in files():
        if path.is_relative_to(PACKAGE / "command_line"):
            continue
        for function in ast.walk(tree_of(path)):
            if isinstance(function, ast.FunctionDef):
                inside = ast.Module(body=function.body, type_ignores=[])
                lazy += [f"{path.relative_to(PACKAGE)}: {name}" for name in imports(inside)]
    assert not lazy, "\n".join(lazy)


def test_the_discovery_goes_from_what_is_fitted_to_what_is_told():
    wrong = []
    for path in files():
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        if parts[0] == "discovery" and parts[1] in DISCOVERY:
            for module in imports(tree_of(path)):
                other = module.split(".")[2:3]
                inside = room_of(module) == "discovery" and other[0] != parts[1]
                if inside and DISCOVERY.index(other[0]) > DISCOVERY.index(parts[1]):
                    wrong.append(f"{'.'.join(parts)} imports {module}")
    assert not wrong, "\n".join(wrong)
