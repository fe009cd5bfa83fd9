"""Measurements on which an identification has failed are answered rightly, or not at all.

An answer is right where its intervals hold the truth; where the points tell no peak, the words say
which fault forbids one.
"""

import sys
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fault_forms import DRY, FAULTS
from stranger_runs import CELLS, draw

import adhesion_jax as aj
from adhesion_jax.command_line import identify as identify_command
from adhesion_jax.command_line.command import run
from adhesion_jax.errors import InputError
from adhesion_jax.measured.answer import answered, dependence, log_densities

#: Three curves are enough for what is tested here, and half as long to fit as all.
CURVES = ("kiencke", "burckhardt", "exponential")

#: Forms whose veto is by the points themselves, whatever curve is fitted to them.
ANY_CURVE = (
    "stuck_sensor",
    "independent_of_slip",
    "swapped_columns",
    "shifted_signals",
    "late_in_few_rows",
    "one_sweep_slow_rail",
)

FOLDER = Path(__file__).parents[3] / "shared/faults"

#: Peak of .42 (1 - exp(-s/.006)) (.75 + .25 exp(-s/.08)), on a grid.
LAB = (0.3858, 0.0254)

ROCK = {"adhesion": "friction coefficient", "slip_velocity": "slip velocity"}


@cache
def of_form(name, by=None):
    table, _ = FAULTS[name](0)
    return aj.identify(table, "kiencke" if name in ANY_CURVE else CURVES, by=by)


def path_of(name):
    path = FOLDER / name
    if not path.exists():
        pytest.skip(f"{path} is absent")
    return path


@cache
def of_file(name, by=None):
    columns = ROCK if "rock" in name else None
    return aj.identify(path_of(name), CURVES, columns, by=by)


def status_of(monkeypatch, log, out, *options):
    """With which status the command ends for a log, with one curve for speed."""
    asked = ["identify", str(log), "--curve", "kiencke", *options, "--out", str(out)]
    monkeypatch.setattr(sys, "argv", asked)
    try:
        run(identify_command.main)
    except SystemExit as ended:
        return ended.code or 0
    return 0


def unwrapped(text):
    return " ".join(text.split())


def holds(interval, value):
    low, high = interval
    return low <= value <= high


def answers(found, mu_max, slip_opt):
    """Whether a peak is told whose intervals hold this one."""
    told = not found.vetoes and found.judgement.at_least is None
    return (
        told and holds(found.mu_max_interval, mu_max) and holds(found.slip_opt_interval, slip_opt)
    )


def one_veto(found, words):
    """The veto with these words, where no number stands for the peak; it is one sentence."""
    numbers = [found.mu_max, *found.mu_max_interval, found.slip_opt, *found.slip_opt_interval]
    assert np.isnan(numbers).all()
    assert found.judgement.at_least is None
    (veto,) = [veto for veto in found.vetoes if words in veto]
    assert veto.endswith(".")
    assert found.verdict.startswith("No answer:")
    return veto


def at_least(found, low, high):
    """That largest adhesion is at least a value between these, and nothing is said of its slip."""
    assert not found.vetoes
    assert low <= found.mu_max <= high
    start, end = found.mu_max_interval
    assert start <= found.mu_max
    assert end == np.inf
    assert np.isnan([found.slip_opt, *found.slip_opt_interval]).all()
    assert "Adhesion is not seen to fall" in unwrapped(found.verdict)
    assert "at least" in repr(found)


@pytest.mark.parametrize(
    "name",
    [
        "slow_level_noisy_slip",
        pytest.param("tooth_spikes", marks=pytest.mark.thorough),
        pytest.param("rolling_rows", marks=pytest.mark.long),
    ],
)
def test_a_fault_that_hides_no_peak_leaves_the_truth_in_the_intervals(name):
    found = of_form(name)
    assert answers(found, DRY.mu_max, DRY.slip_opt)
    low, high = found.mu_max_interval
    assert high - low < 0.07


@pytest.mark.long
def test_points_above_the_interval_are_no_fault_where_neighbours_share_their_noise():
    """Of the correlation .95, a part of which is described as levels of runs or slow ones."""
    for seed in (1, 14):
        assert aj.identify(draw(CELLS["ar95"], seed)).vetoes == ()


