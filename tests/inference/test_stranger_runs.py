"""The curves, runs, faults and trips that identification is judged by are what they say."""

import coverage
import numpy as np
import pandas as pd
import pytest
from fault_forms import DRY, FAULTS, WET
from scipy import stats
from stranger_runs import BURCKHARDT, CELLS, RUNS, SD, STRANGERS, draw, parts

SEEDS = range(40)


def series(name, of):
    """A part of draws of a cell, a row a run."""
    drawn = [parts(CELLS[name], seed) for seed in SEEDS]
    return np.concatenate([of(part).reshape(np.unique(part.design.run).size, -1) for part in drawn])


def lag_one(rows):
    """Correlation of neighbours whose mean is known to be 0, pooled over runs."""
    return (rows[:, 1:] * rows[:, :-1]).sum() / (rows[:, :-1] ** 2).sum()


@pytest.mark.parametrize("name", [None, *STRANGERS])
def test_the_peak_is_that_of_a_fine_grid(name):
    truth = STRANGERS.get(name, BURCKHARDT)
    slip = np.linspace(0.0, 0.15, 150_001)
    values = truth.adhesion(slip)
    top = values.argmax()
    assert truth.slip_opt == pytest.approx(slip[top], abs=2e-5)
    # At a kink the minimisation stops beside the grid's point, by its tolerance of 1e-9 in slip.
    assert values[top] - 1e-9 < truth.mu_max < values[top] + 1e-7
    assert 0.02 < truth.slip_opt < 0.08
    assert values[0] == pytest.approx(0.0, abs=1e-12)
    assert (np.diff(values[: top - 1]) > 0).all()
    assert (np.diff(values[top + 1 :]) < 0).all()


def test_the_peak_of_burckhardt_has_a_closed_form():
    at = np.log(0.32 * 60 / 0.35) / 60
    assert pytest.approx(at, abs=1e-7) == BURCKHARDT.slip_opt
    assert pytest.approx(0.32 - 0.35 / 60 - 0.35 * at, abs=1e-12) == BURCKHARDT.mu_max


def test_there_are_enough_curves_and_each_has_its_cell():
    assert len(STRANGERS) >= 15
    assert {f"curve-{name}" for name in STRANGERS} <= set(CELLS)


@pytest.mark.parametrize("name", CELLS)
def test_the_same_seed_gives_the_same_table_and_another_one_another(name):
    cell = CELLS[name]
    first = draw(cell, 3)
    pd.testing.assert_frame_equal(first, draw(cell, 3))
    assert not np.allclose(first["adhesion"], draw(cell, 4)["adhesion"])
    assert list(first) == ["time_s", "run", "slip_ratio", "adhesion"]
    assert np.isfinite(first).all(axis=None)
    assert (np.diff(first["time_s"]) > 0).all()


def test_cells_do_not_share_their_noise():
    made = [parts(CELLS[name], 0).noise for name in ("white", "run-levels", "curve-brush")]
    assert np.abs(np.corrcoef(made) - np.eye(3)).max() < 5 / np.sqrt(2400)


@pytest.mark.parametrize("name", [name for name in CELLS if not name.startswith(("log", "roll"))])
def test_twelve_runs_of_200_points_rise_and_return(name):
    table = draw(CELLS[name], 0)
    slip = parts(CELLS[name], 0).design.slip.reshape(RUNS, 200)
    assert table.groupby("run").size().tolist() == [200] * 12
    assert np.diff(table["time_s"])[:199] == pytest.approx(0.1)
    assert slip[:, [0, -1]] == pytest.approx(0.002)
    top = slip.max(axis=1)
    assert ((top > 0.098) & (top < 0.15)).all()
    assert np.unique(top).size == RUNS
    assert (np.diff(slip[:, :100]) > 0).all()
    assert slip == pytest.approx(slip[:, ::-1])


