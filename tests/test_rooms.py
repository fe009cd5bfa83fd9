"""The order of the rooms: each imports from those beneath it alone."""

import ast
from pathlib import Path

import pytest

HOME = Path(__file__).parents[1]
PACKAGE, EXPERIMENTS = HOME / "adhesion_jax", HOME / "experiments"

#: From the ground up; what stands in one line does not import each other.
STOREYS = (
    ("errors", "wording", "keeping", "linear_algebra"),
    ("runtime", "options"),
    ("programs", "plugins"),
    ("files", "curves"),
    ("records", "optim"),
    ("effects", "metrics"),
    ("scenarios", "simulation", "data"),
    ("identifiers",),
    ("traction",),
    ("inference",),
    ("measured", "discovery"),
    ("campaign", "planning"),
    ("leaderboard",),
    ("report",),
    ("library",),
    ("command_line",),
    ("__main__",),
)
#: The same within the discovery.
DISCOVERY = ("types", "model", "search", "findings", "engine")

HEIGHT = {room: height for height, storey in enumerate(STOREYS) for room in storey}


def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def imports(tree, of="adhesion_jax"):
    """The modules of a package that a part of a file imports, lazy imports included."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            if node.module == of:
                yield from (f"{of}.{name.name}" for name in node.names)
            elif node.module.startswith(f"{of}."):
                yield node.module
        elif isinstance(node, ast.Import):
            yield from (name.name for name in node.names if f"{name.name}.".startswith(f"{of}."))


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


def test_the_package_needs_nothing_of_the_experiments():
    wrong = [
        f"{path.relative_to(HOME)} imports {module}"
        for path in files()
        for module in imports(tree_of(path), "experiments")
    ]
    assert not wrong, "\n".join(wrong)


def test_an_experiment_imports_itself_the_campaigns_and_the_one_that_it_enlarges():
    """The peers of the discovery are judged by the rules of its study; all have one frame."""
    wrong = []
    for path in EXPERIMENTS.rglob("*.py"):
        own = path.relative_to(EXPERIMENTS).parts[0]
        known = {own, "campaigns", "command", "study"} | (
            {"discovery_study"} if own == "discovery_peers" else set()
        )
        for module in imports(tree_of(path), "experiments"):
            if len(path.relative_to(EXPERIMENTS).parts) > 1 and room_of(module) not in known:
                wrong.append(f"{path.relative_to(HOME)} imports {module}")
    assert not wrong, "\n".join(wrong)


def test_no_import_of_the_project_is_inside_a_function():
    """A lazy import hides a circle. In the command line it is the wiring: help needs no rooms."""
    lazy = []
    for path in (*files(), *EXPERIMENTS.rglob("*.py")):
        if path.is_relative_to(PACKAGE / "command_line"):
            continue
        for function in ast.walk(tree_of(path)):
            if isinstance(function, ast.FunctionDef):
                inside = ast.Module(body=function.body, type_ignores=[])
                names = (*imports(inside), *imports(inside, "experiments"))
                lazy += [f"{path.relative_to(HOME)}: {name}" for name in names]
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
