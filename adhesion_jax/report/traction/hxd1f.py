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


CAPTIONS: Mapping[str, str] = {
    "fig_10_observer": "Figure 10: adhesion as observed and as it is, with the terminal sliding "
    "mode and with the full-dimension observer.",
    "fig_11_speeds": "Figure 11: speed of the wheels at the rim and of the locomotive.",
    "fig_12_slip": "Figure 12: slip velocity. Dotted: the best slips that the paper prints, .20 "
    "m/s on the dry and .08 m/s on the wet rail. Slip beyond .5 m/s is cut.",
    "fig_13_adhesion": "Figure 13: adhesion, and the largest that the rail has: dry, from 5 s on "
    "wet and from 10 s on snowy.",
    "fig_14_map": "Figure 14: the operating point over the adhesion curves. It begins at the "
    "origin and falls from curve to curve when the rail changes. Slip beyond .6 m/s is cut.",
    "fig_15_torque": "Figure 15: torque of a motor with a sliding mode and with the barrier.",
}


def _slip(one: Shown) -> Panel:
    marks = [Mark("paper's best slip", y=slip) for slip in PRINTED_BEST_SLIP.values()]
    return slips(one, one.case.method, marks, limits=(-0.05, 0.5))