@pytest.mark.parametrize(
    ("name", "of", "sd", "rho"),
    [
        ("white", lambda part: part.noise, SD, 0.0),
        ("curve-lugre", lambda part: part.noise, SD, 0.0),
        ("ar50", lambda part: part.noise, SD, 0.5),
        ("ar95", lambda part: part.noise, SD, 0.95),
        ("log", lambda part: part.noise, SD, 0.6),
        ("slip-noise", lambda part: part.slip_error, 0.002, 0.0),
        ("slow", lambda part: part.slip_error, 0.0007, 0.8),
        ("slow", lambda part: part.level, 0.03, np.exp(-1 / 100)),
        ("slow-continued", lambda part: part.level, 0.03, np.exp(-1 / 400)),
        ("log-slow", lambda part: part.level, 0.03, np.exp(-1 / 400)),
        ("rolling", lambda part: part.noise, 0.002, 0.0),
        ("quantised", lambda part: part.noise, SD, 0.0),
    ],
)
def test_the_noise_has_its_size_and_correlation_within_sampling_error(name, of, sd, rho):
    rows = series(name, of)
    # Bartlett 1946: variances of the moments of an autoregression, from as many neighbours.
    deviation = np.sqrt((1 + rho**2) / (1 - rho**2) / 2 / rows.size)
    assert rows.std() == pytest.approx(sd, rel=4.5 * deviation)
    assert lag_one(rows) == pytest.approx(rho, abs=4.5 * np.sqrt((1 - rho**2) / rows.size))


@pytest.mark.parametrize("name", ["white", "ar50", "run-levels", "log-slow", "curve-tmeasy"])
def test_points_are_the_curve_times_the_level_plus_noise(name):
    part, table = parts(CELLS[name], 2), draw(CELLS[name], 2)
    curve = CELLS[name].truth.adhesion(table["slip_ratio"].to_numpy())
    left = table["adhesion"] - curve - part.noise
    assert left.to_numpy() == pytest.approx(curve * part.level, abs=1e-14)


def test_a_run_has_one_level_and_levels_scatter_by_a_hundredth():
    rows = series("run-levels", lambda part: part.level)
    assert np.ptp(rows, axis=1).max() == 0
    levels = rows[:, 0]
    assert levels.std() == pytest.approx(0.01, rel=4.5 / np.sqrt(2 * levels.size))


def test_a_level_goes_on_from_run_to_run_where_the_cell_says_so():
    jumps = {}
    for name in ("slow", "slow-continued"):
        level = series(name, lambda part: part.level).reshape(len(SEEDS), RUNS, 200)
        jumps[name] = np.abs(level[:, 1:, 0] - level[:, :-1, -1]).mean() / 0.03
    # The mean size of the difference of two normal values of correlation rho is 2 sqrt((1-rho)/pi).
    tries = len(SEEDS) * (RUNS - 1)
    for name, rho in (("slow", 0.0), ("slow-continued", np.exp(-1 / 400))):
        mean = 2 * np.sqrt((1 - rho) / np.pi)
        assert jumps[name] == pytest.approx(mean, rel=4.5 * 0.76 / np.sqrt(tries))


def test_tails_outliers_and_growth_are_as_they_say():
    heavy = series("heavy-tails", lambda part: part.noise).ravel()
    assert stats.kstest(heavy / SD * np.sqrt(3), stats.t(3).cdf).pvalue > 1e-3
    assert stats.kstest(heavy / heavy.std(), "norm").pvalue < 1e-6

    outliers = np.abs(series("outliers", lambda part: part.noise).ravel())
    share = (outliers > 5 * SD).mean()
    assert share == pytest.approx(0.03, abs=4.5 * np.sqrt(0.03 * 0.97 / outliers.size))
    assert outliers[outliers > 5 * SD].mean() == pytest.approx(10 * SD, rel=0.02)

    noise = series("heteroscedastic", lambda part: part.noise).ravel()
    clean = series("heteroscedastic", lambda part: part.clean).ravel()
    for low, high in ((0.0, 0.15), (0.15, 0.25), (0.28, 0.3)):
        here = (clean > low) & (clean < high)
        expected = np.sqrt(np.mean((0.003 + 0.05 * clean[here]) ** 2))
        error = 4.5 / np.sqrt(2 * here.sum())
        assert noise[here].std() == pytest.approx(expected, rel=1.1 * error)


