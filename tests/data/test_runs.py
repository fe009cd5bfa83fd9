import gzip
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from adhesion_jax.data import SHIPPED, check_curve, matching, read_all, read_measured, runs, to_runs
from adhesion_jax.data.runs import cut_alike, in_blocks, with_run_time
from adhesion_jax.data.stretches import steps_in_runs
from adhesion_jax.errors import InputError

PRACTICE = Path(__file__).parents[3] / "shared" / "practice"


def rows_of(found):
    """The rows of the files at the points of the record, [runs, points]; -1: masked."""
    held, inside = found.layout
    return np.where(inside, found.places[held], -1)


def good(rows=12):
    slip = np.linspace(0.01, 0.12, rows)
    return pd.DataFrame({"slip_ratio": slip, "adhesion": 0.3 * slip / (0.02 + slip)})


def written(tmp_path, table, name="set.csv"):
    path = tmp_path / name
    table.to_csv(path, index=False)
    return path


def campaign(lengths=(6, 4, 5)):
    """Runs named a, b, c ... of the given lengths, each from time 0 on."""
    table = good(sum(lengths)).assign(vehicle_speed_mps=10.0)
    table["run"] = np.repeat([chr(97 + number) for number in range(len(lengths))], lengths)
    table["time_s"] = np.concatenate([0.1 * np.arange(length) for length in lengths])
    return table


def refused(*paths):
    with pytest.raises(InputError) as error:
        to_runs(read_all(paths))
    said = str(error.value)
    assert "\n" not in said
    assert said.endswith(".")
    return said


def test_runs_stand_side_by_side_padded_with_their_last_row(tmp_path):
    table = campaign().assign(wear=np.arange(15.0) ** 2)
    found = to_runs(read_all([written(tmp_path, table)]))
    assert found.names == ("a", "b", "c")
    assert found.covariates == ("wear",)
    assert (found.blocks, found.named, found.left_out, found.warnings) == (False, {}, {}, ())
    assert rows_of(found).tolist() == [
        [0, 1, 2, 3, 4, 5],
        [6, 7, 8, 9, -1, -1],
        [10, 11, 12, 13, 14, -1],
    ]
    record = found.record
    np.testing.assert_array_equal(record.mask, rows_of(found) >= 0)
    np.testing.assert_array_equal(record.fresh, record.mask)
    conditions = {"time_s", "vehicle_speed_mps", "slip_velocity_mps", "wear", "run_order"}
    assert {*record.conditions} == conditions
    np.testing.assert_array_equal(record.conditions["wear"][1], [36, 49, 64, 81, 81, 81])
    np.testing.assert_allclose(record.slip[2, 4:], table["slip_ratio"].iloc[14], rtol=1e-15)
    np.testing.assert_allclose(
        record.conditions["slip_velocity_mps"], 10 * np.asarray(record.slip), rtol=1e-15
    )
    for values in (record.slip, record.adhesion, *record.conditions.values()):
        assert values.shape == (3, 6)
        assert values.dtype == np.float64
        assert np.isfinite(values).all()


def test_the_rows_of_a_run_may_lie_apart(tmp_path):
    table = good(12).assign(run=[7, 3] * 6, wear=np.arange(12.0))
    found = to_runs(read_all([written(tmp_path, table)]))
    assert found.names == ("7", "3")
    assert rows_of(found).tolist() == [[0, 2, 4, 6, 8, 10], [1, 3, 5, 7, 9, 11]]
    np.testing.assert_array_equal(found.record.conditions["wear"], rows_of(found))