def test_a_slow_level_and_a_noisy_slip_do_not_lead_the_fit_away_from_the_points():
    """The residual is not much larger than that about the true curve at the measured slips."""
    table, _ = FAULTS["slow_level_noisy_slip"](0)
    left = table["adhesion"] - DRY.adhesion(table["slip_ratio"].to_numpy())
    assert of_form("slow_level_noisy_slip").fit.rms < 1.1 * float(np.sqrt((left**2).mean()))


@pytest.mark.long
def test_a_slip_held_on_the_rise_tells_the_least_that_adhesion_reaches():
    _, truth = FAULTS["held_slip"](0)
    at_least(of_form("held_slip"), 0.98 * truth["at_least"], DRY.mu_max)


def test_a_stuck_sensor_shows_no_dependence_on_slip():
    assert "one number (0.24)" in one_veto(of_form("stuck_sensor"), "no dependence on slip")


def test_noise_alone_shows_no_dependence_on_slip():
    veto = one_veto(of_form("independent_of_slip"), "no dependence on slip")
    number = float(veto.split("one number (")[1].split(")")[0])
    # The median of 400 normal numbers of standard deviation .035 has an error of .0022.
    assert number == pytest.approx(0.17, abs=4 * 0.0022)


def test_traction_and_braking_that_differ_are_no_one_curve():
    veto = one_veto(of_form("two_branches"), "Traction and braking are no one curve")
    assert "identify each by itself" in veto


@pytest.mark.parametrize(
    "name", [pytest.param("shifted_signals", marks=pytest.mark.thorough), "late_in_few_rows"]
)
def test_adhesion_that_is_late_is_said_to_follow_the_slip_by_so_much(name):
    """A slip event's top is flat: the delay is known to about two rows."""
    table, truth = FAULTS[name](0)
    veto = one_veto(of_form(name), "not of one moment")
    seconds, when = veto.split("follows the slip of ")[1].split(" s ")
    assert when.startswith("before")
    step = float(np.diff(table["time_s"])[0])
    assert float(seconds) == pytest.approx(truth["delay_s"], abs=2.5 * step)


def test_columns_that_are_exchanged_are_said_to_look_so():
    veto = one_veto(of_form("swapped_columns"), "look exchanged")
    assert "what is called slip is a function of what is called adhesion" in veto


def test_one_sweep_does_not_tell_a_slow_rail_from_the_shape_of_the_curve():
    warned = "Slip passes its values only once"
    one = of_form("one_sweep_slow_rail")
    assert not one.vetoes
    assert one.verdict.startswith(f"Warning: {warned}")
    assert warned not in unwrapped(of_form("slow_level_noisy_slip").verdict)


@pytest.mark.parametrize(
    ("name", "by", "truths"),
    [
        pytest.param("two_surfaces", "surface", "by_surface", marks=pytest.mark.long),
        pytest.param("rails_in_one_log", "rail", "by_rail", marks=pytest.mark.thorough),
    ],
)
def test_groups_by_a_column_of_text_differ_and_each_has_its_own_peak(name, by, truths):
    _, truth = FAULTS[name](0)
    found = of_form(name, by)
    assert found.comparison.changed
    assert set(found.comparison.table[by]) == set(truth[truths])
    assert f"compared by {by}, the level of adhesion differs" in unwrapped(found.verdict)
    assert set(found.groups) == set(truth[truths])
    for group, (mu_max, slip_opt) in truth[truths].items():
        answer = found.groups[group]
        assert answer.mu_max.low <= mu_max <= answer.mu_max.high, group
        assert answer.slip_opt.low <= slip_opt <= answer.slip_opt.high, group


