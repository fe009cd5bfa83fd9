"""Functions and records of the package, checked while tests run against the shapes they declare."""

import ast
import sys
from importlib.abc import MetaPathFinder
from importlib.machinery import PathFinder, SourceFileLoader
from typing import get_args

from beartype import beartype
from jaxtyping import AbstractArray, jaxtyped

_PACKAGES = ("adhesion_jax", "experiments")


def _declares_a_shape(hint):
    return (isinstance(hint, type) and issubclass(hint, AbstractArray)) or any(
        map(_declares_a_shape, get_args(hint))
    )


def checked(defined):
    """The function or class, checked at each call if its annotations declare the shape of an array.

    One whose annotations are other types alone is given back: mypy checks those without a run.
    """
    if any(map(_declares_a_shape, getattr(defined, "__annotations__", {}).values())):
        return jaxtyped(defined, typechecker=beartype)
    return defined


class _Decorator(ast.NodeTransformer):
    """Decorates what modules and classes define.

    jaxtyping's own hook decorates what functions define as well, anew at each call of theirs; that
    and the checks of plain types took two fifths of the time of all tests.
    """

    checked = ast.parse("__import__('shapes').checked", mode="eval").body

    def visit_FunctionDef(self, node):
        # Innermost, since outer decorators may hide what is annotated.
        node.decorator_list.append(self.checked)
        return node

    def visit_ClassDef(self, node):
        self.generic_visit(node)
        # Outermost, since it is the decorator of a dataclass that makes what is checked.
        node.decorator_list.insert(0, self.checked)
        return node


class _Loader(SourceFileLoader):
    def get_code(self, fullname):
        # Past the files of compiled modules, which processes without checks read and write.
        path = self.get_filename(fullname)
        tree = _Decorator().visit(ast.parse(self.get_data(path), path))
        return compile(tree, path, "exec", dont_inherit=True)


class _Finder(MetaPathFinder):
    def find_spec(self, fullname, path=None, target=None):
        if fullname.partition(".")[0] not in _PACKAGES:
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(spec.loader.name, spec.loader.path)
        return spec


def install():
    """Check whatever is imported of the package and the experiments from now on."""
    sys.meta_path.insert(0, _Finder())
