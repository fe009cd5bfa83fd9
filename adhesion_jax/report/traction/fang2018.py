"""The slips of Fang et al. 2018 and its figures 6 to 12 beside ours."""

from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd

from adhesion_jax.campaign.traction import QUIET
from adhesion_jax.report.traction.panels import Line, Mark, Panel
from adhesion_jax.report.traction.runs import (
    KMH,
    TIME,
    Array,
    Drawing,
    Shown,
    adhesion,
    by_method,
    curves,
    mean_of_axles,
    observed,
    over_curves,
    slips,
    speeds,
    surfaces,
    torques,
)
from adhesion_jax.traction.controllers.torque_feedback import SlopeFeedback
from adhesion_jax.traction.systems.fang2018 import PRINTED_BEST_SLIP_KMH, PRINTED_SLIP_KMH

#: Speed of the train at which the curves are drawn, m/s; the roads do not depend on it.
_SPEED = 20.0


def table(metrics: pd.DataFrame) -> pd.DataFrame:
    """Settled slip and utilisation on the poor roads; the paper's slips are for K2 = 7000 N m."""
    rows = metrics[(metrics["noise"] == QUIET) & metrics["segment"].isin(("2", "3", "2 braking"))]
    return pd.DataFrame(
        {
            "method": rows["method"],
            "road": rows["segment"],
            "slip_kmh": KMH.per_mps * rows["slip_settled"].abs(),
            "utilisation": rows["utilisation_settled"],
            "paper_slip_kmh": rows["segment"].map(PRINTED_SLIP_KMH),
            "status": rows["status"],
        }
    ).reset_index(drop=True)


def figures(drawing: Drawing) -> Mapping[str, Sequence[Panel]]:
    shown = by_method(drawing.shown, "Eq. 9, K2 7000", "Eq. 9, K2 18000")
    return {
        "fig_06_roads": [_roads(shown[0])],
        "fig_07_speeds": [speeds(one, one.case.method, KMH) for one in shown],
        "fig_08_command": [_command(one) for one in shown],
        "fig_09_torque": [torques(one, one.case.method) for one in shown],
        "fig_10_observed": [
            panel for one in shown for panel in (observed(one, one.case.method), _slope(one))
        ],
        "fig_11_track": [over_curves(one, one.case.method, _curves(one), KMH) for one in shown],
        "fig_12_slip": [_slip(one) for one in shown],
    }


def _curves(one: Shown) -> list[Line]:
    roads = surfaces(one)
    return curves({f"road {name}": roads[name] for name in "123"}, _SPEED, 15.0, KMH)


def _roads(one: Shown) -> Panel:
    roads = surfaces(one)
    marks = [
        Mark("paper's best slip", kmh, float(adhesion(roads[name], kmh / KMH.per_mps, _SPEED)))
        for name, kmh in PRINTED_BEST_SLIP_KMH.items()
    ]
    return Panel(
        "adhesion of the roads", "slip velocity (km/h)", "adhesion (1)", _curves(one), marks
    )


def _command(one: Shown) -> Panel:
    rows = one.trace
    lines = [Line("torque commanded", rows.time, mean_of_axles(rows.command) / 1e3)]
    return Panel(one.case.method, TIME, "torque (kN m)", lines)


def _slope(one: Shown) -> Panel:
    rows = one.trace
    lines = [Line("true", rows.time, _true_slope(one))]
    if isinstance(one.case.controller, SlopeFeedback):
        lines = [Line("observed", rows.time, mean_of_axles(rows.controller.slope)), *lines]
    return Panel(one.case.method, TIME, "slope dμ/dv (s/m)", lines, limits=(-0.2, 0.4))


def _true_slope(one: Shown) -> Array:
    def adhesion_at(slip: jax.Array, segment: jax.Array, speed: jax.Array) -> jax.Array:
        return one.case.rails.surface(segment)(slip, speed)

    rows = one.trace.sample
    slip = jnp.asarray(mean_of_axles(rows.slip))
    slopes = jax.jit(jax.vmap(jax.grad(adhesion_at)))
    return np.asarray(slopes(slip, jnp.asarray(rows.segment), jnp.asarray(rows.train_speed)))


def _slip(one: Shown) -> Panel:
    marks = [Mark("paper's slip", y=kmh) for kmh in PRINTED_SLIP_KMH.values()]
    return slips(one, one.case.method, marks, KMH, (-8.0, 8.0))