def test_gaps_in_time_part_runs(tmp_path):
    # Steps of 0.1 s, and two rows of one stamp; 1.0 s is no gap, 1.1 s is one.
    time = np.cumsum([0, 0.1, 0.1, 0, 0.1, 1.0, 0.1, 1.1, 0.1, 0.1, 50, 0.1])
    found = to_runs(read_all([written(tmp_path, good().assign(time_s=time))]))
    assert found.names == ("1", "2", "3")
    assert [(row >= 0).sum() for row in rows_of(found)] == [7, 3, 2]
    assert len(found.warnings) == 1
    assert found.warnings[0].startswith("In time_s 1 row has the time of the row before")
    # With steps of 1 s a gap is longer than 10 s.
    slow = np.cumsum([0, 1, 1, 1, 9, 1, 1, 11, 1, 1, 1, 1])
    found = to_runs(read_all([written(tmp_path, good().assign(time_s=slow))]))
    assert [(row >= 0).sum() for row in rows_of(found)] == [7, 5]


def test_the_column_run_goes_before_gaps(tmp_path):
    table = campaign((6, 6)).assign(time_s=np.tile([0, 1, 2, 100, 100, 100], 2))
    found = to_runs(read_all([written(tmp_path, table)]))
    assert found.names == ("a", "b")
    assert "4 rows have the time of the row before" in found.warnings[0]


@pytest.mark.parametrize(
    ("points", "blocks", "shortest", "longest"),
    [(10, 5, 2, 2), (33, 16, 2, 3), (40, 16, 2, 3), (163, 16, 10, 11), (205, 20, 10, 11),
     (5000, 50, 100, 100)],
)  # fmt: skip
def test_one_run_is_cut_into_blocks(tmp_path, points, blocks, shortest, longest):
    for table in (good(points), good(points).assign(run="only", time_s=np.arange(points))):
        whole = to_runs(read_all([written(tmp_path, table)]))
        assert (whole.blocks, len(whole.names), whole.warnings) == (False, 1, ())
        found = in_blocks(whole)
        length = (rows_of(found) >= 0).sum(axis=1)
        assert found.blocks
        assert (len(found.names), length.min(), length.max()) == (blocks, shortest, longest)
        assert rows_of(found)[rows_of(found) >= 0].tolist() == list(range(points))
        (warning,) = found.warnings
        assert f"{blocks} contiguous blocks" in warning
        assert "independent" in warning
        assert "act in time" in warning
        assert in_blocks(found) is found
        # Test data are judged by blocks only where blocks were fitted.
        assert cut_alike(found, whole).names == found.names
        assert cut_alike(to_runs(read_all([written(tmp_path, campaign())])), whole) is whole


def test_the_order_of_the_runs_is_that_of_their_names_if_these_are_numbers(tmp_path):
    """A name in words does not say whether a run was before another one: test runs come last."""

    def named(*names):
        table = campaign([6] * len(names))
        return to_runs(read_all([written(tmp_path, table.assign(run=np.repeat(names, 6)))]))

    train, test = named("3", "1", "2"), named("7", "5")
    assert named("x", "b", "a").order.tolist() == [0, 1, 2]
    assert train.order.tolist() == [3, 1, 2]
    assert matching(train, test).order.tolist() == [7, 5]
    assert matching(train, named("7", "5 b")).order.tolist() == [3, 4]
    assert matching(named("x", "b", "a"), test).order.tolist() == [3, 4]
    held = np.arange(12).reshape(2, 6)
    assert test.conditions_at(held)["run_order"].tolist() == [[7] * 6, [5] * 6]


def test_blocks_in_time_are_led_in_by_the_rows_before_them(tmp_path):
    table = good(400).assign(time_s=0.1 * np.arange(400))
    found = in_blocks(to_runs(read_all([written(tmp_path, table)])))
    time, counted = np.asarray(found.record.conditions["time_s"]), rows_of(found) >= 0
    assert (counted == np.asarray(found.record.mask)).all()
    lead = time.shape[1] // 2
    # Of the first block there is nothing before its first row; the others go on without a gap.
    assert (time[0, :lead] == 0.0).all()
    for block in range(1, len(found.names)):
        rows = np.rint(time[block] / 0.1).astype(int)
        whole = rows[: lead + counted[block].sum()]
        assert (np.diff(whole) == 1)[whole[:-1] > 0].all()
        assert whole[lead] == rows_of(found)[block, lead] == rows_of(found)[block - 1].max() + 1
        assert not counted[block, :lead].any()
    # Without a time the order of the rows says nothing of what came before.
    bare = in_blocks(to_runs(read_all([written(tmp_path, good(400))])))
    assert (rows_of(bare)[:, 0] >= 0).all()


