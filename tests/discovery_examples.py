"""Findings made by hand, with data to match, for the tests of the reports."""

import functools

import jax.numpy as jnp
import numpy as np
import pandas as pd

from adhesion_jax.curves import CURVES
from adhesion_jax.discovery.types import (
    Candidate,
    Dependence,
    Doubt,
    Errors,
    Findings,
    FoundEffect,
    Interval,
    Opinion,
    Proposal,
)
from adhesion_jax.effects import EFFECTS, Spline
from adhesion_jax.effects.conditions import Calendar
from adhesion_jax.effects.law import CorrectedLaw

NAN = float("nan")
RUNS, POINTS = 24, 60
_OWN = ("run", "slip", "adhesion", "before", "after")

BASE = CURVES["burckhardt"]
HUMIDITY = EFFECTS["humidity"](k=-0.112, centre=60.0, width=150.0, reference=61.0)
SLIP_SPEED = EFFECTS["slip_speed"](c4=0.0312)

FOUND_HUMIDITY = FoundEffect(
    "humidity",
    ("humidity",),
    ("relative_humidity_pct",),
    "mu (1 + k (s(H) - s(H0)))",
    {"k": Interval(-0.1121, -0.1234, -0.1009), "reference": Interval(61.0, NAN, NAN)},
    {"k": "1", "reference": "%"},
    0.0011,
    0.01171,
    "Adhesion falls as the air becomes more humid.",
)
FOUND_SLIP_SPEED = FoundEffect(
    "slip_speed",
    ("slip_speed", "falling_friction", "contact_heating"),
    ("vehicle_speed_mps", "slip_ratio"),
    "mu exp(-c4 |l| V)",
    {"c4": Interval(0.03121, 0.02714, 0.03533)},
    {"c4": "s/m"},
    0.0023,
    0.01013,
    "Adhesion falls with slip velocity.",
    "fall",
)
UNEXPLAINED = FoundEffect(
    "covariate:relative_humidity_pct",
    ("covariate:relative_humidity_pct",),
    ("relative_humidity_pct",),
    "mu (1 + s(relative_humidity_pct))",
    {"k1": Interval(0.0231, 0.0112, 0.0345)},
    {"k1": "1"},
    0.0031,
    0.01044,
    "Adhesion changes with relative_humidity_pct in a form that the catalogue does not know.",
)


@functools.cache
def points() -> pd.DataFrame:
    draw = np.random.default_rng(7)
    run = np.repeat(np.arange(RUNS), POINTS)
    slip = np.tile(np.linspace(0.001, 0.2, POINTS), RUNS)
    humidity = np.linspace(25, 95, RUNS)[draw.permutation(RUNS)][run]
    speed = draw.uniform(5, 40, RUNS)[run]
    before = np.asarray(BASE(jnp.asarray(slip), {}))
    humid = before * (1 - 0.112 * (humidity - 61) / 50)
    after = humid * np.exp(-0.0312 * slip * speed)
    return pd.DataFrame(
        {
            "run": run,
            "slip": slip,
            "adhesion": after + 0.01 * draw.standard_normal(run.size),
            "before": before * after.mean() / before.mean(),
            "after": after,
            "slip_ratio": slip,
            "time_s": run * 300.0 + 0.1 * np.tile(np.arange(POINTS), RUNS),
            "vehicle_speed_mps": speed,
            "normal_load_N": draw.uniform(85000, 110000, RUNS)[run],
            "relative_humidity_pct": humidity,
            "temperature_C": draw.uniform(-5, 30, RUNS)[run],
            "wind_mps": draw.uniform(0, 9, run.size),
            "axle": run % 2.0,
            "constant": 1.0,
        }
    )


def _nothing_missing() -> pd.DataFrame:
    """Few columns: each is a panel to draw."""
    table = points()[[*_OWN, "relative_humidity_pct"]]
    noise = table["adhesion"] - table["after"]
    return table.assign(adhesion=table["before"] + noise, after=table["before"])


