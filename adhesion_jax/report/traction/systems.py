"""The tables and figures of three papers beside ours: each of its numbers has a mark."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

from adhesion_jax.campaign.traction import QUIET, WHOLE
from adhesion_jax.report.page import CAPTIONS
from adhesion_jax.report.traction.panels import (
    KMH,
    TIME,
    Array,
    Line,
    Mark,
    Panel,
    Shown,
    adhesions,
    by_method,
    curves,
    mean_of_axles,
    observed,
    over_curves,
    over_time,
    slips,
    speeds,
    surfaces,
    torques,
    with_best,
)
from adhesion_jax.traction.controllers.adaptive_robust import AdaptiveRobust
from adhesion_jax.traction.controllers.torque_feedback import SlopeFeedback
from adhesion_jax.traction.loop import Trace
from adhesion_jax.traction.plants.base import Plant
from adhesion_jax.traction.plants.elastic_axles import ElasticAxles
from adhesion_jax.traction.systems import fang2018, hxd1f, uyulan2018

#: Speeds of the train at which the curves are drawn, m/s; those of these rails do not depend on it.
_UYULAN_SPEED, _FANG_SPEED = 10.0, 20.0

#: Rates of the Lyapunov function to which their axis is even, m^2/s^3.
_LEVEL = 1e-6


def uyulan2018_table(metrics: pd.DataFrame) -> pd.DataFrame:
    """Tracking with the true optimum, and the estimate of the printed seeker less the slip.

    Of other methods both, a row each.
    """
    rows = metrics[(metrics["noise"] == QUIET) & (metrics["segment"] == WHOLE)]
    ours = rows.set_index("scenario")[["method", "tracking_rms", "estimation_rms"]]
    told = ours["method"] == "true optimum"
    if told.any():
        ours = ours[told][["tracking_rms"]].join(ours[~told]["estimation_rms"])
    printed = pd.DataFrame(
        uyulan2018.PRINTED.values(),
        ["-".join(names) for names in uyulan2018.PRINTED],
        ["paper_tracking_rms", "paper_estimation_rms"],
    )
    return ours.join(printed).reset_index()


def uyulan2018_figures(shown: Sequence[Shown], plant: Plant) -> Mapping[str, Sequence[Panel]]:
    sought = {one.case.scenario: one for one in shown if one.case.method == "as printed"}
    shown = by_method(shown, "true optimum", title="scenario")
    saturated = [Mark("the paper's saturation", x=20.0)]
    return {
        "fig_04_surfaces": [_surfaces(shown)],
        "fig_05_speeds": [speeds(one) for one in shown],
        "fig_06_adhesion": [adhesions(one) for one in shown],
        "fig_07_torque": [torques(one, saturated) for one in shown],
        "fig_08_slip": [_slip_and_sought(one, sought.get(one.case.scenario)) for one in shown],
        "fig_09_map": [
            over_curves(one, curves(surfaces(one), _UYULAN_SPEED, 5.0)) for one in shown
        ],
        "fig_10_lyapunov": _lyapunov(shown, plant),
    }


def _surfaces(shown: Sequence[Shown]) -> Panel:
    best = uyulan2018.PRINTED_BEST_SLIP
    known = {name: surface for one in shown for name, surface in surfaces(one).items()}
    found = {name: known[name] for name in best if name in known}
    lines = curves(found, _UYULAN_SPEED, 5.0)
    return with_best("adhesion of the surfaces", lines, found, best, _UYULAN_SPEED)


def _slip_and_sought(one: Shown, sought: Shown | None) -> Panel:
    printed = uyulan2018.PRINTED_BEST_SLIP
    best = [printed[name] for name in dict.fromkeys(one.case.segments) if name in printed]
    panel = slips(one, best, (0.0, 3.0))
    if sought is None:
        return panel
    slip = mean_of_axles(sought.trace.sample.slip)
    return panel._replace(
        lines=[*panel.lines, Line("slip, seeker as printed", sought.trace.time, slip)]
    )


def _lyapunov(shown: Sequence[Shown], plant: Plant) -> list[Panel]:
    """The function V(t) of the paper's controller; other controllers have none."""
    found = {}
    for one in shown:
        controller = one.case.controller
        if isinstance(controller, AdaptiveRobust) and isinstance(plant, ElasticAxles):
            values = lyapunov_along(controller, plant, one.trace)
            found[one.title] = [Line("L and its rate", one.trace.time, values)]
    return lyapunov_panels(found)


def lyapunov_along(controller: AdaptiveRobust, plant: ElasticAxles, rows: Trace) -> Array:
    """The Lyapunov function along a run, mean of the axles, m^2/s^2.

    kappa is a constant: its largest adhesion is that of the surface on which the run begins.
    """
    sample = rows.sample
    largest = jnp.broadcast_to(sample.largest[0], jnp.shape(sample.slip))
    error = sample.slip - sample.optimum
    return mean_of_axles(
        uyulan2018.lyapunov(controller, plant, rows.controller.bound, error, largest)
    )


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