def test_several_files_never_share_a_run(tmp_path):
    first = written(tmp_path, campaign((6, 4)), "x.csv")
    second = written(tmp_path, campaign((3, 5, 4))[3:], "y.csv")
    found = to_runs(read_all([first, second]))
    assert found.names == ("a", f"{first}:b", f"{second}:b", "c")
    assert rows_of(found)[:, 0].tolist() == [0, 6, 10, 15]
    assert rows_of(found).max() == 18
    np.testing.assert_allclose(
        found.record.slip[2, :5], campaign((3, 5, 4))["slip_ratio"][3:8], rtol=1e-15
    )
    # Without a column run each file is a run at least.
    bare = [written(tmp_path, good(8).assign(wear=1.0), name) for name in ("x.csv", "y.csv")]
    found = to_runs(read_all(bare))
    assert found.names == tuple(f"{path}:1" for path in bare)
    assert not found.blocks


def test_a_column_that_one_file_lacks_is_left_out(tmp_path):
    first = written(tmp_path, campaign().assign(axle=1), "x.csv")
    found = to_runs(read_all([first, written(tmp_path, campaign(), "y.csv")]))
    assert (found.left_out, found.named, found.covariates) == ({}, {}, ())
    assert found.warnings == ("The column axle is left out: not every file has it.",)


def test_numbers_of_one_file_are_labels_where_another_has_labels(tmp_path):
    first = written(tmp_path, campaign().assign(wear=1.0), "x.csv")
    second = written(tmp_path, campaign().assign(wear="new"), "y.csv")
    found = to_runs(read_all([first, second]))
    assert found.named == {"wear": ("1", "new")}
    assert found.whole.conditions["wear"].tolist() == [0.0] * 15 + [1.0] * 15


def test_axle_and_mode_become_numbers(tmp_path):
    modes = ["Traction", "braking", "COASTING"] * 5
    table = campaign().assign(axle=[10, 9, 1] * 5, mode=modes)
    found = to_runs(read_all([written(tmp_path, table)]))
    assert found.named == {"axle": ("1", "9", "10")}
    np.testing.assert_array_equal(found.record.conditions["axle"][0], [2, 1, 0, 2, 1, 0])
    np.testing.assert_array_equal(found.record.conditions["mode"][0], [1, -1, 0, 1, -1, 0])
    assert found.covariates == ()
    # Whole numbers that a parquet file holds as floats are the same labels.
    table.assign(axle=table["axle"].astype(float)).to_parquet(tmp_path / "a.parquet")
    assert to_runs(read_all([tmp_path / "a.parquet"])).named == found.named


def test_rows_without_a_label_are_left_out(tmp_path):
    table = campaign().assign(mode="traction", axle="1").astype(object)
    table.loc[4, "run"] = None
    table.loc[5, "axle"] = np.nan
    table.to_parquet(tmp_path / "b.parquet")
    for path, shift in ((written(tmp_path, table), 2), (tmp_path / "b.parquet", 1)):
        found = to_runs(read_all([path]))
        assert found.whole.slip.size == len(table) - 2
        said = " ".join(found.warnings)
        assert "Not used is 1 row of 15 (6.67 %), in which the run is not named" in said
        assert "Not used is 1 row of 14 (7.14 %), in which the axle is not named" in said
        assert not {4 + shift, 5 + shift} & {*read_measured(path).table.index}


def test_labels_that_are_no_modes_are_labels_of_their_own(tmp_path):
    table = campaign().assign(mode=["auto", "manual", "auto"] * 5)
    found = to_runs(read_all([written(tmp_path, table)]))
    assert found.named == {"mode (as it is)": ("auto", "manual")}
    assert any("keeps its labels, which are none of traction" in one for one in found.warnings)