def errors(before: float, after: float, runs: int) -> Errors:
    removed = 1 - (after / before) ** 2
    return Errors(
        Interval(before, 0.931 * before, 1.082 * before),
        Interval(after, 0.943 * after, 1.071 * after),
        Interval(removed, removed - 0.083, removed + 0.061),
        runs,
    )


def law(*effects) -> CorrectedLaw:
    ranges = {"relative_humidity_pct": (25.0, 95.0), "vehicle_speed_mps": (5.0, 40.0)}
    return CorrectedLaw(BASE, effects, ranges, Calendar("time_s", 0.0, 6900.0))


def base_parameters() -> pd.DataFrame:
    return pd.DataFrame(
        {
            "parameter": ["c1", "c2", "c3"],
            "unit": ["1", "1", "1"],
            "before": [0.2812, 98.31, 0.4412],
            "before_se": [0.0031, 2.14, NAN],
            "after": [0.2997, 100.42, 0.3011],
            "after_se": [0.0019, 1.37, 0.0089],
        }
    )


def dependence(effect: str, column: str, unit: str, strength: float) -> Dependence:
    values = np.linspace(*np.quantile(points()[column], [0, 1]), 50)
    factor = 1 + strength * (values - np.median(points()[column])) / np.ptp(values)
    return Dependence(effect, column, unit, values, factor, factor - 0.02, factor + 0.02)


def levels() -> pd.DataFrame:
    """The mean relative residual of each run, and the mean of each of its columns of numbers."""
    table = points()
    left = table.assign(
        **{when: table["adhesion"] / table[when] - 1 for when in ("before", "after")}
    )
    columns = left.drop(columns=["slip", "adhesion"]).select_dtypes("number")
    return columns.groupby("run", as_index=False).mean().assign(error=0.05 / np.sqrt(POINTS))


def null() -> Findings:
    """Nothing is missing; no test set."""
    return Findings(
        source="dry.csv",
        base="burckhardt",
        base_parameters=base_parameters(),
        law=law(),
        law_before=law(),
        noise_floor=0.01002,
        noise={"sigma": 0.00951, "autocorrelation": 0.312, "run_scatter": 0.00413},
        train=errors(0.01004, 0.01004, RUNS),
        validation=errors(0.01012, 0.01012, RUNS),
        test=None,
        effects=(),
        unexplained=(),
        ranking=(
            Candidate(0, "drift", 1.92, 0.431, NAN, NAN, "not significant"),
            Candidate(0, "humidity", 2.61, 0.174, 0.31, 0.52, "not significant"),
        ),
        confounded=(),
        untested=(),
        proposals=(),
        dependences=(),
        warnings=(),
        points=_nothing_missing(),
        predictions=None,
        seconds=1.43,
        least_p=0.0005,
        named={"axle": ("leading", "second")},
    )


