"""The lines and panels that the figures of all systems share."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from adhesion_jax.report.traction.panels import Line, Mark, Panel
from adhesion_jax.traction.loop import Trace
from adhesion_jax.traction.surface import RailSurface
from adhesion_jax.traction.systems.base import Case

Array = NDArray[np.float64]

TIME = "time (s)"


class Shown(NamedTuple):
    """A case, and its run without noise."""

    case: Case
    trace: Trace


def shown(case: Case, trace: Trace) -> Shown:
    """The rows of the run up to the end of the driver's demand."""
    counts = np.asarray(trace.sample.counts)
    return Shown(case, jax.tree.map(lambda x: jnp.asarray(x[counts]), trace))


class SpeedUnit(NamedTuple):
    """Unit of the speeds in a figure: its name, and how many of it make 1 m/s."""

    name: str
    per_mps: float

    def of(self, speed: ArrayLike) -> Array:
        return self.per_mps * np.asarray(speed)


MPS, KMH = SpeedUnit("m/s", 1.0), SpeedUnit("km/h", 3.6)


def by_method(shown: Sequence[Shown], *methods: str) -> list[Shown]:
    """The runs of these methods, in their order; if there are none, those of the first method."""
    found = [one for method in methods for one in shown if one.case.method == method]
    return found or [one for one in shown if one.case.method == shown[0].case.method]


def mean_of_axles(values: ArrayLike) -> Array:
    return np.asarray(values).mean(axis=-1)


def surfaces(one: Shown) -> Mapping[str, RailSurface]:
    """The rails of a case by their names, each once."""
    found: dict[str, RailSurface] = {}
    for number, name in enumerate(one.case.segments):
        surface = one.case.rails.surface(jnp.asarray(number))
        if not any(eqx.tree_equal(surface, known) for known in found.values()):
            found[name] = surface
    return found


def curves(
    found: Mapping[str, RailSurface], train_speed: float, highest: float, unit: SpeedUnit = MPS
) -> list[Line]:
    """Adhesion over slip velocities up to the highest, which is in the unit."""
    slips = np.linspace(0.0, highest, 300)
    return [
        Line(name, slips, adhesion(surface, slips / unit.per_mps, train_speed))
        for name, surface in found.items()
    ]


def adhesion(surface: RailSurface, slips: ArrayLike, train_speed: float) -> Array:
    """Adhesion of the surface at slip velocities in m/s."""
    return np.asarray(surface(jnp.asarray(slips), jnp.asarray(train_speed)))


def over_time(
    one: Shown,
    title: str,
    label: str,
    lines: Mapping[str, ArrayLike],
    marks: Sequence[Mark] = (),
    limits: tuple[float, float] | None = None,
) -> Panel:
    """The course of some quantities of a run, means over its axles where they are of axles."""
    time = np.asarray(one.trace.time)
    drawn = [
        Line(name, time, mean_of_axles(values) if np.ndim(values) > time.ndim else values)
        for name, values in lines.items()
    ]
    return Panel(title, TIME, label, drawn, marks, limits)


def speeds(one: Shown, title: str, unit: SpeedUnit = MPS) -> Panel:
    rim, train = unit.of(one.trace.rim_speed), unit.of(one.trace.sample.train_speed)
    return over_time(one, title, f"speed ({unit.name})", {"wheel at the rim": rim, "train": train})


def slips(
    one: Shown,
    title: str,
    marks: Sequence[Mark],
    unit: SpeedUnit = MPS,
    limits: tuple[float, float] | None = None,
) -> Panel:
    sample = one.trace.sample
    lines = {"slip": unit.of(sample.slip), "best slip": unit.of(sample.optimum)}
    return over_time(one, title, f"slip velocity ({unit.name})", lines, marks, limits)


def adhesions(one: Shown, title: str) -> Panel:
    sample = one.trace.sample
    lines = {"adhesion": sample.adhesion, "largest of the rail": sample.largest}
    return over_time(one, title, "adhesion (1)", lines)


def observed(one: Shown, title: str) -> Panel:
    sample = one.trace.sample
    lines = {"observed": sample.observed, "true": sample.adhesion}
    return over_time(one, title, "adhesion (1)", lines)


def torques(one: Shown, title: str, marks: Sequence[Mark] = ()) -> Panel:
    torque = {"torque of a motor": np.asarray(one.trace.sample.torque) / 1e3}
    return over_time(one, title, "torque (kN m)", torque, marks)


def over_curves(one: Shown, title: str, lines: Sequence[Line], unit: SpeedUnit = MPS) -> Panel:
    """The operating point in traction over the adhesion curves, as far as they are drawn.

    It is the first line, which is solid: the curves are seen where it does not go.
    """
    rows = one.trace.sample
    driven = np.asarray(rows.counts) & (np.asarray(rows.direction) > 0)
    slip = unit.of(mean_of_axles(rows.slip))[driven]
    end = max(np.max(line.x) for line in lines)
    track = Line(
        "operating point",
        np.where(slip <= end, slip, np.nan),
        mean_of_axles(rows.adhesion)[driven],
    )
    return Panel(title, f"slip velocity ({unit.name})", "adhesion (1)", [track, *lines])
