"""Figures 10 to 15 of the paper on the HXD1F, and how each method uses the rails."""

from collections.abc import Mapping, Sequence

import pandas as pd

from adhesion_jax.campaign.traction import QUIET, WHOLE
from adhesion_jax.report.traction.panels import Mark, Panel
from adhesion_jax.report.traction.runs import (
    Drawing,
    Shown,
    adhesions,
    by_method,
    curves,
    observed,
    over_curves,
    slips,
    speeds,
    surfaces,
    torques,
)
from adhesion_jax.traction.systems.hxd1f import PRINTED_BEST_SLIP, SMES


def table(metrics: pd.DataFrame) -> pd.DataFrame:
    """Every method on every surface, without noise; t95 is empty where it is never reached."""
    rows = metrics[(metrics["noise"] == QUIET) & (metrics["segment"] != WHOLE)]
    return pd.DataFrame(
        {
            "method": rows["method"],
            "segment": rows["segment"],
            "utilisation": rows["utilisation"],
            "t95_s": rows["t95"],
            "torque_variation_kNm_s": rows["torque_variation"],
            "status": rows["status"],
        }
    ).reset_index(drop=True)


def figures(drawing: Drawing) -> Mapping[str, Sequence[Panel]]:
    observers = by_method(drawing.shown, SMES, "SMES, full dimension -233, ABLF")
    seekers = by_method(drawing.shown, SMES, "DAC")
    controllers = by_method(drawing.shown, "SMES, NTSMO, sliding mode", SMES)
    return {
        "fig_10_observer": [observed(one, one.case.method) for one in observers],
        "fig_11_speeds": [speeds(one, one.case.method) for one in seekers],
        "fig_12_slip": [_slip(one) for one in seekers],
        "fig_13_adhesion": [adhesions(one, one.case.method) for one in seekers],
        "fig_14_map": [
            over_curves(one, one.case.method, curves(surfaces(one), 5.0, 0.6)) for one in seekers
        ],
        "fig_15_torque": [torques(one, one.case.method) for one in controllers],
    }


def _slip(one: Shown) -> Panel:
    marks = [Mark("paper's best slip", y=slip) for slip in PRINTED_BEST_SLIP.values()]
    return slips(one, one.case.method, marks, limits=(-0.05, 0.5))