def two_effects() -> Findings:
    """Humidity, and a loss with slip velocity that has three names; with a test set."""
    others = ("temperature", "drift", "load_peak", "patch", "lag", "sanding", "delay", "hysteresis")
    return null()._replace(
        source="winter.csv",
        law=law(HUMIDITY, SLIP_SPEED),
        train=errors(0.01604, 0.01006, RUNS),
        validation=errors(0.01623, 0.01013, RUNS),
        test=errors(0.01588, 0.01031, 8),
        effects=(FOUND_HUMIDITY, FOUND_SLIP_SPEED),
        ranking=(
            Candidate(0, "humidity", 9.31, 0.0011, 21.4, 4.12, "accepted"),
            Candidate(0, "slip_speed", 6.12, 0.0021, 12.2, 3.31, "not the strongest"),
            *(
                Candidate(0, name, 3.9 - 0.41 * place, 0.21 + 0.07 * place, NAN, NAN, "weak")
                for place, name in enumerate(others)
            ),
            Candidate(1, "slip_speed", 6.41, 0.0023, 13.1, 3.02, "accepted"),
            Candidate(
                1, "falling_friction", 6.33, 0.0023, 12.8, 3.04, "in the class of slip_speed"
            ),
            Candidate(1, "contact_heating", 6.02, 0.0024, 11.9, 3.1, "in the class of slip_speed"),
            Candidate(1, "temperature", 1.21, 0.812, NAN, NAN, "not significant"),
            Candidate(2, "drift", 2.22, 0.361, NAN, NAN, "not significant"),
        ),
        confounded=(
            "Slip velocity and the power of friction rise together in every run (cosine 0.97), so "
            "that their effects look alike.",
        ),
        untested=(
            "curvature_per_m is not in the data: curves and lateral creep could not be tested.",
            "normal_load_N varies by 4 %: too little for an effect of the load.",
        ),
        proposals=(
            Proposal(
                ("slip_speed", "contact_heating"),
                "ten runs at 5 m/s and ten at 40 m/s with slips up to 0.3.",
                3.42,
            ),
        ),
        dependences=(
            dependence("humidity", "relative_humidity_pct", "%", -0.16),
            dependence("slip_speed", "vehicle_speed_mps", "m/s", -0.11),
        ),
        warnings=("The residual has heavier tails than the normal distribution.",),
        points=points(),
        levels=levels(),
        predictions=pd.DataFrame({"row": [0, 1], "base": [0.21, 0.25], "corrected": [0.2, 0.24]}),
        thresholds=(4.21, 4.05, 3.92),
    )


def unexplained() -> Findings:
    """Structure along a column, and no cause."""
    spline = Spline(0.0231, 0.01, -0.02, 0.01, 0.0, 60.0, 20.0, "relative_humidity_pct")
    return null()._replace(
        law=law(spline),
        points=points()[[*_OWN, "relative_humidity_pct"]],
        validation=errors(0.01341, 0.01044, RUNS),
        unexplained=(UNEXPLAINED,),
        dependences=(dependence(UNEXPLAINED.name, "relative_humidity_pct", "%", 0.2),),
    )


TORSION = FoundEffect(
    "torsion",
    ("torsion",),
    ("time_s",),
    "mu + a sin(2 pi f t + phase of the run)",
    {"frequency": Interval(2.31, NAN, NAN), "amplitude": Interval(0.0021, NAN, NAN)},
    {"frequency": "Hz", "amplitude": "1"},
    0.0004,
    0.01012,
    "An oscillation whose phase differs from run to run.",
)
DOUBT = Doubt(
    ("slip_bias", "torque_offset"),
    "The slip may be measured too large by 0.2 %, or the curve may be steeper than burckhardt; "
    "ten runs of braking would tell.",
)
OPINION = Opinion(("wind_mps", "temperature_C"), 0.124, 0.021, 0.0003)


def doubted() -> Findings:
    """No effect, but a doubt, and trees that see something."""
    return null()._replace(doubts=(DOUBT,), opinion=OPINION, levels=levels())


NASTY = "<script>alert(1)</script>|$x$\n`湿度`"


def nasty() -> Findings:
    """A file whose column would be markup, mathematics and a line break."""
    effect = UNEXPLAINED._replace(
        name=f"covariate:{NASTY}",
        candidates=(f"covariate:{NASTY}", f"spline:{NASTY}"),
        covariates=(NASTY,),
        formula=f"mu (1 + k ({NASTY} - z0)/s)",
        sentence=f"Adhesion changes with {NASTY}.",
    )
    named = points()[[*_OWN, "wind_mps", "relative_humidity_pct"]].rename(
        columns={"wind_mps": NASTY}
    )
    whole = unexplained()
    return whole._replace(
        source=f"{NASTY}.csv",
        effects=(effect,),
        unexplained=(effect,),
        ranking=(Candidate(0, f"covariate:{NASTY}", 5.1, 0.004, 3.1, 1.2, "accepted"),),
        dependences=(whole.dependences[0]._replace(effect=effect.name, column=NASTY),),
        untested=(f"{NASTY} is constant.",),
        points=named,
    )
