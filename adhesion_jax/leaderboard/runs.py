"""Runs of a method side by side in one program, each with its configuration, rails and noise."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key, PRNGKeyArray
from numpy.typing import NDArray

from adhesion_jax.campaign.loops import Computed, figures_of
from adhesion_jax.identifiers.of_numpy import complain
from adhesion_jax.programs import QUICKLY, WIDELY, kept
from adhesion_jax.traction.entrants import Entrant, configured
from adhesion_jax.traction.families import Family
from adhesion_jax.traction.loop import Loop, Terms, Timing, Trace, trace
from adhesion_jax.traction.seekers.base import Peak

#: Number of runs of a program. A tile is always computed whole, so that a run gives the same bits
#: whatever runs are asked for: matrix products within a method may round differently elsewhere.
TILE = 128

#: The slips in m/s at which the curve of a rail is drawn, closer to each other near zero.
SLIPS = 1.5 * np.linspace(0, 1, 41) ** 2

#: Number of rows of a run that is followed, about.
_ROWS = 300


class Course(NamedTuple):
    """What is followed of a run, arrays [rows, ...] of jax in a program and of NumPy after it."""

    time: Any  # s
    segment: Any
    slip: Any  # of each axle, m/s
    adhesion: Any
    peak_slip: Any  # of the largest adhesion, m/s
    peak_adhesion: Any
    found_slip: Any  # of the peak that the method has identified, m/s; NaN: none
    found_adhesion: Any
    found_slip_se: Any
    found_adhesion_se: Any
    curve: Any  # adhesion of the first axle at SLIPS


def tile(
    terms: Terms,
    timing: Timing,
    entrant: Entrant,
    family: Family,
    points: Float[np.ndarray, "tile numbers"],
    keys: Key[Array, " tile"],
) -> Computed:
    """The runs of a method at some points of its box, on rails drawn from the keys."""
    given = jax.tree.map(jnp.asarray, (terms, entrant, family, points, keys))
    found = _runs.timed(*given, timing)
    complain()
    return Computed.of(found, TILE, timing)


# There is a program for each method and family, and each runs a few times alone: it takes half the
# time to compile at this level, and no longer to run.
@kept(compiler={"xla_backend_optimization_level": "1", **WIDELY, **QUICKLY}, static=(5,))
def _runs(
    terms: Terms,
    entrant: Entrant,
    family: Family,
    points: Float[Array, "tile numbers"],
    keys: Key[Array, " tile"],
    timing: Timing,
) -> tuple[dict[str, Array], Course]:
    rows = min(_ROWS, timing.samples)
    every = next(n for n in range(timing.samples // rows, 0, -1) if timing.samples % n == 0)

    def run(point: Float[Array, " numbers"], key: PRNGKeyArray) -> tuple[dict[str, Array], Course]:
        method = configured(entrant, point)
        of_rails, of_noise = jax.random.split(key)
        loop = family.met(terms.loop(method, family.draw(of_rails, timing.step)))
        totals, seen = trace(loop, timing, of_noise, every)
        return figures_of(totals, timing), _course(loop, timing, seen)

    return jax.vmap(run)(points, keys)


def _course(loop: Loop, timing: Timing, seen: Trace) -> Course:
    sample, seeker = seen.sample, loop.seeker
    found = None if seeker is None else jax.vmap(seeker.identified)(seen.seeker)
    if found is None:
        found = Peak(*[jnp.full_like(sample.slip, jnp.nan)] * 4)

    def curve(row: Trace) -> Float[Array, " slips"]:
        step = jnp.round(row.time / timing.step).astype(int)
        speed = row.sample.train_speed
        surface = loop.rails.present(row.rail, row.sample.segment, step, speed)
        every = jnp.broadcast_to(SLIPS[:, None], (SLIPS.size, sample.slip.shape[-1]))
        return jax.vmap(lambda slip: surface(slip, speed))(every)[:, 0]

    return Course(
        seen.time,
        sample.segment,
        sample.slip,
        sample.adhesion,
        sample.optimum,
        sample.largest,
        *found,
        jax.vmap(curve)(seen),
    )


def standard_error(values: NDArray[np.float64]) -> float:
    """Of the mean of independent values; NaN for a single one."""
    count = len(values)
    return float(np.std(values, ddof=1) / np.sqrt(count)) if count > 1 else float("nan")