def test_rounded_points_are_whole_steps_at_most_half_a_step_off():
    table, part = draw(CELLS["quantised"], 0), parts(CELLS["quantised"], 0)
    for column, step, exact in (
        ("adhesion", 0.02, part.clean + part.noise),
        ("slip_ratio", 0.001, part.design.slip),
    ):
        steps = table[column] / step
        assert np.abs(steps - steps.round()).max() < 1e-9
        assert np.abs(table[column] - exact).max() <= step / 2 + 1e-12


def test_rolling_rows_surround_each_run_and_have_the_noise_of_a_wheel():
    part = parts(CELLS["rolling"], 0)
    slip = part.design.slip.reshape(RUNS, 280)
    rolling = np.r_[0:40, 240:280]
    assert slip[:, rolling].max() < 0.001
    assert slip[:, 40:240].min() > 0.0015
    sds = series("rolling", lambda part: part.slip_error).std(axis=1)
    assert 0.01 / 20 * 0.8 < sds.min() < sds.max() < 0.01 / 10 * 1.2
    # The root of the mean of (.01 / v)^2 over speeds from 10 to 20 m/s is .01 / sqrt(200).
    assert np.sqrt((sds**2).mean()) == pytest.approx(0.01 / np.sqrt(200), rel=0.1)


def test_a_log_has_six_events():
    for seed in SEEDS:
        slip = parts(CELLS["log"], seed).design.slip
        assert slip.size == 3000
        assert (np.diff((slip > 0.05).astype(int)) == 1).sum() == 6
        assert 0.1 <= np.sort(slip)[-6:].max() < 0.15
        assert 0.001 < slip.min() < 0.004


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_has_a_table_and_says_what_is_right(name):
    table, truth = FAULTS[name](0)
    pd.testing.assert_frame_equal(table, FAULTS[name](0)[0])
    assert truth["right"].endswith(".")
    assert truth["slip_opt"] is None or truth["mu_max"] is not None
    assert np.isfinite(table.select_dtypes("number")).all(axis=None)


def test_faults_have_the_form_that_they_are_named_after():
    held, truth = FAULTS["held_slip"](0)
    slip = held["wheel_speed_mps"] / held["vehicle_speed_mps"] - 1
    assert slip.max() < DRY.slip_opt / 2
    assert held["adhesion"].max() > truth["at_least"]

    assert (FAULTS["stuck_sensor"](0)[0]["adhesion"] == 0.24).all()
    free = FAULTS["independent_of_slip"](0)[0]
    assert stats.pearsonr(free["slip_ratio"], free["adhesion"]).pvalue > 0.01

    swapped, truth = FAULTS["swapped_columns"](0)
    slip = swapped["adhesion"].to_numpy()
    assert np.std(swapped["slip_ratio"] - DRY.adhesion(slip)) == pytest.approx(0.006, rel=0.1)
    assert truth["exchanged"] == (DRY.mu_max, DRY.slip_opt)

    spikes, truth = FAULTS["tooth_spikes"](0)
    ratio = spikes["wheel_speed_mps"] / spikes["vehicle_speed_mps"]
    assert (ratio > 1.4).sum() == truth["spikes"] == len(spikes) // 100

    shifted = FAULTS["shifted_signals"](0)[0]
    errors = [
        (shifted["adhesion"] - DRY.adhesion(shifted.groupby("run")["slip_ratio"].shift(rows))).std()
        for rows in range(41)
    ]
    assert np.argmin(errors) == 20  # rows of .05 s

    rails = FAULTS["rails_in_one_log"](0)[0]
    change = int((rails["rail"] == "wet").to_numpy().argmax())
    assert rails["slip_ratio"][change] > 0.05
    wet = rails[rails["rail"] == "wet"]
    left = wet["adhesion"] - WET.adhesion(wet["slip_ratio"].to_numpy())
    assert left.std() < 0.02