def test_braking_is_ordinary_and_one_slip_value_is_allowed(tmp_path):
    braking = campaign().assign(slip_ratio=-good(15)["slip_ratio"], adhesion=-good(15)["adhesion"])
    assert (to_runs(read_all([written(tmp_path, braking)])).record.slip < 0).all()
    one = campaign().assign(slip_ratio=0.02)
    assert to_runs(read_all([written(tmp_path, one)])).warnings == ()
    opposite = campaign().assign(adhesion=-good(15)["adhesion"])
    assert "mostly of the other sign than slip_ratio" in refused(written(tmp_path, opposite))
    nothing = campaign().assign(adhesion=0.0)
    assert "column adhesion is 0 in every row" in refused(written(tmp_path, nothing))


def test_noise_of_the_slip_of_a_slow_train_is_no_other_sign(tmp_path):
    """Of a train that starts and slips twice; its two speeds have noise of .02 m/s."""
    draw = np.random.default_rng(3)
    time = 0.1 * np.arange(3000)
    speed = np.minimum(0.6 + 0.2 * np.maximum(time - 100, 0), 20.0)
    slip = 0.002 + 0.15 * ((time % 100 > 60) & (time % 100 < 62) & (time > 100))
    wheel, train = (one + 0.02 * draw.normal(size=time.size) for one in (speed * (1 + slip), speed))
    adhesion = 30 * slip / (1 + 40 * slip + 300 * slip**2) + 0.005 * draw.normal(size=time.size)
    table = pd.DataFrame(
        {"time_s": time, "wheel_speed_mps": wheel, "vehicle_speed_mps": train, "adhesion": adhesion}
    )
    measured = read_all([written(tmp_path, table)])[0]
    noisy = measured.table[
        (measured.table["slip_ratio"] < -0.03) & (measured.table["adhesion"] > 0)
    ]
    assert len(noisy) > 100
    check_curve(measured)


def test_adhesion_without_a_sign_is_refused_where_a_third_of_the_rows_brake(tmp_path):
    """But not noise of the slip about 0, where the wheel coasts for most of the time."""
    slip = np.linspace(0.001, 0.05, 90) * np.where(np.arange(90) % 3, 1, -1)
    table = pd.DataFrame({"slip_ratio": slip, "adhesion": 0.3 * np.abs(np.tanh(slip / 0.01))})
    said = refused(written(tmp_path, table))
    assert "other sign than slip_ratio where that is negative (both are positive in trac" in said
    slip = np.concatenate([np.linspace(0, 0.05, 30), 0.003 * np.sin(np.arange(60))])
    table = pd.DataFrame(
        {"slip_ratio": slip, "adhesion": 0.01 + 0.3 * np.tanh(slip.clip(0) / 0.01)}
    )
    to_runs(read_all([written(tmp_path, table)]))


def test_a_radius_that_turns_the_sign_of_the_slip_is_told(tmp_path):
    """A car that brakes and drives a little with wheels that are 2 % smaller than said."""
    time = np.arange(400)
    adhesion = 0.2 * np.clip(np.sin(time / 30), 0, 1) * (1 + 0.1 * np.sin(time))
    slip = adhesion / 30 - 0.02
    said = refused(written(tmp_path, pd.DataFrame({"slip_ratio": slip, "adhesion": adhesion})))
    assert "the slip is usually -0.02, as where the radius of the wheel is 2 % off" in said
    # Of a sign that is simply exchanged nothing of that is said.
    exchanged = pd.DataFrame({"slip_ratio": -adhesion / 30, "adhesion": adhesion})
    assert "correct the wheel speed" not in refused(written(tmp_path, exchanged))


def test_slip_velocity_without_a_speed_is_the_slip(tmp_path):
    table = campaign().drop(columns="vehicle_speed_mps")
    path = written(tmp_path, table.rename(columns={"slip_ratio": "slip_velocity_mps"}), "v.csv")
    found = to_runs(read_all([path]))
    assert found.slip == "slip_velocity_mps"
    assert (found.record.conditions["vehicle_speed_mps"] == 1).all()
    np.testing.assert_array_equal(found.record.conditions["slip_velocity_mps"], found.record.slip)
    assert found.warnings[0].startswith("There is no vehicle_speed_mps")
    said = refused(path, written(tmp_path, campaign(), "r.csv"))
    assert "v.csv has slip_velocity_mps without vehicle_speed_mps where" in said


