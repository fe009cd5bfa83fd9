"""Which columns tell the rows of a measurement apart, where nobody names one."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

import adhesion_jax as aj


def table(wet_level):
    """Twelve sweeps, of which the wet ones have so many times the adhesion of the dry ones."""
    draw = np.random.default_rng(4)
    slip = np.tile(np.linspace(0.002, 0.12, 40), 12)
    run = np.repeat(np.arange(12), 40)
    level = np.where(run % 2 == 0, 1.0, wet_level)
    adhesion = level * (0.3 * (1 - np.exp(-90 * slip)) - 0.3 * slip)
    return pd.DataFrame(
        {
            "slip_ratio": slip,
            "adhesion": adhesion + 0.004 * draw.standard_normal(slip.size),
            "run": run,
            "rail": np.where(run % 2 == 0, "dry", "wet"),
            "driver": np.where(run % 3 == 0, 1, 2),
        }
    )


@pytest.fixture
def found():
    return lambda level: aj.identify(table(level), "burckhardt", by="auto")


@pytest.mark.long
def test_the_column_that_predicts_is_found_among_labels_and_levels(found):
    apart = found(0.8)
    assert apart.comparison.by == "rail"
    assert {*apart.groups} == {"dry", "wet"}
    assert apart.groups["wet"].mu_max.value == pytest.approx(
        0.8 * apart.groups["dry"].mu_max.value, rel=0.02
    )


def test_where_no_column_predicts_it_is_said(found):
    alike = found(1.0)
    assert alike.comparison is None
    said = "are not predicted by the groups of driver or rail, the only columns of a few labels"
    assert said in " ".join(alike.verdict.split())
    alone = aj.identify(table(1.0)[["slip_ratio", "adhesion"]], "burckhardt", by="auto")
    assert "There is no column of a few labels" in " ".join(alone.verdict.split())


@pytest.mark.parametrize("name", ["axle", "mode"])
def test_labels_that_are_known_are_looked_at_too(name):
    labels = {"axle": [1, 2], "mode": ["traction", "braking"]}[name]
    rows = table(0.8).drop(columns="rail")
    rows[name] = np.where(rows["run"] % 2 == 0, *labels)
    assert aj.identify(rows, "burckhardt", by="auto").comparison.by == name


@pytest.mark.long
def test_rails_that_are_mixed_are_told_though_nobody_asked():
    unasked = aj.identify(table(0.8), "burckhardt")
    said = "The rows are of different rails: their level differs by rail"
    assert " ".join(unasked.verdict.split()).startswith(f"Warning: {said}")
    for printed in (repr(unasked), unasked.report()):  # before any number
        first = " ".join(printed.split("mu_max ")[0].split())
        assert first.startswith(said)
        assert first.endswith('the peak of each is told by --by "rail".')
    levels = unasked.mixed.table.set_index("rail")["mu_max"]
    assert levels["wet"] / levels["dry"] == pytest.approx(0.8, rel=0.02)
    alike = " ".join(aj.identify(table(1.0), "burckhardt").verdict.split())
    assert "different rails" not in alike
    asked = aj.identify(table(0.8), "burckhardt", by="rail")
    assert asked.mixed is None
    first = " ".join(repr(asked).split("\n\n")[0].split())
    dry, wet = (asked.groups[rail].mu_max for rail in ("dry", "wet"))
    assert first.startswith(f"Adhesion differs by rail: largest adhesion dry: {dry.value:.4f} [")
    assert f"; wet: {wet.value:.4f} [" in first


@pytest.mark.thorough
def test_columns_that_do_nothing_are_rarely_told_to_be_different_rails():
    """Of ten labels of twelve runs, drawn at random, at most one set in twenty tells one."""
    told = 0
    for seed in range(40):
        draw = np.random.default_rng(seed)
        rows = table(1.0).drop(columns=["rail", "driver"])
        rows["adhesion"] *= (1 + 0.02 * draw.normal(size=12))[rows["run"]]
        for number in range(10):
            rows[f"label_{number}"] = np.array(["a", "b"])[draw.integers(0, 2, 12)][rows["run"]]
        told += aj.identify(rows, "burckhardt").mixed is not None
    assert told <= binom.isf(1e-3, 40, 0.05)


@pytest.mark.long
def test_events_of_axles_side_by_side_are_runs_of_one_answer():
    draw = np.random.default_rng(1)
    time = 0.05 * np.arange(3200)
    slip = 0.002 + 0.1 * np.clip(np.sin(2 * np.pi * time / 40), 0, None) ** 40
    columns = {"time_s": time, "v [m/s]": np.full(time.size, 15.0)}
    for axle in (1, 2):
        level = 0.3 * (1 - np.exp(-90 * slip)) - 0.3 * slip
        columns[f"v_Rad{axle} [m/s]"] = 15 * (1 + slip) + 0.003 * draw.standard_normal(time.size)
        columns[f"Z_Achse{axle} [kN]"] = 100 * level + 0.4 * draw.standard_normal(time.size)
        columns[f"Q_Achse{axle} [kN]"] = np.full(time.size, 100.0)
    log = pd.DataFrame(columns)
    found = aj.identify(log, "burckhardt", {"speed": "v [m/s]"}, axles=True, events=True)
    assert found.comparison.by == "axle"
    assert len(found.runs) == 2 * 4
    # .3 (1 - exp(-90 s)) - .3 s is largest where exp(-90 s) = 1 / 90.
    assert found.mu_max == pytest.approx(0.3 * (1 - 1 / 90) - 0.3 * np.log(90) / 90, rel=0.02)


def test_a_group_of_few_rows_is_named_and_a_group_of_one_row_compares_nothing():
    """Of 450 rows the last 10 are of a rail of half the adhesion."""
    rows = table(1.0).drop(columns=["run", "driver"]).iloc[:-30]
    rows["rail"] = np.where(np.arange(len(rows)) < len(rows) - 10, "dry", "wet")
    rows.loc[rows["rail"] == "wet", "adhesion"] *= 0.5
    found = aj.identify(rows, "burckhardt", by="rail")
    why = "fewer than 30 rows: not fitted by itself"
    assert [*found.comparison.table["own_status"]] == ["", why]
    for said in (found.report(), found.verdict):
        assert f"; wet: no answer ({why})." in " ".join(said.split())
    rows["rail"] = [f"rail {number}" for number in range(len(rows))]
    with pytest.raises(aj.InputError, match="a rail of its own, so that no scatter"):
        aj.identify(rows, "burckhardt", by="rail")
    # Further labels than a search takes, and compared all the same.
    rows["rail"] = [f"rail {number // 4}" for number in range(len(rows))]
    assert "left out" not in aj.identify(rows, "burckhardt", by="rail").verdict


@pytest.mark.parametrize("column", ["Achse", "Temperatur [°C]"])
def test_groups_go_by_the_name_that_the_user_has_for_a_column_that_is_known(column):
    rows = table(0.8)
    rows[column] = np.where(rows.pop("rail") == "dry", 1, 2)
    levels = aj.identify(rows, "burckhardt", by=column).comparison.table["mu_max"]
    assert levels[1] / levels[0] == pytest.approx(0.8, rel=0.02)


@pytest.mark.parametrize("slip_noise", [-0.1, np.nan, np.inf])
def test_a_noise_of_the_slip_that_is_none_is_refused(slip_noise):
    with pytest.raises(aj.InputError, match="slip_noise is a standard deviation, 0 for an exact"):
        aj.identify(table(1.0), "kiencke", slip_noise=slip_noise)


@pytest.mark.long
@pytest.mark.parametrize("name", ["side", "axle"])
def test_the_answer_does_not_depend_on_whether_rows_of_groups_stand_in_turn(name):
    """Two signals of one truth with noise of an AR(1) of .9, each independent of the other."""
    draw = np.random.default_rng(10)
    signals = []
    for label in {"side": "LR", "axle": (1, 2)}[name]:
        noise = lfilter([0.44], [1, -0.9], draw.normal(0, 0.02, 250))[50:]
        slip = 0.05 * (1 - np.cos(2 * np.pi * np.arange(200) / 67)) + draw.normal(0, 0.001, 200)
        adhesion = 0.6 * (slip / 0.03) / (1 + (slip / 0.03) ** 2) + noise
        columns = {"time_s": 0.05 * np.arange(200), "slip_ratio": slip, "adhesion": adhesion}
        signals.append(pd.DataFrame({**columns, name: label}))
    below = pd.concat(signals, ignore_index=True)
    in_turn = below.sort_values("time_s", kind="stable").reset_index(drop=True)
    in_turn.iloc[2:4] = in_turn.iloc[[3, 2]].to_numpy()  # as a sort that is not stable leaves it
    one, other = (aj.identify(rows, "kiencke", by=name).comparison for rows in (below, in_turn))
    assert not one.changed
    # Of sides there is one fit to one run or to two, with slightly other noise of the slip.
    assert (other.p, other.p_shape) == pytest.approx((one.p, one.p_shape), rel=0.05)
    by_itself = ["mu_max", "own_mu_max", "own_mu_max_lo", "own_mu_max_hi", "own_slip_opt"]
    np.testing.assert_allclose(other.table[by_itself], one.table[by_itself], rtol=0.01)