def test_plain_least_squares_finds_the_peak_of_points_without_noise():
    part = parts(CELLS["white"], 0)
    frame = pd.DataFrame({"slip_ratio": part.design.slip, "adhesion": part.clean})
    mu_max, slip_opt = coverage.plain_least_squares(frame)
    assert mu_max == pytest.approx(BURCKHARDT.mu_max, abs=1e-7)
    assert slip_opt == pytest.approx(BURCKHARDT.slip_opt, abs=1e-5)


def test_the_summary_counts_by_hand():
    """Four sets: held, missed, no peak, an error; Clopper and Pearson's interval of 1 of 2."""
    row = dict.fromkeys(coverage.COLUMNS, "") | {"cell": "white", "seconds": 1.0}
    row |= {"mu_max_true": 0.3, "slip_opt_true": 0.05, "ls_mu_max": 0.31, "ls_slip_opt": 0.05}
    nan = float("nan")

    def found(mu, low, high, slip, slip_low, slip_high):
        values = (mu, low, high, slip, slip_low, slip_high)
        names = [f"{name}{end}" for name in coverage.QUANTITIES for end in ("", "_low", "_high")]
        return row | dict(zip(names, values, strict=True))

    rows = [
        found(0.301, 0.29, 0.31, 0.05, 0.04, 0.06),
        found(0.32, 0.315, 0.325, 0.07, 0.06, 0.08) | {"vetoes": "no"},
        found(0.3, nan, nan, nan, nan, nan),
        row | {"error": "InputError"},
    ]
    table = coverage.summary(pd.DataFrame(rows)).set_index("quantity")
    assert table.loc["mu_max", ["sets", "errors"]].tolist() == [3, 1]
    assert table["coverage"].to_dict() == pytest.approx({"mu_max": 1 / 3, "slip_opt": 1 / 2})
    # Of 1 in 2 the ends are 1 - sqrt(1 - .025) and its mirror image.
    low = 1 - np.sqrt(1 - 0.025)
    assert table.loc["slip_opt", ["cp_low", "cp_high"]].tolist() == pytest.approx([low, 1 - low])
    assert table.loc["mu_max", "bias"] == pytest.approx(0.007)
    assert table.loc["mu_max", "rmse"] == pytest.approx(np.sqrt((1e-6 + 4e-4) / 3))
    assert table.loc["mu_max", "ls_rmse"] == pytest.approx(0.01)
    assert table.loc["slip_opt", "width"] == pytest.approx(0.02)
    assert table.loc["mu_max", ["veto", "no_peak"]].tolist() == pytest.approx([1 / 3, 1 / 3])


def held(cells, seeds):
    """In how many sets `identify` holds the truth, by quantity; no set fails or lacks a peak."""
    drawn = [coverage.one(cell, seed) for cell in cells for seed in range(seeds)]
    table = coverage.summary(pd.DataFrame(drawn))
    assert (table[["errors", "no_peak"]] == 0).all(axis=None)
    assert (table["sets"] == seeds).all()
    return (table["coverage"] * seeds).round().astype(int).groupby(table["quantity"]).sum()


@pytest.mark.slow
@pytest.mark.parametrize("cell", ["white", "ar50", "ar95", "run-levels", "slip-noise", "slow"])
def test_the_intervals_hold_the_truth_in_six_kinds_of_noise(cell):
    found = held([cell], 60)
    # Fewer than this happen once in ten thousand if coverage is 95 %.
    assert (found >= stats.binom.ppf(1e-4, 60, 0.95)).all()


@pytest.mark.slow
def test_the_intervals_hold_the_truth_of_curves_that_are_not_offered():
    # What has a kink at its peak, or is level there, is told in docs/results.md to fail.
    smooth = [name for name in STRANGERS if not name.startswith(("tmeasy", "spline", "arctan"))]
    assert len(smooth) >= 9
    found = held([f"curve-{name}" for name in smooth], 10)
    assert (found >= stats.binom.ppf(1e-4, 10 * len(smooth), 0.90)).all()