def test_a_column_that_repeats_another_is_left_out(tmp_path):
    table = campaign().assign(
        copy_of_load=np.linspace(9e4, 1e5, 15), leak=lambda table: table["adhesion"]
    )
    table["normal_load_N"] = table["copy_of_load"]
    table = table.assign(nothing=0.0, nothing_else=0.0, sanding=0.0)
    found = to_runs(read_all([written(tmp_path, table)]))
    assert found.same == {"copy_of_load": "normal_load_N", "leak": "adhesion"}
    assert found.covariates == ("nothing", "nothing_else")
    assert "sanding" in found.record.conditions
    assert "The column leak is left out: it is the same as adhesion." in found.warnings


def test_what_a_curve_needs_is_kept_though_it_repeats_another(tmp_path):
    table = campaign((15, 15)).assign(time_s=lambda table: table["time_s"] + 1.0)
    table["vehicle_speed_mps"] = table["time_s"]
    found = to_runs(read_all([written(tmp_path, table)]))
    assert found.same == {}
    assert {"time_s", "vehicle_speed_mps"} <= {*found.record.conditions}


def test_text_that_is_none_of_labels_is_left_out_and_unknown_columns_are_covariates(tmp_path):
    mixed = [1.0, "two", *range(13)]
    table = campaign().assign(note=mixed, pressure_K=290.0, slip_angle_deg=1.0)
    found = to_runs(read_all([written(tmp_path, table)]))
    why = "6.67 % of its rows have no value, and at most 5 % of all rows may"
    assert found.left_out == {"note": why}
    assert found.covariates == ("pressure_K",)
    text, left_out = found.warnings
    assert text.startswith("1 value is text and not used: row 3 of column note has the text 'two'")
    assert left_out == f"The column note is left out: {why}."
    # Forty different texts are labels, one more is none.
    many = {"note": "it has 41 different texts, and labels are at most 40"}
    for count, left_out in ((40, {}), (41, many)):
        table = good(82).assign(note=[f"no {row % count}" for row in range(82)])
        found = to_runs(read_all([written(tmp_path, table)]))
        assert found.left_out == left_out
        assert len(found.named.get("note", ())) == (0 if left_out else count)


def test_text_becomes_numbers_from_zero_in_the_order_of_the_names(tmp_path):
    """Numbers by their value, then the names; whole decimals alone count as numbers."""
    table = campaign().assign(
        rail=["wet", "dry", "leaves"] * 5, team=["B", "10", "9", "A", "9"] * 3
    )
    table.to_parquet(tmp_path / "set.parquet")
    for path in (written(tmp_path, table.drop(columns="team")), tmp_path / "set.parquet"):
        found = to_runs(read_all([path]))
        assert found.named["rail"] == ("dry", "leaves", "wet")
        assert found.left_out == {}
        assert "rail" in found.covariates
        codes = np.asarray(found.record.conditions["rail"])
        np.testing.assert_array_equal(codes[0], [2, 0, 1, 2, 0, 1])
        np.testing.assert_array_equal(codes[2, :5], [0, 1, 2, 0, 1])
    assert found.named["team"] == ("9", "10", "A", "B")
    np.testing.assert_array_equal(found.record.conditions["team"][0], [3, 1, 0, 2, 0, 3])


def test_the_force_is_no_condition(tmp_path):
    table = campaign().assign(normal_load_N=1e5)
    table["tangential_force_N"] = table["adhesion"] * 1e5
    found = to_runs(read_all([written(tmp_path, table.drop(columns="adhesion"))]))
    assert "tangential_force_N" not in found.record.conditions
    np.testing.assert_allclose(found.record.adhesion[0], good(15)["adhesion"][:6], rtol=1e-14)


