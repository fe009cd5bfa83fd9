"""Which method is how good where: a row for each scenario and method of several campaigns."""

from collections.abc import Sequence
from functools import partial

import jax
import numpy as np
import pandas as pd

from adhesion_jax.campaign.job import Job
from adhesion_jax.campaign.monte_carlo import Campaign
from adhesion_jax.scenarios.course import Followed

#: The name of the table.
OVERVIEW = "overview"

#: The columns that are means over the rails of a scenario.
_MEANS = ("rmse_over_crlb", "coverage95")


def overview(jobs: Sequence[Job], campaigns: Sequence[Campaign]) -> pd.DataFrame:
    """The figures of mu_max of each method, over the rails of each scenario.

    Of a stream they are those of the second half of each rail (`steady`), of blocks those of the
    summary. `rmse` is a share of the truth; `microseconds` and `bytes` are the time of a point or
    of a sample and the size of the state that a method carries from one to the next. The ratio to
    the bound is that of those rails on which it has one; where none has, because the box cuts
    estimates off (`cut_off`), it is that of all, and may be less than 1 for this alone.
    """
    parts = [_of_scenario(job, found) for job, found in zip(jobs, campaigns, strict=True)]
    return pd.concat(parts, ignore_index=True)


def _of_scenario(job: Job, campaign: Campaign) -> pd.DataFrame:
    stream = isinstance(job.scenario.course, Followed)
    accuracy = campaign.tables["steady" if stream else "summary"]
    accuracy = accuracy[accuracy["quantity"] == "mu_max"]
    key = jax.random.key(0)
    points = int(jax.eval_shape(job.scenario.draw, key).slip.shape[-1])
    rows = []
    for name in job.names:
        own = accuracy[accuracy["identifier"] == name]
        row: dict[str, object] = {
            "scenario": job.name,
            "kind": "stream" if stream else "blocks",
            "identifier": name,
            "rmse": float(np.sqrt(np.mean(np.square(own["rmse"] / own["truth"])))),
        }
        cut_off = not own["rmse_over_crlb"].notna().any()
        if cut_off:
            ratios = {"rmse_over_crlb": own["rmse"], "rmse_over_crlb_se": own["rmse_se"]}
            own = own.assign(**{column: error / own["crlb"] for column, error in ratios.items()})
        for column in _MEANS:
            known = own[own[column].notna()]
            row[column] = float(known[column].mean())
            error = np.sqrt(np.sum(known[f"{column}_se"] ** 2)) / max(len(known), 1)
            row[f"{column}_se"] = float(error) if len(known) else np.nan
        row["cut_off"] = cut_off
        row["failure_share"] = float(own["failure_share"].mean())
        row |= _tracked(campaign, name)
        row["microseconds"] = 1e6 * float(own["seconds_per_identification"].mean()) / points
        state = jax.eval_shape(partial(job.methods[name].init, job.scenario.known), key)
        row["bytes"] = sum(leaf.size * leaf.dtype.itemsize for leaf in jax.tree.leaves(state))
        rows.append(row)
    return pd.DataFrame(rows)


def _tracked(campaign: Campaign, name: str) -> dict[str, object]:
    """Median delay after a switch, false resets per 1000 steps, and lag behind a drift in steps."""
    table = campaign.tables.get("tracking")
    if table is None:
        return dict.fromkeys(("delay", "false_resets_per_1000", "lag"), np.nan)
    own = table[table["identifier"] == name]
    after = own["delay_median"][own["overshoot"].notna()]
    means = {"delay": after, **own[["false_resets_per_1000", "lag"]]}
    return {column: float(values.mean()) for column, values in means.items()}
