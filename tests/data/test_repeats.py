"""Error bars of the adhesion: a column of them, and the scatter of repeated measurements."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.data import read_measured, to_measured, to_record, to_runs
from adhesion_jax.data.columns import guess, side_by_side
from adhesion_jax.errors import InputError

SHARED = Path(__file__).parents[3] / "shared" / "faults" / "newcomer"

SLIPS = np.linspace(0.002, 0.1, 30)


def curve(slip):
    return 0.42 * (1 - np.exp(-slip / 0.006)) * (0.75 + 0.25 * np.exp(-slip / 0.08))


def noisy(seed=0, repeated=3):
    """Adhesion of each repeat, [repeats, slips]: noise of 0.006 up to 3 % of slip, 0.03 above."""
    noise = np.random.default_rng(seed).normal(0, 1, (repeated, SLIPS.size))
    return curve(SLIPS) + noise * np.where(SLIPS < 0.03, 0.006, 0.03)


def wide(seed=0, pattern="mu_{}"):
    repeat = {pattern.format(i): values for i, values in enumerate(noisy(seed), 1)}
    return pd.DataFrame({"slip_ratio": SLIPS, **repeat})


def long(seed=0):
    values = noisy(seed)
    return pd.DataFrame({"slip_ratio": np.tile(SLIPS, len(values)), "mu": values.ravel()}).assign(
        Run=np.repeat(np.arange(1, len(values) + 1), SLIPS.size)
    )


def expected(slip, adhesion):
    """The pooled standard deviation by the formula, slip by slip, without any cumulation."""
    slips = np.unique(slip)
    found = {}
    for place, one in enumerate(slips):
        first = min(max(place - 2, 0), slips.size - 5)
        groups = [adhesion[slip == other] for other in slips[first : first + 5]]
        squares = sum(((group - group.mean()) ** 2).sum() for group in groups)
        found[one] = np.sqrt(squares / sum(group.size - 1 for group in groups))
    return np.array([found[one] for one in slip])


@pytest.mark.parametrize(
    "name",
    [
        "adhesion_sd",
        "mu_std",
        "mu_sd",
        "sigma_mu",
        "std_mu",
        "µ_std",
        "standard deviation of adhesion",
        "standard deviation of COF",
        "error of mu",
        "mu_std [%]",
        "mu ±",
        "mu +-",
        "±mu",
        "+/- COF",
    ],
)
def test_a_column_of_standard_deviations_is_known_by_its_name(name):
    assert guess(name).quantity == "adhesion_sd"


def test_error_bars_are_a_column_of_the_record_and_no_covariate():
    table = wide().rename(columns={"mu_1": "mu"})[["slip_ratio", "mu"]]
    table = table.assign(**{"mu_std [%]": np.linspace(0.5, 3, 30), "wear": np.arange(30.0)})
    found = to_measured("lab", table)
    np.testing.assert_allclose(found.table["adhesion_sd"], np.linspace(0.005, 0.03, 30))
    np.testing.assert_allclose(
        to_record(found).conditions["adhesion_sd"], np.linspace(0.005, 0.03, 30), rtol=1e-6
    )
    assert found.covariates == ("wear",)
    runs = to_runs([found])
    assert "adhesion_sd" not in runs.whole.conditions
    assert runs.covariates == ("wear",)


@pytest.mark.parametrize("name", ["std", "SD", "+-", "±"])
def test_a_standard_deviation_may_follow_the_adhesion_without_its_name(name):
    table = pd.DataFrame({"slip_ratio": SLIPS, "mu": curve(SLIPS), name: 0.01})
    np.testing.assert_array_equal(to_measured("lab", table).table["adhesion_sd"], 0.01)
    other = to_measured("lab", table[["mu", "slip_ratio", name]])
    assert "adhesion_sd" not in other.table
    assert other.covariates == (name,)


@pytest.mark.parametrize("name", ["n", "repeats", "count", "Number of repeats"])
def test_the_number_of_repeats_divides_the_variance(name):
    count = np.arange(1.0, 31.0)
    table = pd.DataFrame({"slip_ratio": SLIPS, "mu": curve(SLIPS), "mu_std": 0.03, name: count})
    found = to_measured("lab", table)
    np.testing.assert_allclose(found.table["adhesion_sd"], 0.03 / np.sqrt(count), rtol=1e-12)
    assert found.covariates == ()
    assert "repeats" not in found.table
    # Without a standard deviation it is a column as any other, or what is asked for a rotation.
    alone = to_measured("lab", table.drop(columns="mu_std"))
    assert "adhesion_sd" not in alone.table
    assert name == "repeats" or alone.covariates == (name,)


def test_a_wheel_that_turns_is_no_number_of_repeats():
    table = pd.DataFrame(
        {"slip_ratio": SLIPS, "mu": curve(SLIPS), "mu_std": 0.03, "n [1/min]": 9.0}
    )
    np.testing.assert_array_equal(to_measured("lab", table).table["adhesion_sd"], 0.03)


@pytest.mark.parametrize("value", [0.0, -0.01])
def test_a_standard_deviation_that_is_not_positive_costs_its_row(value):
    table = wide()[["slip_ratio", "mu_1"]].rename(columns={"mu_1": "mu"}).assign(mu_std=0.01)
    table.loc[7, "mu_std"] = value
    found = to_measured("lab", table)
    assert found.table.index.tolist() == [*range(7), *range(8, 30)]
    assert "row 7 of column mu_std has" in found.notes[0]
    assert "deviation is positive" in found.notes[0]
    found = to_measured("lab", table.assign(mu_std=value))
    assert "adhesion_sd" not in found.table
    assert "The column adhesion_sd is left out: row 0 of column mu_std has" in found.notes[0]


@pytest.mark.parametrize("pattern", ["mu_{}", "mu{}", "mu {}", "COF_{} [-]", "mu_{} [%]"])
def test_repeats_side_by_side_are_rows_of_runs(pattern):
    table = wide(pattern=pattern)
    if "%" in pattern:
        table.iloc[:, 1:] *= 100
    found = to_measured("lab", table)
    np.testing.assert_allclose(found.table["adhesion"], noisy().ravel(), rtol=1e-12)
    np.testing.assert_array_equal(found.table["slip_ratio"], np.tile(SLIPS, 3))
    assert found.table["run"].astype(str).tolist() == [one for one in "123" for _ in SLIPS]
    assert found.table.index.tolist() == 3 * list(range(30))
    assert found.covariates == ()
    assert [note for note in found.notes if "are 3 repeats of the adhesion" in note]
    assert to_runs([found]).names == ("1", "2", "3")


def test_repeats_of_runs_are_runs_of_their_own():
    table = wide().assign(Fahrt=["a"] * 15 + ["b"] * 15)
    names = to_measured("lab", table).table["run"].astype(str)
    assert names.unique().tolist() == ["a/1", "b/1", "a/2", "b/2", "a/3", "b/3"]


def test_gaps_in_one_repeat_cost_one_row():
    table = wide()
    table.loc[4, "mu_2"] = np.nan
    found = to_measured("lab", table)
    assert len(found.table) == 89
    assert found.table.index.tolist() == [*range(30), *range(4), *range(5, 30), *range(30)]


@pytest.mark.parametrize(
    ("value", "says"), [("x", "has the text 'x'"), (9.0, "has 9, outside -3 to 3")]
)
def test_a_fault_in_a_repeat_names_its_column_and_row(value, says):
    table = wide().astype(object)
    table.loc[6, "mu_3"] = value
    found = to_measured("lab", table)
    assert f"row 6 of column mu_3 {says}" in " ".join(found.notes)
    assert len(found.table) == 89
    table.loc[6:16, "mu_3"] = "x"
    with pytest.raises(InputError, match="row 6 of column mu_3 has the text 'x'"):
        to_measured("lab", table)


def test_repeats_have_an_index_without_a_gap():
    def found(*names):
        return side_by_side({name: guess(name) for name in names})

    assert found("mu_2", "mu_1") == ["mu_1", "mu_2"]
    assert found("mu_0", "mu_1") == ["mu_0", "mu_1"]
    assert found("mu_1", "mu_3") == found("mu_1") == found("mu", "mu_1") == []


def test_where_they_may_be_something_else_than_repeats_is_asked():
    for further in ({"time_s": np.arange(30.0)}, {"mu": curve(SLIPS)}):
        with pytest.raises(InputError, match=r"which of the columns .*mu_1.* is the adhesion"):
            to_measured("lab", wide().assign(**further))
    said = to_measured("lab", wide(), {"adhesion": "mu_2"})
    np.testing.assert_array_equal(said.table["adhesion"], noisy()[1])


@pytest.mark.parametrize("table", [wide(1), long(1)], ids=["columns", "rows"])
def test_the_scatter_of_repeats_is_that_of_five_slips(table):
    found = to_measured("lab", table)
    values = found.table["adhesion"].to_numpy()
    np.testing.assert_allclose(
        found.table["adhesion_sd"], expected(np.tile(SLIPS, 3), values), rtol=1e-9
    )
    assert found.table["run"].nunique() == 3
    assert "that of the repeats, which 30 of 30 slips have" in found.notes[-1]


def test_the_scatter_of_repeats_is_the_noise():
    """The mean square over 40 campaigns against the noise, away from its step; 10 degrees each."""
    away = np.r_[:6, 12:30]
    squares = np.mean(
        [to_measured("lab", wide(seed)).table["adhesion_sd"][:30] ** 2 for seed in range(40)], 0
    )
    noise = np.where(SLIPS < 0.03, 0.006, 0.03)
    # A variance of 400 degrees of freedom is known to 7 %.
    np.testing.assert_allclose(squares[away], noise[away] ** 2, rtol=0.3)


def test_a_slip_that_is_not_repeated_has_the_scatter_of_its_neighbours():
    table = long(2).drop(index=[40, 70])  # slip 10 is left once
    found = to_measured("lab", table).table
    assert found["adhesion_sd"].notna().all()
    assert found["adhesion_sd"][10] in {*found["adhesion_sd"][9:10], *found["adhesion_sd"][11:12]}


@pytest.mark.parametrize(
    "table",
    [
        long().assign(normal_load_N=np.repeat([3e4, 5e4, 8e4], 30)),  # three loads, no repeats
        long().assign(time_s=np.arange(90.0)),
        long()[:40],  # ten of thirty slips are repeated
        long().assign(mu=np.tile(curve(SLIPS), 3)),  # copies, no measurements
        long()[long()["slip_ratio"] < SLIPS[4]],  # four slips
    ],
    ids=["loads", "time", "few", "copies", "four"],
)
def test_rows_that_are_no_repeats_have_no_scatter(table):
    assert "adhesion_sd" not in to_measured("lab", table).table


def test_repeats_at_several_loads_are_compared_at_the_same_load():
    one, other = long(3), long(4)
    level = pd.concat([one, other.assign(mu=other["mu"] - 0.2)], ignore_index=True)
    found = to_measured("lab", level.assign(normal_load_N=np.repeat([3e4, 8e4], 90))).table
    pairs = np.stack([noisy(3), noisy(4)])  # [loads, repeats, slips]
    squares = ((pairs - pairs.mean(1, keepdims=True)) ** 2).sum((0, 1))
    middle = np.sqrt(np.convolve(squares, np.ones(5), "valid") / (5 * 4))
    np.testing.assert_allclose(found["adhesion_sd"][2:28], middle, rtol=1e-9)


@pytest.mark.skipif(not SHARED.is_dir(), reason="the files of the trials are not there")
def test_files_of_a_laboratory():
    bars = read_measured(SHARED / "lab_errorbars.csv")
    raw = pd.read_csv(SHARED / "lab_errorbars.csv")
    np.testing.assert_array_equal(bars.table["adhesion_sd"], raw["mu_std"])
    side = read_measured(SHARED / "lab_repeats_wide.csv").table
    below = read_measured(SHARED / "lab_Run.csv").table
    raw = pd.read_csv(SHARED / "lab_repeats_wide.csv")
    np.testing.assert_array_equal(side["adhesion"], raw[["mu_1", "mu_2", "mu_3"]].T.to_numpy().flat)
    assert below["run"].astype(str).unique().tolist() == ["1", "2", "3"]
    for table in (side, below):
        # Their noise is 0.006 below 3 % of slip and 0.03 above.
        clear = table[(table["slip_ratio"] < 0.02) | (table["slip_ratio"] > 0.045)]
        noise = np.where(clear["slip_ratio"] < 0.03, 0.006, 0.03)
        assert (clear["adhesion_sd"] / noise).between(0.4, 1.8).all()
