"""Uses what was added to a copy of the package as its own is used, and tells what came out.

Run by test_one_file.py with the copy on the path and the folder for files as its argument.
"""

import json
import sys
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pandas as pd
from adhesion_jax.curves.hyperbolic import Hyperbolic  # of the copy alone
from adhesion_jax.effects.leaves import Leaves

import adhesion_jax
from adhesion_jax.campaign.job import Config
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.command_line import discover as discover_command
from adhesion_jax.command_line import identify as identify_command
from adhesion_jax.curves import CURVES
from adhesion_jax.discovery import engine
from adhesion_jax.discovery.engine import discover
from adhesion_jax.effects.saved import load_law
from adhesion_jax.scenarios import Options
from experiments.campaigns.plantable import PLANTABLE, CleanRuns, OpenEffect, Planting, of_strength
from experiments.campaigns.runs import DRAWN
from experiments.campaigns.simulator import SetNoise, SimulatedSet, simulate
from experiments.discovery_study.judging import judged
from experiments.discovery_study.otherwise import by_factor
from experiments.discovery_study.tasks import study_tasks

out = Path(sys.argv[1])
told: dict[str, object] = {"package": str(Path(adhesion_jax.__file__).parent)}

SIZE = {"runs": 24, "points": 100}
#: Hyperbolic curve: a, b, c.
CURVE = (0.3, 50.0, 0.4)


def adhesion_by_hand(slip: np.ndarray, curve: tuple[float, ...]) -> np.ndarray:
    a, b, c = curve
    return a * np.tanh(b * slip) - c * slip


def parameters_of(campaign: SimulatedSet) -> tuple[float, ...]:
    return tuple(float(getattr(campaign.curve, name)) for name in campaign.curve.free)


def cover(columns: dict[str, np.ndarray], generator: np.random.Generator) -> dict[str, np.ndarray]:
    share = generator.uniform(0.0, 1.0, (len(columns["time_s"]), 1))
    return {"leaf_cover": share + 0 * columns["time_s"]}


# A new effect planted on a new curve, by both of its formulas.
PLANTABLE["leaves"] = Planting(of_strength(Leaves, 0.9), cover)
DRAWN["hyperbolic"] = lambda level, _, draw: Hyperbolic(level, draw(30.0, 80.0), level)
quiet = SetNoise(1e-9, 0.0, 0.0)


def by_another_formula(runs: CleanRuns) -> OpenEffect:
    return by_factor(lambda a: np.exp(-a * runs.columns["leaf_cover"] ** 2), 2.0)


for form, forms in (("exact", {}), ("perturbed", {"leaves": by_another_formula})):
    campaign = simulate(["leaves"], seed=1, base="hyperbolic", forms=forms, noise=quiet, **SIZE)
    table, amount = campaign.train, next(iter(campaign.parameters["leaves"].values()))
    cover = table["leaf_cover"].to_numpy()
    factor = 1 - amount * cover if form == "exact" else np.exp(-amount * cover**2)
    expected = factor * adhesion_by_hand(table["slip_ratio"].to_numpy(), parameters_of(campaign))
    told[f"simulated {form}"] = {
        "truth": campaign.truth,
        "base": campaign.base,
        "parameters": campaign.parameters["leaves"],
        "largest_error": float(np.abs(table["adhesion"] - expected).max()),
        "cover_of_runs": int(table.groupby("run")["leaf_cover"].nunique().max()),
    }
bare = simulate(seed=1, base="hyperbolic", **SIZE)
told["bare"] = {"columns": [*bare.train], "visible": bare.visible}

# Found in noise, told, saved and loaded, judged.
campaign = simulate(["leaves"], seed=5, base="hyperbolic", strength=0.25, **SIZE)
for name in ("train", "test"):
    getattr(campaign, name).to_csv(out / f"{name}.csv", index=False)
files = [str(out / "train.csv"), "--test", str(out / "test.csv")]
made = []
engine.discover = lambda *given, **named: made.append(discover(*given, **named)) or made[-1]
discover_command.main(
    [*files, "--curve", "hyperbolic", "--out", str(out / "report")], standalone_mode=False
)
(findings,) = made
law = load_law(out / "report" / "law.json")
slip = jnp.linspace(0.005, 0.1, 30)
medians = {name: float(campaign.train[name].median()) for name in campaign.train}
point = {**medians, "leaf_cover": 0.8}
del point["time_s"]
told["found"] = {
    "effects": [effect.name for effect in findings.effects],
    "unexplained": [effect.name for effect in findings.unexplained],
    "rests_on": [effect.covariates for effect in findings.effects],
    "intervals": [
        {name: tuple(interval) for name, interval in effect.parameters.items()}
        for effect in findings.effects
    ],
    "planted": campaign.parameters["leaves"],
    "base": findings.base,
    "curve": {
        row["parameter"]: row["after"] for row in findings.base_parameters.to_dict("records")
    },
    "curve_error": {
        row["parameter"]: row["after_se"] for row in findings.base_parameters.to_dict("records")
    },
    "true_curve": dict(zip("abc", parameters_of(campaign), strict=True)),
    "ranges": [
        (float(table["leaf_cover"].min()), float(table["leaf_cover"].max()))
        for table in (campaign.train, campaign.test)
    ],
    "after": findings.test.after.value,
    "noise": campaign.test_rms_noise,
    "of_law": np.asarray(findings.law(slip, point)).tolist(),
    "of_loaded_law": np.asarray(law(slip, point)).tolist(),
    "factor": (np.asarray(law(slip, point)) / np.asarray(law.curve(slip, point))).tolist(),
    "report": (out / "report" / "report.html").read_text(),
}
tasks = [task for task in study_tasks(0, 2, 0) if task.effects == ("leaves",)]
told["tasks"] = [task.form for task in tasks]
told["judged"] = judged(tasks[0], campaign, findings)

# The curve identified by the command, without effects.
draw = np.random.default_rng(0)
slips = np.linspace(0.0, 0.15, 150)
measured = adhesion_by_hand(slips, CURVE) + 0.004 * draw.standard_normal(slips.size)
rows = [f"{s:.9g},{mu:.9g}" for s, mu in zip(slips, measured, strict=True)]
(out / "curve.csv").write_text("\n".join(["slip_ratio,adhesion", *rows]) + "\n")
options = ["--curve", "hyperbolic", "--out", str(out / "identified")]
identify_command.main([str(out / "curve.csv"), *options], standalone_mode=False)
told["curve"] = CURVE
(told["identified"],) = pd.read_csv(out / "identified" / "curves.csv").to_dict("records")
told["parameters"] = pd.read_csv(out / "identified" / "parameters.csv").to_dict("records")

# The method in a campaign beside the exact optimum.
config = Config("single", ("damped", "ml-exact"), Options(rail="dry"), runs=256)
table = run_campaign(config, lambda _: None, lambda _: None, 1).tables["summary"]
told["campaign"] = table[table["quantity"] == "mu_max"].to_dict("records")

told["known"] = [*CURVES]
(out / "told.json").write_text(json.dumps(told, default=lambda number: number.item()))
