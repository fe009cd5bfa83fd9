"""Kinds of fault in measured runs on which an identification has failed, each made anew.

Every function returns the table of a log and what is true of it: `mu_max`, which an interval of
95 % should hold (None where no value would be right), `slip_opt` (None where no peak is to be
seen), and in words what a right answer is (`right`). Where a bound, a second curve or a cause is
known it stands beside them. Slip is slip velocity over vehicle speed; all units are SI.
"""

from collections.abc import Callable

import numpy as np
import pandas as pd
from stranger_runs import Array, Function, Random, Truth, autoregression, peaked, rounded

Fault = tuple[pd.DataFrame, dict[str, object]]


def _falling(level: float, rate: float, decay: float) -> Truth:
    """level (1 - exp(-rate s)) (.4 + .6 / (1 + s / decay))."""
    return peaked(lambda s: -level * np.expm1(-rate * s) * (0.4 + 0.6 / (1 + s / decay)), 0.0, 0.3)


DRY = _falling(0.38, 110.0, 0.18)
WET = _falling(0.19, 60.0, 0.3)


def _both_ways(curve: Function, slip: Array) -> Array:
    """The odd continuation of a curve to braking."""
    return np.sign(slip) * curve(np.abs(slip))


def _bumps(rng: Random, runs: int, rows: int, low: float = 0.001, top: float = 0.12) -> Array:
    """Slip of so many runs that rises to `top` within 15 %, and returns, as a squared sine."""
    shape = np.sin(np.linspace(0.0, np.pi, rows)) ** 2
    tops = top * rng.uniform(0.85, 1.15, runs)
    return np.concatenate([low + (highest - low) * shape for highest in tops])


def _rows(runs: int, rows: int, step: float) -> dict[str, Array]:
    """Time in s with a pause of 20 s between the runs, and the number of the run from 1."""
    run = np.repeat(np.arange(1, runs + 1), rows)
    time = step * np.tile(np.arange(rows), runs) + (run - 1) * (step * rows + 20.0)
    return {"time_s": time, "run": run}


def _peak(truth: Truth, right: str, **more: object) -> dict[str, object]:
    return {"mu_max": truth.mu_max, "slip_opt": truth.slip_opt, "right": right, **more}


def _no_peak(mu_max: float | None, right: str, **more: object) -> dict[str, object]:
    return {"mu_max": mu_max, "slip_opt": None, "right": right, **more}


def slow_level_noisy_slip(seed: int = 0) -> Fault:
    """Eight events at 25 Hz; level 4 % over 15 s, noise .004, slip errors .0009 over .25 s."""
    rng = np.random.default_rng([seed, 1])
    rows, step = 300, 0.04
    slip = _bumps(rng, 8, rows, 0.006, 0.1)
    level = autoregression(rng, slip.size, np.exp(-step / 15), 0.04)
    errors = autoregression(rng, slip.size, np.exp(-step / 0.25), 9e-4)
    adhesion = DRY.adhesion(slip) * (1 + level) + rng.normal(0.0, 0.004, slip.size)
    table = {**_rows(8, rows, step), "slip_ratio": slip + errors, "adhesion": adhesion}
    right = (
        "One curve holds for all runs: its interval has the peak, it is at most .07 wide, and the "
        "rms of the fit is at most 1.1 times that of plain least squares."
    )
    return pd.DataFrame(table), _peak(DRY, right)


def rolling_rows(seed: int = 0) -> Fault:
    """Eight brakings at 50 Hz between 3 s of rolling; noise .012 m/s (wheel), .0025 (adhesion)."""
    rng = np.random.default_rng([seed, 2])
    braking, rolling = 250, 150
    rows = braking + 2 * rolling
    bumps = _bumps(rng, 8, braking, 1e-4).reshape(8, braking)
    slip = -np.pad(bumps, ((0, 0), (rolling, rolling)), constant_values=1e-4).ravel()
    vehicle = np.repeat(rng.uniform(12.0, 22.0, 8), rows)
    wheel = vehicle * (1 + slip) + rng.normal(0.0, 0.012, slip.size)
    adhesion = _both_ways(DRY.adhesion, slip) + rng.normal(0.0, 0.0025, slip.size)
    table = {
        **_rows(8, rows, 0.02),
        "vehicle_speed_mps": vehicle,
        "wheel_speed_mps": wheel,
        "adhesion": adhesion,
    }
    right = (
        "The rows of rolling say nothing of the curve, as the noise of their slip times its slope "
        "exceeds that of adhesion: both intervals hold the truth, as they do without these rows."
    )
    return pd.DataFrame(table), _peak(DRY, right)