@pytest.mark.long
def test_a_group_that_tells_no_peak_by_itself_has_a_veto_and_no_interval(tmp_path):
    """One group is a curve, in the other adhesion does not depend on slip."""
    curve, _ = FAULTS["slow_level_noisy_slip"](0)
    level, _ = FAULTS["independent_of_slip"](0)
    level["run"] += curve["run"].max()
    table = pd.concat([curve.assign(surface="rail"), level.assign(surface="mat")])
    found = aj.identify(table, "kiencke", by="surface")
    rail, mat = found.groups["rail"], found.groups["mat"]
    assert not rail.judgement.vetoes
    assert holds((rail.mu_max.low, rail.mu_max.high), DRY.mu_max)
    assert np.isnan([*mat.mu_max, *mat.slip_opt]).all()
    assert "no dependence on slip" in mat.status
    assert "mat: no answer (These points show no dependence on slip" in unwrapped(found.verdict)
    found.write(tmp_path)
    rows = pd.read_csv(tmp_path / "runs.csv").set_index("surface")
    assert rows.loc["rail", "own_mu_max"] == rail.mu_max.value
    assert rows.loc["mat", ["own_mu_max", "own_mu_max_lo", "own_slip_opt"]].isna().all()
    assert rows.loc["mat", "own_status"] == mat.status
    # An interval under one curve is told where its ends are within a factor of two.
    told = rows["mu_max_hi"].notna()
    assert np.all(rows["mu_max_hi"][told] <= 2 * rows["mu_max_lo"][told])


def test_a_column_to_compare_by_that_is_absent_is_named():
    table, _ = FAULTS["two_surfaces"](0)
    with pytest.raises(InputError, match="has no column ground"):
        aj.identify(table, CURVES, by="ground")


@pytest.mark.parametrize(("by", "near"), [("Surface", "is surface."), ("axle", "are ")])
def test_a_column_to_compare_by_that_is_misspelt_or_absent_is_answered_with_those_there(by, near):
    table, _ = FAULTS["two_surfaces"](0)
    with pytest.raises(InputError, match=f"has no column {by}.* there {near}"):
        aj.identify(table, CURVES, by=by)


@pytest.mark.thorough
def test_a_group_by_a_label_that_is_known_is_compared_as_that_label():
    table, _ = FAULTS["two_surfaces"](0)
    as_axle = aj.identify(table.rename(columns={"surface": "axle"}), CURVES, by="axle")
    one, other = as_axle.comparison, of_form("two_surfaces", "surface").comparison
    assert one.statistic == other.statistic
    assert set(one.table["axle"]) == set(other.table["surface"])


def test_the_fit_of_a_curve_is_the_same_to_the_last_bit_whichever_others_are_asked_for():
    table, _ = FAULTS["slow_level_noisy_slip"](0)
    alone = aj.identify(table, "kiencke").fits["kiencke"]
    among = of_form("slow_level_noisy_slip").fits["kiencke"]
    np.testing.assert_array_equal(alone.parameters, among.parameters)
    np.testing.assert_array_equal(alone.standard_errors, among.standard_errors)
    assert alone.interval == among.interval
    assert (alone.peak.slip, alone.peak.adhesion) == (among.peak.slip, among.peak.adhesion)
    assert alone.slip_opt_se == among.slip_opt_se
    assert alone.rms == among.rms
    np.testing.assert_array_equal(alone.left_out, among.left_out)
    assert alone.noise == among.noise


@pytest.mark.long
def test_a_vetoed_file_is_written_with_its_veto_and_the_command_succeeds(tmp_path, monkeypatch):
    table, _ = FAULTS["independent_of_slip"](0)
    log, out = tmp_path / "log.csv", tmp_path / "out"
    table.to_csv(log, index=False)
    assert status_of(monkeypatch, log, out) == 0
    verdict = (out / "verdict.txt").read_text(encoding="utf-8")
    assert verdict.startswith("mu_max    not known")
    assert "No answer:" in verdict
    assert list(pd.read_csv(out / "curves.csv")["curve"]) == ["kiencke"]
    page = unwrapped((out / "report.html").read_text(encoding="utf-8"))
    veto = one_veto(of_form("independent_of_slip"), "no dependence on slip")
    assert veto in page


@pytest.mark.long
def test_the_command_compares_by_a_column_of_text(tmp_path, monkeypatch, capsys):
    table, _ = FAULTS["two_surfaces"](0)
    log, out = tmp_path / "log.csv", tmp_path / "out"
    table.to_csv(log, index=False)
    assert status_of(monkeypatch, log, out, "--by", "surface") == 0
    assert set(pd.read_csv(out / "runs.csv")["surface"]) == {"concrete", "ice"}
    assert "compared by surface" in unwrapped(capsys.readouterr().out)