def fang2018_table(metrics: pd.DataFrame) -> pd.DataFrame:
    """Settled slip and utilisation on the poor roads; the paper's slips are for K2 = 7000 N m."""
    rows = metrics[(metrics["noise"] == QUIET) & metrics["segment"].isin(("2", "3", "2 braking"))]
    return pd.DataFrame(
        {
            "method": rows["method"],
            "road": rows["segment"],
            "slip_kmh": KMH.per_mps * rows["slip_settled"],
            "utilisation": rows["utilisation_settled"],
            "paper_slip_kmh": rows["segment"].map(fang2018.PRINTED_SLIP_KMH),
            "status": rows["status"],
        }
    ).reset_index(drop=True)


def fang2018_figures(shown: Sequence[Shown], _: Plant) -> Mapping[str, Sequence[Panel]]:
    shown = by_method(shown, "Eq. 9, K2 7000", "Eq. 9, K2 18000", unit=KMH)
    roads = surfaces(shown[0])
    lines = curves({f"road {name}": roads[name] for name in "123"}, _FANG_SPEED, 15.0, KMH)
    best, slipped = fang2018.PRINTED_BEST_SLIP_KMH, fang2018.PRINTED_SLIP_KMH.values()
    return {
        "fig_06_roads": [with_best("adhesion of the roads", lines, roads, best, _FANG_SPEED, KMH)],
        "fig_07_speeds": [speeds(one) for one in shown],
        "fig_08_command": [_command(one) for one in shown],
        "fig_09_torque": [torques(one) for one in shown],
        "fig_10_observed": [panel for one in shown for panel in (observed(one), _slope(one))],
        "fig_11_track": [over_curves(one, lines) for one in shown],
        "fig_12_slip": [slips(one, slipped, (-8.0, 8.0), "slip") for one in shown],
    }


def _command(one: Shown) -> Panel:
    command = {"torque commanded": np.asarray(one.trace.command) / 1e3}
    return over_time(one, "torque (kN m)", command)


def _slope(one: Shown) -> Panel:
    lines = {"true": _true_slope(one)}
    if isinstance(one.case.controller, SlopeFeedback):
        lines = {"observed": one.trace.controller.slope, **lines}
    return over_time(one, "slope dμ/dv (s/m)", lines, limits=(-0.2, 0.4))


def _true_slope(one: Shown) -> Array:
    def adhesion_at(slip: jax.Array, segment: jax.Array, speed: jax.Array) -> jax.Array:
        return one.case.rails.surface(segment)(slip, speed)

    rows = one.trace.sample
    slip = jnp.asarray(mean_of_axles(rows.slip))
    slopes = jax.jit(jax.vmap(jax.grad(adhesion_at)))
    return np.asarray(slopes(slip, jnp.asarray(rows.segment), jnp.asarray(rows.train_speed)))


def hxd1f_table(metrics: pd.DataFrame) -> pd.DataFrame:
    """Every method on every surface, without noise; t95 is empty where it is never reached."""
    rows = metrics[(metrics["noise"] == QUIET) & (metrics["segment"] != WHOLE)]
    with_units = {"t95": "t95_s", "torque_variation": "torque_variation_kNm_s"}
    rows = rows[["method", "segment", "utilisation", *with_units, "status"]]
    return rows.rename(columns=with_units).reset_index(drop=True)


def hxd1f_figures(shown: Sequence[Shown], _: Plant) -> Mapping[str, Sequence[Panel]]:
    observers = by_method(shown, hxd1f.SMES, "SMES, full dimension -233, ABLF")
    seekers = by_method(shown, hxd1f.SMES, "DAC")
    controllers = by_method(shown, "SMES, NTSMO, sliding mode", hxd1f.SMES)
    best = hxd1f.PRINTED_BEST_SLIP.values()
    return {
        "fig_10_observer": [observed(one) for one in observers],
        "fig_11_speeds": [speeds(one) for one in seekers],
        "fig_12_slip": [slips(one, best, (-0.05, 0.5)) for one in seekers],
        "fig_13_adhesion": [adhesions(one) for one in seekers],
        "fig_14_map": [over_curves(one, curves(surfaces(one), 5.0, 0.6)) for one in seekers],
        "fig_15_torque": [torques(one) for one in controllers],
    }


class Subject(NamedTuple):
    """The table and the figures of one system."""

    table: Callable[[pd.DataFrame], pd.DataFrame]
    figures: Callable[[Sequence[Shown], Plant], Mapping[str, Sequence[Panel]]]
    captions: Mapping[str, str]  # of each figure


SUBJECTS: Mapping[str, Subject] = {
    "uyulan2018": Subject(uyulan2018_table, uyulan2018_figures, CAPTIONS["uyulan2018"]),
    "fang2018": Subject(fang2018_table, fang2018_figures, CAPTIONS["fang2018"]),
    "hxd1f": Subject(hxd1f_table, hxd1f_figures, CAPTIONS["hxd1f"]),
}
