"""Table 1 and figures 4 to 10 of Uyulan et al. 2018 beside ours."""

from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np
import pandas as pd

from adhesion_jax.campaign.traction import QUIET, WHOLE
from adhesion_jax.report.traction.panels import Line, Mark, Panel
from adhesion_jax.report.traction.runs import (
    TIME,
    Array,
    Drawing,
    Shown,
    adhesion,
    adhesions,
    by_method,
    curves,
    mean_of_axles,
    over_curves,
    slips,
    speeds,
    surfaces,
    torques,
)
from adhesion_jax.traction.controllers.adaptive_robust import AdaptiveRobust
from adhesion_jax.traction.loop import Trace
from adhesion_jax.traction.plants.elastic_axles import ElasticAxles
from adhesion_jax.traction.systems.uyulan2018 import PRINTED, PRINTED_BEST_SLIP, lyapunov

#: Speed of the train at which the curves are drawn, m/s; the surfaces do not depend on it.
_SPEED = 10.0

#: Rates of the Lyapunov function to which their axis is even, m^2/s^3.
_LEVEL = 1e-6


def table(metrics: pd.DataFrame) -> pd.DataFrame:
    """Tracking with the true optimum, and the estimate of the printed seeker less the slip."""
    rows = metrics[(metrics["noise"] == QUIET) & (metrics["segment"] == WHOLE)]
    found = []
    for names, (tracking, estimation) in PRINTED.items():
        scenario = "-".join(names)
        these = rows[rows["scenario"] == scenario]
        found.append(
            {
                "scenario": scenario,
                "tracking_rms": these["tracking_rms"].iloc[0],
                "estimation_rms": these["estimation_rms"].iloc[-1],
                "paper_tracking_rms": tracking,
                "paper_estimation_rms": estimation,
            }
        )
    return pd.DataFrame(found)


def figures(drawing: Drawing) -> Mapping[str, Sequence[Panel]]:
    shown = by_method(drawing.shown, "true optimum")
    sought = {one.case.scenario: one for one in by_method(drawing.shown, "as printed")}
    return {
        "fig_04_surfaces": [_surfaces(shown)],
        "fig_05_speeds": [speeds(one, one.case.scenario) for one in shown],
        "fig_06_adhesion": [adhesions(one, one.case.scenario) for one in shown],
        "fig_07_torque": [
            torques(one, one.case.scenario, [Mark("the paper's saturation", x=20.0)])
            for one in shown
        ],
        "fig_08_slip": [_slip(one, sought[one.case.scenario]) for one in shown],
        "fig_09_map": [
            over_curves(one, one.case.scenario, curves(surfaces(one), _SPEED, 5.0)) for one in shown
        ],
        "fig_10_lyapunov": _lyapunov(shown, drawing),
    }


def _surfaces(shown: Sequence[Shown]) -> Panel:
    known = {name: surface for one in shown for name, surface in surfaces(one).items()}
    found = {name: known[name] for name in PRINTED_BEST_SLIP if name in known}
    marks = [
        Mark("paper's best slip", slip, float(adhesion(found[name], slip, _SPEED)))
        for name, slip in PRINTED_BEST_SLIP.items()
        if name in found
    ]
    lines = curves(found, _SPEED, 5.0)
    return Panel("adhesion of the surfaces", "slip velocity (m/s)", "adhesion (1)", lines, marks)


def _slip(one: Shown, sought: Shown) -> Panel:
    names = dict.fromkeys(one.case.segments)
    marks = [
        Mark("paper's best slip", y=PRINTED_BEST_SLIP[name])
        for name in names
        if name in PRINTED_BEST_SLIP
    ]
    panel = slips(one, one.case.scenario, marks, limits=(0.0, 3.0))
    slip = mean_of_axles(sought.trace.sample.slip)
    return panel._replace(
        lines=[*panel.lines, Line("slip, seeker as printed", sought.trace.time, slip)]
    )


def _lyapunov(shown: Sequence[Shown], drawing: Drawing) -> list[Panel]:
    """The function V(t) of the paper's controller; other controllers have none."""
    found = {}
    for one in shown:
        controller, plant = one.case.controller, drawing.plant
        if isinstance(controller, AdaptiveRobust) and isinstance(plant, ElasticAxles):
            values = lyapunov_along(controller, plant, one.trace)
            found[one.case.scenario] = [Line("L and its rate", one.trace.time, values)]
    return lyapunov_panels(found)


def lyapunov_along(controller: AdaptiveRobust, plant: ElasticAxles, rows: Trace) -> Array:
    """The Lyapunov function along a run, mean of the axles, m^2/s^2.

    kappa is a constant: its largest adhesion is that of the surface on which the run begins.
    """
    sample = rows.sample
    largest = jnp.broadcast_to(sample.largest[0], jnp.shape(sample.slip))
    error = sample.slip - sample.optimum
    return mean_of_axles(lyapunov(controller, plant, rows.controller.bound, error, largest))


def lyapunov_panels(of: Mapping[str, Sequence[Line]]) -> list[Panel]:
    """The function and, below, how fast it changes, a panel a scenario; `of` has the function."""

    def changing(line: Line) -> Line:
        time = np.asarray(line.x)
        return line._replace(x=time[1:], y=np.diff(line.y) / np.diff(time))

    rates = {name: [*map(changing, lines)] for name, lines in of.items()}
    return [
        *(Panel(name, TIME, "L (m²/s²)", lines) for name, lines in of.items()),
        *(
            Panel(name, TIME, "dL/dt (m²/s³)", lines, linear=_LEVEL)
            for name, lines in rates.items()
        ),
    ]
