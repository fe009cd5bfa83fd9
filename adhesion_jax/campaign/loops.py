"""Closed loops that are computed side by side by one program: their figures, and what is drawn."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from adhesion_jax.campaign.keys import noise_keys
from adhesion_jax.metrics import closed_loop
from adhesion_jax.metrics.closed_loop import FIGURES, Totals
from adhesion_jax.programs import QUICKLY, WIDELY, Timed, kept
from adhesion_jax.traction.loop import Loop, Timing, Trace, run, trace

#: Largest number of rows of a run that is drawn.
_ROWS = 3000

Figures = Mapping[str, np.ndarray]  # by name: [runs, segments, of which the last is the whole run]


class Computed(NamedTuple):
    """What loops side by side came to, and what they took; all arrays are of NumPy."""

    figures: Figures
    course: Any  # of those that are drawn or followed, [loops, rows, ...]; None where none is
    steps: int  # of the plant, of all runs
    seconds: float  # CPU time, without compilation
    compile_seconds: float  # wall-clock time

    @staticmethod
    def of(found: Timed, runs: int, grid: Timing) -> "Computed":
        """From the result of a program of some runs, which are figures and courses."""
        figures, course = jax.tree.map(np.asarray, found.result)
        steps = runs * grid.samples * grid.sample * grid.control
        return Computed(figures, course, steps, found.seconds, found.compile_seconds)

    def took(self) -> Mapping[str, np.ndarray]:
        """What the runs took, to be stored."""
        names = ("seconds", "compile_seconds", "steps")
        return {name: np.array(getattr(self, name)) for name in names}


def computed(
    loops: Sequence[Loop], grid: Timing, seed: int, scenario: str, numbers: range, drawn: bool
) -> Computed:
    """Some loops, each with the noise of its number, or one with that of many; drawn or not."""
    keys = noise_keys(seed, scenario, jnp.asarray(numbers))
    stacked = jax.tree.map(lambda *x: jnp.stack([*map(jnp.asarray, x)]), *loops)
    return Computed.of((_drawn if drawn else _noisy).timed(stacked, keys, grid), len(numbers), grid)


def form_of(loop: Loop) -> object:
    """The key of a loop: loops of equal keys are run by one program."""
    return jax.tree.structure(loop), tuple(jnp.shape(leaf) for leaf in jax.tree.leaves(loop))


# What is drawn runs once, and takes longer to compile than to run.
@kept(compiler=QUICKLY, static=(2,))
def _drawn(loops: Loop, keys: jax.Array, grid: Timing) -> tuple[dict[str, jax.Array], Trace]:
    """The figures of a stack of loops under their keys, and the rows of what is drawn."""
    least = max(-(-grid.samples // _ROWS), 1)
    # From one row to the next: the smallest number of samples that divides the run.
    every = next(n for n in range(least, grid.samples + 1) if grid.samples % n == 0)

    def of_loop(loop: Loop, key: jax.Array) -> tuple[dict[str, jax.Array], Trace]:
        totals, rows = trace(loop, grid, key, every)
        return figures_of(totals, grid), rows

    return jax.vmap(of_loop)(loops, keys)


@kept(compiler=WIDELY, static=(2,))
def _noisy(loops: Loop, keys: jax.Array, grid: Timing) -> tuple[dict[str, jax.Array], None]:
    """The figures of the first of a stack of loops under each of the keys."""
    loop = jax.tree.map(lambda x: x[0], loops)
    return jax.vmap(lambda key: figures_of(run(loop, grid, key), grid))(keys), None


def figures_of(totals: Totals, grid: Timing) -> dict[str, jax.Array]:
    """The figures of each segment and, last, of the whole run."""
    parts = (closed_loop.by_segment(totals), closed_loop.whole(totals))
    found = [closed_loop.figures(part, grid.sample_period) for part in parts]
    return {name: jnp.concatenate([1.0 * part[name] for part in found]) for name in FIGURES}