@pytest.mark.parametrize(
    ("name", "mu_max", "slip_opt"),
    [
        pytest.param(
            "newcomer/slow_level_noisy_slip.csv", 0.2928, 0.0278, marks=pytest.mark.thorough
        ),
        pytest.param("field/coasting_sweeps.csv", 0.300, 0.050, marks=pytest.mark.thorough),
        pytest.param("field/tooth_spikes.csv", 0.300, 0.050, marks=pytest.mark.thorough),
        ("newcomer/lab_errorbars.csv", *LAB),
        ("newcomer/lab_repeats_wide.csv", *LAB),
    ],
)
def test_the_truth_of_a_file_is_in_both_intervals(name, mu_max, slip_opt):
    assert answers(of_file(name), mu_max, slip_opt)


@pytest.mark.thorough
def test_events_that_hold_a_slip_tell_the_least_that_adhesion_reaches():
    at_least(of_file("field/coasting_holds.csv"), 0.21, 0.30)


@pytest.mark.parametrize(
    ("name", "words", "more"),
    [
        pytest.param(
            "newcomer/mu_constant.csv",
            "no dependence on slip",
            "one number (0.3)",
            marks=pytest.mark.thorough,
        ),
        ("newcomer/noise_only.csv", "no dependence on slip", "one number (0."),
        ("newcomer/swapped.csv", "look exchanged", "--column"),
        pytest.param(
            "field/sandwheel_straight.csv",
            "Traction and braking",
            "in traction and",
            marks=pytest.mark.thorough,
        ),
    ],
)
def test_a_file_without_a_peak_has_a_veto_that_says_why(name, words, more):
    assert more in one_veto(of_file(name), words)


def test_a_force_in_another_unit_than_its_heading_says_is_asked_about():
    """An adhesion of .0003 is that of a force in kN whose heading says N."""
    with pytest.raises(InputError) as refused:
        of_file("newcomer/force_wrong_unit.csv")
    assert "the adhesion is 0.0002997 or less in nine of ten rows" in str(refused.value)
    assert 'columns={"wheel_force": "Radkraft [UNIT]"}' in str(refused.value)


@pytest.mark.long
def test_an_adhesion_that_no_contact_has_is_no_answer_though_its_unit_was_said():
    table, _ = FAULTS["rolling_rows"](0)
    whole = table.assign(adhesion=100 * table["adhesion"])
    veto = one_veto(aj.identify(whole, "kiencke", {"adhesion": "adhesion [1]"}), "No contact has")
    assert "or less in nine of ten rows" in veto


@pytest.mark.thorough
def test_a_file_of_what_is_no_adhesion_over_slip_has_no_peak():
    found = of_file("field/rock_velocity_step.csv")
    assert found.vetoes
    assert np.isnan([found.mu_max, *found.mu_max_interval, found.slip_opt]).all()


@pytest.mark.thorough
def test_the_surfaces_under_a_robot_differ():
    found = of_file("field/robot_surfaces.csv", "surface")
    assert set(found.comparison.table["surface"]) == {"brown", "table"}
    assert found.comparison.changed or found.comparison.bent
    for group in found.groups.values():
        assert group.status or group.mu_max.high <= 2 * group.mu_max.low


def test_the_curve_of_most_weight_is_named_as_the_best_where_rows_depend_on_each_other():
    """Of rows of which ten tell as much as one, a gain of density counts as a tenth of it."""
    fits = of_form("slow_level_noisy_slip").fits
    plain, bent = sorted(
        (fits[name] for name in ("burckhardt", "exponential")), key=lambda fit: fit.departure.occam
    )
    assert dependence({"plain": plain, "bent": bent}) > 5
    costs = bent.departure.occam - plain.departure.occam
    assert costs > 0
    more = plain.left_out + 2 * costs / plain.left_out.size
    both = {"plain": plain, "bent": bent._replace(left_out=more)}
    densities = log_densities(both)
    weights = answered(both).weights
    assert weights["plain"] > weights["bent"]
    assert densities["plain"] > densities["bent"]