def held_slip(seed: int = 0) -> Fault:
    """Six runs in which a controller holds slip at .011, on the rise; a third of the rows roll."""
    rng = np.random.default_rng([seed, 3])
    rows = 300
    shape = np.interp(np.arange(rows), [0, 50, 60, 240, 250, 300], [0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    slip = np.tile(0.011 * shape, 6)
    vehicle = np.repeat(rng.uniform(12.0, 20.0, 6), rows)
    wheel = vehicle * (1 + slip) + rng.normal(0.0, 0.01, slip.size)
    adhesion = DRY.adhesion(slip) + rng.normal(0.0, 0.002, slip.size)
    table = {
        **_rows(6, rows, 0.02),
        "vehicle_speed_mps": vehicle,
        "wheel_speed_mps": wheel,
        "adhesion": adhesion,
    }
    right = (
        "The largest adhesion is at least what was reached at slip .011; no peak was seen, and an "
        "interval of mu_max has the truth or is open above."
    )
    reached = float(DRY.adhesion(np.asarray(0.011)))
    return pd.DataFrame(table), _no_peak(DRY.mu_max, right, at_least=reached)


def stuck_sensor(seed: int = 0) -> Fault:
    """Adhesion is .24 in every row, while slip goes to .1 and back."""
    rng = np.random.default_rng([seed, 4])
    slip = _bumps(rng, 3, 120, 0.0, 0.1)
    table = {**_rows(3, 120, 0.1), "slip_ratio": slip, "adhesion": np.full(slip.size, 0.24)}
    right = "A refusal that names the constant column, or .24 without a peak."
    return pd.DataFrame(table), _no_peak(0.24, right)


def independent_of_slip(seed: int = 0) -> Fault:
    """Adhesion N(.17, .035), whatever the slip."""
    rng = np.random.default_rng([seed, 5])
    slip = _bumps(rng, 4, 100, 0.0, 0.14)
    adhesion = rng.normal(0.17, 0.035, slip.size)
    table = {**_rows(4, 100, 0.1), "slip_ratio": slip, "adhesion": adhesion}
    right = "A sentence that these points show no dependence on slip, and no peak."
    return pd.DataFrame(table), _no_peak(None, right)


def swapped_columns(seed: int = 0) -> Fault:
    """What is called slip is adhesion, and the other way round."""
    rng = np.random.default_rng([seed, 6])
    slip = _bumps(rng, 4, 150, 0.0, 0.13)
    adhesion = DRY.adhesion(slip) + rng.normal(0.0, 0.006, slip.size)
    table = {**_rows(4, 150, 0.1), "slip_ratio": adhesion, "adhesion": slip}
    right = "A hint that slip and adhesion may be exchanged, and no value that is trusted."
    return pd.DataFrame(table), _no_peak(None, right, exchanged=(DRY.mu_max, DRY.slip_opt))


def velocity_steps(seed: int = 0) -> Fault:
    """Friction of a shear rig: .580 at 1 um/s, .618 after a step to 30 um/s, never at rest."""
    rng = np.random.default_rng([seed, 7])
    runs, rows, step = 4, 240, 0.5
    second = (np.arange(rows) - rows // 2) * step
    velocity = np.where(second < 0, 1e-6, 30e-6)
    friction = np.where(second < 0, 0.580, 0.618 + 0.012 * np.exp(-np.maximum(second, 0) / 8))
    size = runs * rows
    measured = np.tile(velocity, runs) * (1 + rng.normal(0.0, 0.03, size))
    table = {
        **_rows(runs, rows, step),
        "slip_velocity_mps": measured,
        "adhesion": np.tile(friction, runs) + rng.normal(0.0, 0.0015, size),
    }
    right = (
        "No rise from slip 0 was measured: no peak, and no narrow interval outside the friction "
        "that was seen (.58 to .63), or a refusal that says why."
    )
    return pd.DataFrame(table), _no_peak(None, right, seen=(0.58, 0.63))


def two_branches(seed: int = 0) -> Fault:
    """A wheel in loose soil: braking to -1.4 at slip -1, driving to .33 at .7, -.06 at slip 0."""
    rng = np.random.default_rng([seed, 8])
    one = np.concatenate([np.linspace(-1.0, -0.05, 16), np.linspace(0.0, 0.7, 14)])
    slip = np.tile(one, 3)
    branch = np.where(slip < 0, 1.34 * np.expm1(slip / 0.35), -0.39 * np.expm1(-slip / 0.12))
    adhesion = branch - 0.06 + rng.normal(0.0, 0.015, slip.size)
    table = {"run": np.repeat([1, 2, 3], one.size), "slip_ratio": slip, "adhesion": adhesion}
    right = (
        "Braking and driving follow no one curve: a sentence that says so, with an answer for each "
        "or for none. The value at slip 0 is an offset, the resistance to rolling."
    )
    by_branch = {"braking": 1.34 * float(-np.expm1(-1 / 0.35)) + 0.06, "driving": 0.33}
    return pd.DataFrame(table), _no_peak(None, right, largest=by_branch)


def two_surfaces(seed: int = 0) -> Fault:
    """Ten runs, the odd ones on concrete and the even ones on ice, told by the column surface."""
    rng = np.random.default_rng([seed, 9])
    rows = 120
    table = pd.DataFrame(_rows(10, rows, 0.1))
    slip = _bumps(rng, 10, rows)
    concrete = table["run"].to_numpy() % 2 == 1
    ice = peaked(lambda s: -0.1 * np.expm1(-45 * s) - 0.12 * s)
    clean = np.where(concrete, DRY.adhesion(slip), ice.adhesion(slip))
    table["slip_ratio"] = slip
    table["adhesion"] = clean + rng.normal(0.0, 0.006, slip.size)
    table["surface"] = np.where(concrete, "concrete", "ice")
    right = (
        "No one curve holds for all runs; compared by surface the groups differ, and each has its "
        "own peak within its interval."
    )
    peaks = {"concrete": (DRY.mu_max, DRY.slip_opt), "ice": (ice.mu_max, ice.slip_opt)}
    return table, _no_peak(None, right, by_surface=peaks)


def tooth_spikes(seed: int = 0) -> Fault:
    """Ten runs; 1 % of the wheel speeds are 1.5 times too large, as by a tooth counted twice."""
    rng = np.random.default_rng([seed, 10])
    rows = 140
    slip = _bumps(rng, 10, rows)
    vehicle = np.repeat(rng.uniform(9.0, 16.0, 10), rows)
    spikes = np.zeros(slip.size, bool)
    spikes[rng.choice(slip.size, slip.size // 100, replace=False)] = True
    wheel = (vehicle * (1 + slip) + rng.normal(0.0, 0.004, slip.size)) * np.where(spikes, 1.5, 1.0)
    table = {
        **_rows(10, rows, 0.05),
        "vehicle_speed_mps": vehicle,
        "wheel_speed_mps": wheel,
        "adhesion": DRY.adhesion(slip) + rng.normal(0.0, 0.005, slip.size),
    }
    right = (
        "Both intervals hold the truth and are as narrow as without the spikes; the rows with a "
        "slip near .5 are left out and counted, or have no weight."
    )
    return pd.DataFrame(table), _peak(DRY, right, spikes=int(spikes.sum()))


def shifted_signals(seed: int = 0) -> Fault:
    """Adhesion stands one second too late beside slip, in runs of 7 s at 20 Hz."""
    rng = np.random.default_rng([seed, 11])
    rows, late = 140, 20
    slip = _bumps(rng, 9, rows)
    clean = DRY.adhesion(slip).reshape(9, rows)
    shifted = np.concatenate([np.repeat(clean[:, :1], late, 1), clean[:, :-late]], 1).ravel()
    table = {
        **_rows(9, rows, 0.05),
        "slip_ratio": slip,
        "adhesion": shifted + rng.normal(0.0, 0.006, slip.size),
    }
    right = (
        "A sentence that adhesion follows slip by about 1 s, or that rise and return of slip are "
        "two curves; no narrow interval without the truth."
    )
    return pd.DataFrame(table), _peak(DRY, right, delay_s=1.0)


def late_in_few_rows(seed: int = 0) -> Fault:
    """Adhesion stands .6 s too late beside slip, in three runs of 40 rows at 10 Hz."""
    rng = np.random.default_rng([seed, 13])
    rows, late = 40, 6
    slip = _bumps(rng, 3, rows)
    clean = DRY.adhesion(slip).reshape(3, rows)
    shifted = np.concatenate([np.repeat(clean[:, :1], late, 1), clean[:, :-late]], 1).ravel()
    table = {
        **_rows(3, rows, 0.1),
        "slip_ratio": slip,
        "adhesion": shifted + rng.normal(0.0, 0.004, slip.size),
    }
    right = "A sentence that adhesion follows slip by about .6 s."
    return pd.DataFrame(table), _peak(DRY, right, delay_s=0.6)


def one_sweep_slow_rail(seed: int = 0) -> Fault:
    """One sweep of 200 rows at 20 Hz; the level varies by 3 % over 2.5 s, noise .002."""
    rng = np.random.default_rng([seed, 14])
    rows, step = 200, 0.05
    slip = np.linspace(0.001, 0.12, rows)
    level = autoregression(rng, rows, np.exp(-step / 2.5), 0.03)
    adhesion = DRY.adhesion(slip) * (1 + level) + rng.normal(0.0, 0.002, rows)
    table = {**_rows(1, rows, step), "slip_ratio": slip, "adhesion": adhesion}
    right = "A warning that the rail and the shape of the curve cannot be told apart."
    return pd.DataFrame(table), _peak(DRY, right)


def rails_in_one_log(seed: int = 0) -> Fault:
    """One log of 150 s at 20 Hz with five events; in the third the rail turns from dry to wet."""
    rng = np.random.default_rng([seed, 12])
    size, step = 3000, 0.05
    slip = 0.004 + 0.001 * np.sin(np.arange(size) / 40)
    shape = np.sin(np.linspace(0.0, np.pi, 240)) ** 2
    for event in range(5):
        start = 180 + 600 * event
        slip[start : start + 240] += (rng.uniform(0.09, 0.13) - 0.004) * shape
    dry = np.arange(size) < 180 + 600 * 2 + 130
    clean = np.where(dry, DRY.adhesion(slip), WET.adhesion(slip))
    table = {
        "time_s": step * np.arange(size),
        "slip_ratio": rounded(slip + rng.normal(0.0, 3e-4, size), 1e-4),
        "adhesion": clean + rng.normal(0.0, 0.006, size),
        "rail": np.where(dry, "dry", "wet"),
    }
    right = (
        "No one curve holds for the whole log, and the rail changes within an event: compared by "
        "rail the two differ and each has its own peak, or a sentence says what to cut apart."
    )
    peaks = {"dry": (DRY.mu_max, DRY.slip_opt), "wet": (WET.mu_max, WET.slip_opt)}
    return pd.DataFrame(table), _no_peak(None, right, by_rail=peaks)


#: The faults by name, each a function of a seed.
FAULTS: dict[str, Callable[[int], Fault]] = {
    made.__name__: made
    for made in (
        slow_level_noisy_slip,
        rolling_rows,
        held_slip,
        stuck_sensor,
        independent_of_slip,
        swapped_columns,
        velocity_steps,
        two_branches,
        two_surfaces,
        tooth_spikes,
        shifted_signals,
        late_in_few_rows,
        one_sweep_slow_rail,
        rails_in_one_log,
    )
}