def test_a_saved_index_is_no_covariate(tmp_path):
    table = campaign()
    table.set_index(pd.Index(range(5, 20))).to_parquet(tmp_path / "a.parquet")
    once = written(tmp_path, table.assign(**{"Unnamed: 0": range(15)}))
    for path in (tmp_path / "a.parquet", once):
        assert to_runs(read_all([path])).covariates == ()


def test_runs_of_one_point_are_kept(tmp_path):
    found = to_runs(read_all([written(tmp_path, campaign((9, 1, 1)))]))
    assert rows_of(found)[:, :2].tolist() == [[0, 1], [9, -1], [10, -1]]
    assert found.warnings[0].startswith("2 of 3 runs have one point only")


def test_the_faults_of_all_files_are_told_at_once(tmp_path):
    first = written(tmp_path, campaign().assign(slip_ratio=9.0, adhesion="wet"), "x.csv")
    second = written(tmp_path, campaign().drop(columns="adhesion"), "y.csv")
    said = refused(first, second, tmp_path / "z.csv", first)
    assert "x.csv cannot be used: row 2 of column adhesion has the text 'wet'" in said
    assert "y.csv cannot be used: the column adhesion (or" in said
    assert "z.csv does not exist" in said
    assert "x.csv is given twice" in said


def test_ten_rows_are_needed_in_all(tmp_path):
    paths = [written(tmp_path, campaign((n,)), f"{n}.csv") for n in (4, 5, 6)]
    assert "there are 9 points (at least 10 rows" in refused(*paths[:2])
    assert to_runs(read_all([paths[0], paths[2]])).record.slip.shape == (2, 6)
    empty = written(tmp_path, campaign()[:0], "empty.csv")
    assert "empty.csv cannot be used: there is a header but no point" in refused(paths[0], empty)


def test_runs_of_one_row_each_are_no_runs(tmp_path):
    path = written(tmp_path, campaign((1,) * 12))
    assert "each of the 12 runs has one row (a run is a sweep of several" in refused(path)


def test_time_does_not_run_back_all_the_time(tmp_path):
    table = campaign().assign(time_s=[5.0, 3.0, 8.0] * 5)
    said = refused(written(tmp_path, table.drop(columns="run")))
    assert "time_s decreases all the time, first in row 3 (sort each run" in said


def test_broken_files_are_refused(tmp_path):
    text = campaign((31,)).to_csv(index=False)
    (tmp_path / "broken.csv.gz").write_bytes(gzip.compress(text.encode())[:-20])
    assert "not a whole gzip file" in refused(tmp_path / "broken.csv.gz")
    (tmp_path / "broken.parquet").write_bytes(b"PAR1")
    assert "not a whole parquet file" in refused(tmp_path / "broken.parquet")


def test_too_many_runs_are_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(runs, "MOST_RUNS", 3)
    said = refused(written(tmp_path, campaign((5, 5, 5, 5))))
    assert "there are 4 runs (at most 3 are taken" in said


def test_the_test_set_is_seen_as_the_training_set_is(tmp_path):
    train = campaign().assign(axle=[1, 2, 4] * 5, wear=np.arange(15.0), load=np.arange(15.0) ** 2)
    # In the test set two columns are the same, one is new, and so is an axle.
    test = campaign((5, 5)).assign(axle=[4, 7] * 5, wear=np.arange(10.0), new=1.0)
    test["load"] = test["wear"]
    runs_of = [to_runs(read_all([written(tmp_path, table)])) for table in (train, test)]
    seen = matching(*runs_of)
    assert {*seen.record.conditions} == {*runs_of[0].record.conditions}
    assert seen.covariates == runs_of[0].covariates
    assert seen.named == {"axle": ("1", "2", "4")}
    np.testing.assert_array_equal(seen.record.conditions["load"], rows_of(runs_of[1]))
    np.testing.assert_array_equal(seen.record.conditions["axle"][0], [2, -1, 2, -1, 2])
    assert seen.warnings[-1].startswith("The training data have no axle 7:")
    with pytest.raises(InputError, match=r"^The test data lack wear, load and axle, which"):
        matching(runs_of[0], to_runs(read_all([written(tmp_path, campaign())])))


