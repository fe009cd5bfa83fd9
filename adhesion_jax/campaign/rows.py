"""The rows that a campaign keeps: estimates, bands of a stream, the table of tracking."""

from collections.abc import Mapping, Sequence

import jax
import numpy as np
import pandas as pd

from adhesion_jax.campaign.config import Config
from adhesion_jax.identifiers import Estimate, Status
from adhesion_jax.metrics.tracking import Tracking, criteria_of, tracking_row
from adhesion_jax.scenarios import Scenario

#: Tables whose estimates are kept for every run; those of the others are too many.
_STORED = ("summary", "switches", "checkpoints")

_ROW_KEYS = ("scenario", "run", "identifier", "block", "rail")


def standard_errors(estimate: Estimate, names: Sequence[str]) -> np.ndarray:
    place = [list(estimate.values).index(name) for name in names]
    return np.sqrt(np.diagonal(estimate.covariance, axis1=-2, axis2=-1)[..., place])


def values_of(estimate: Estimate, names: Sequence[str]) -> np.ndarray:
    return np.stack([estimate.values[name] for name in names], axis=-1)


def row_columns(scenarios: Sequence[Scenario]) -> list[str]:
    """The columns of the rows that `run_campaigns` has kept, over several scenarios."""
    values = dict.fromkeys(
        name for scenario in scenarios for name in (*_identified(scenario), *scenario.quantities())
    )
    errors = [f"{name}_se" for name in values]
    return [*_ROW_KEYS, *values, *errors, "status", "objective", "forgetting", "evaluations"]


def _identified(scenario: Scenario) -> tuple[str, ...]:
    """The parameters of the curve that is identified, if it is a curve."""
    return scenario.known.curve.free if "mu_max" in scenario.known.asked else ()


def _kept_share(estimate: Estimate) -> np.ndarray:
    """The factor by which earlier data were last discounted; 0 after a reset."""
    return np.where(estimate.reset, 0.0, estimate.forgetting)


def estimate_rows(
    config: Config,
    scenario: Scenario,
    names: tuple[str, ...],
    estimates: Mapping[str, Estimate],
    runs: np.ndarray,
) -> pd.DataFrame:
    """One row for each run, identifier and block of the tables that are `_STORED`."""
    tables = scenario.tables()
    groups = [group for name in _STORED if name in tables for group in tables[name]]
    blocks = np.array(sorted({block for group in groups for block in group.blocks}))
    frames = []
    for name in names:
        estimate: Estimate = jax.tree.map(lambda x: x[:, blocks], estimates[name])
        errors = standard_errors(estimate, list(estimate.values))
        columns: dict[str, object] = {
            "scenario": config.scenario,
            "run": np.repeat(runs, len(blocks)),
            "identifier": name,
            "block": np.tile(blocks, len(runs)),
            "rail": np.tile(np.array(scenario.rails)[blocks], len(runs)),
        }
        columns |= {key: np.ravel(value) for key, value in estimate.values.items()}
        columns |= {f"{key}_se": errors[..., i].ravel() for i, key in enumerate(estimate.values)}
        columns |= {
            "status": [Status(code).name.lower() for code in np.ravel(estimate.status)],
            "objective": np.ravel(estimate.objective),
            "forgetting": np.ravel(_kept_share(estimate)),
            "evaluations": np.ravel(estimate.evaluations),
        }
        frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)


def tracking_table(
    config: Config, scenario: Scenario, seen: Mapping[str, list[Tracking]]
) -> pd.DataFrame:
    """A row for each identifier and stretch of rail."""
    rails = [rail for b, rail in enumerate(scenario.rails) if rail != (None, *scenario.rails)[b]]
    unit = criteria_of(scenario.known).unit
    rows = []
    for name, parts in seen.items():
        runs: Tracking = jax.tree.map(lambda *x: np.concatenate(x), *parts)
        for stretch, rail in enumerate(rails):
            names = {"scenario": config.scenario, "identifier": name, "rail": rail}
            rows.append({**names, **tracking_row(runs, stretch, unit)})
    return pd.DataFrame(rows)


def bands_table(
    config: Config, scenario: Scenario, tiles: Sequence[Mapping[str, Estimate]]
) -> pd.DataFrame:
    """The median and the band from 5 to 95 % of each quantity after each block, over the runs."""
    frames = []
    for name in tiles[0]:
        found = [tile[name] for tile in tiles]
        tracked = {
            q: [np.asarray(estimate.values[q]) for estimate in found] for q in scenario.quantities()
        }
        tracked["forgetting"] = [_kept_share(estimate) for estimate in found]
        for quantity, parts in tracked.items():
            low, middle, high = np.quantile(np.concatenate(parts), [0.05, 0.5, 0.95], axis=0)
            columns = {
                "scenario": config.scenario,
                "identifier": name,
                "quantity": quantity,
                "block": np.arange(len(middle)),
                "p05": low,
                "median": middle,
                "p95": high,
            }
            frames.append(pd.DataFrame(columns))
    return pd.concat(frames, ignore_index=True)
