"""Loops of many short steps, compiled as one function of the processor.

The compiler makes a function of every few operations, so that a step of a loop is a dozen calls or
more, each with its own pass over the runs; with a hundred runs the calls take longer than the work.
"""

from collections.abc import Callable
from functools import partial, wraps
from typing import Any, ParamSpec, TypeVar

import jax
from jax.extend.core import Primitive
from jax.interpreters import ad, batching, mlir

P = ParamSpec("P")
T = TypeVar("T")
C = TypeVar("C")
X = TypeVar("X")


def in_one_kernel(function: Callable[P, T]) -> Callable[P, T]:
    """The function, all of which the CPU computes in one call, with the loops in it.

    It must use all its arguments, and what calls a library is not possible in it: a sort, a
    scatter, a sum over an axis, or LAPACK. On other processors it changes nothing.
    """
    return _called(function, inlineable="false", xla_cpu_small_call="true")


def scan_in_one_kernel(
    step: Callable[[C, X], tuple[C, None]], start: C, given: X
) -> tuple[C, None]:
    """`jax.lax.scan` of a step that returns nothing else than the carry, in one kernel."""

    def scan(start: C, given: X) -> C:
        return jax.lax.scan(step, start, given)[0]

    steps = len(jax.tree.leaves(given)[0])
    return (in_one_kernel(scan) if steps else scan)(start, given), None


def computed_once(function: Callable[P, T]) -> Callable[P, T]:
    """The function, whose results are stored, where it is part of a kernel.

    Otherwise the compiler repeats whatever is cheap in each of the passes that use it, and
    what is cheap adds up.
    """
    return _called(function, inlineable="false")


def _called(function: Callable[P, T], **marks: str) -> Callable[P, T]:
    """The function as one that is called, with these marks on the call."""
    compiled = jax.jit(function)

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        # Constants among the arguments, put into a kernel, would leave some of its arguments
        # without use, over which the compiler may end the process (jax 0.10).
        given = jax.lax.optimization_barrier((args, kwargs))
        found: T = jax.tree.map(partial(_mark.bind, **marks), compiled(*given[0], **given[1]))
        return found

    return called


def _mark_the_call(context: mlir.LoweringRuleContext, value: Any, **marks: str) -> list[Any]:
    """Mark the call that a value comes from, in a program that is made for the CPU alone."""
    ir: Any = mlir.ir
    on_cpu = tuple(context.module_context.platforms) == ("cpu",)
    # What a call only passes on comes from elsewhere.
    if on_cpu and getattr(value.owner, "name", None) == "func.call":
        attributes = {name: ir.StringAttr.get(told) for name, told in marks.items()}
        value.owner.attributes["mhlo.frontend_attributes"] = ir.DictAttr.get(attributes)
    return [value]


#: Its result is its argument, and in a compiled program the call that it comes from is marked.
#: What is differentiated has no mark: the compiler may end the process over it (jax 0.10).
_mark = Primitive("mark")
_mark.def_impl(lambda value, **_: value)
_mark.def_abstract_eval(lambda value, **_: value)
batching.defvectorized(_mark)
ad.primitive_jvps[_mark] = lambda primals, tangents, **_: (*primals, *tangents)
mlir.register_lowering(_mark, _mark_the_call, cacheable=False)