def test_a_column_of_the_test_set_that_is_left_out_is_not_said_to_be_absent(tmp_path):
    train = campaign().assign(relative_humidity_pct=np.arange(15.0), wear=1.0)
    holed = train["relative_humidity_pct"].where(train.index % 4 > 0)
    test = train.assign(relative_humidity_pct=holed).drop(columns=["wear", "time_s"])
    runs_of = [to_runs(read_all([written(tmp_path, table)])) for table in (train, test)]
    with pytest.raises(InputError) as error:
        matching(*runs_of)
    assert str(error.value) == (
        "The test data lack time_s and wear, which the training data have; add what is missing, or "
        "leave it out of the training data too. Left out of the test data: relative_humidity_pct "
        "(26.7 % of its rows have no value, and at most 5 % of all rows may), which the training "
        "data have; mend it there, or leave it out of the training data too."
    )


def test_labels_of_a_test_set_have_the_codes_of_the_training_set(tmp_path):
    """Those that the training set lacks are -1, and told; numbers are labels of the same text."""
    train = campaign().assign(rail=["wet", "dry", "leaves"] * 5, team=["x", "2", "1"] * 5)
    test = campaign((5, 5)).assign(rail=["icy", "wet", "dry", "wet", "icy"] * 2, team=[2, 3] * 5)
    runs_of = [to_runs(read_all([written(tmp_path, table)])) for table in (train, test)]
    # In the test set alone the order of the names is another one.
    assert runs_of[1].named == {"rail": ("dry", "icy", "wet")}
    seen = matching(*runs_of)
    assert seen.named == runs_of[0].named
    np.testing.assert_array_equal(seen.record.conditions["rail"][0], [-1, 2, 0, 2, -1])
    np.testing.assert_array_equal(seen.record.conditions["team"][0], [1, -1, 1, -1, 1])
    rail, team = seen.warnings[-2:]
    assert rail.startswith("The training data have no rail icy: what was found of the others is")
    assert team.startswith("The training data have no team 3:")
    # Of itself every label is known.
    again = matching(runs_of[0], runs_of[0])
    np.testing.assert_array_equal(
        again.record.conditions["rail"], runs_of[0].record.conditions["rail"]
    )
    assert again.warnings == runs_of[0].warnings


def test_the_test_set_has_the_same_slip(tmp_path):
    velocity = campaign().drop(columns="vehicle_speed_mps")
    velocity = velocity.rename(columns={"slip_ratio": "slip_velocity_mps"})
    by_velocity = to_runs(read_all([written(tmp_path, velocity)]))
    by_ratio = to_runs(read_all([written(tmp_path, campaign())]))
    seen = matching(by_velocity, by_ratio)
    np.testing.assert_allclose(seen.record.slip, 10 * np.asarray(by_ratio.record.slip), rtol=1e-15)
    assert (seen.record.conditions["vehicle_speed_mps"] == 1).all()
    with pytest.raises(InputError, match=r"^The test data lack slip_ratio"):
        matching(by_ratio, by_velocity)


def test_the_roller_rig_ships_and_has_one_slip_value():
    found = in_blocks(to_runs(read_all([SHIPPED["roller-rig"].path])))
    assert rows_of(found)[rows_of(found) >= 0].tolist() == list(range(40))
    assert len(found.names) == 16
    assert (found.record.slip == 0.02).all()
    assert {"angle_of_attack_deg", "lateral_creepage"} <= {*found.record.conditions}
    np.testing.assert_allclose(found.record.adhesion[0, 0], 3522.71 / 9600, rtol=1e-15)
    assert "Hosseini" in SHIPPED["roller-rig"].citation


@pytest.mark.skipif(not PRACTICE.is_dir(), reason="the practice sets are not here")
def test_a_practice_set_is_read_whole():
    train, test = (
        to_runs(read_all([PRACTICE / f"practice_12_{part}.csv.gz"])) for part in ("train", "test")
    )
    assert train.record.slip.shape == (28, 200)
    assert test.record.slip.shape == (12, 200)
    assert train.covariates == ("rail_age_days",)
    assert train.warnings == test.warnings == ()
    assert matching(train, test).names == test.names


def test_the_order_of_runs_is_that_of_their_numbers(tmp_path):
    table = good(12).assign(run=[7, 3] * 6)
    order = np.asarray(to_runs(read_all([written(tmp_path, table)])).record.conditions["run_order"])
    np.testing.assert_array_equal(order, np.repeat([[7.0], [3.0]], 6, axis=1))
    named = good(12).assign(run=["late", "early"] * 6)
    order = np.asarray(to_runs(read_all([written(tmp_path, named)])).record.conditions["run_order"])
    np.testing.assert_array_equal(order, np.repeat([[0.0], [1.0]], 6, axis=1))


def test_labels_of_several_files_are_those_of_all(tmp_path):
    """Each file holds its labels by numbers of its own: 1 of the second is not 1 of the first."""
    tables = [good(12).assign(axle=["b", "a"] * 6), good(12).assign(axle=["c", "b"] * 6)]
    paths = [tmp_path / f"{number}.csv" for number in range(2)]
    for table, path in zip(tables, paths, strict=True):
        table.to_csv(path, index=False)
    found = to_runs(read_all(paths))
    assert found.named == {"axle": ("a", "b", "c")}
    expected = [1.0, 0.0] * 6 + [2.0, 1.0] * 6
    np.testing.assert_array_equal(found.whole.conditions["axle"], expected)


@pytest.mark.parametrize("seed", range(4))
def test_steps_in_time_are_those_within_each_run(seed):
    draw = np.random.default_rng(seed)
    run = draw.integers(0, 3, 40) if seed else np.sort(draw.integers(0, 3, 40))
    time = draw.normal(size=40)
    expected = np.full(40, np.nan)
    for row in range(40):
        before = np.flatnonzero(run[:row] == run[row])
        if before.size:
            expected[row] = time[row] - time[before[-1]]
    np.testing.assert_array_equal(steps_in_runs(time, run), expected)


def test_many_columns_are_read_without_a_warning(tmp_path):
    more = {f"c{number}": np.arange(12.0) ** (number / 40) for number in range(120)}
    columns = {**good(12), "vehicle_speed_mps": 10.0, "run": [7, 3] * 6, **more}
    table = pd.DataFrame(columns)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = to_runs(read_all([written(tmp_path, table)]))
    assert len(found.covariates) == 120


def test_the_time_since_a_run_began_is_a_column_where_runs_are_in_time(tmp_path):
    table = good(12).assign(run=[3] * 5 + [7] * 7, time_s=10 + 0.5 * np.arange(12.0) ** 1.2)
    found = to_runs(read_all([written(tmp_path, table)]))
    time = table["time_s"].to_numpy()
    since = with_run_time(found).whole.conditions["run_time_s"]
    np.testing.assert_array_equal(since, time - np.repeat([time[0], time[5]], [5, 7]))
    assert "run_time_s" not in found.whole.conditions
    # A measured column of that name or of those numbers stands, and so does one without a time.
    own = to_runs(read_all([written(tmp_path, table.assign(run_time_s=np.arange(12.0)))]))
    assert with_run_time(own).whole.conditions["run_time_s"].tolist() == [*range(12)]
    same = to_runs(read_all([written(tmp_path, table.assign(seconds_on=since))]))
    assert with_run_time(same) is same
    steady = to_runs(read_all([written(tmp_path, table.drop(columns="time_s"))]))
    assert with_run_time(steady) is steady


def test_blocks_of_one_run_have_no_time_since_they_began(tmp_path):
    table = good(40).assign(time_s=np.arange(40.0))
    blocks = in_blocks(to_runs(read_all([written(tmp_path, table)])))
    assert "time_s" in blocks.whole.conditions
    assert with_run_time(blocks) is blocks
