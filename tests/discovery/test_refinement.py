"""What is made of an effect once it is found: its form, its doubts, and a second look."""

from itertools import permutations

import numpy as np
import pytest
from discovery_campaigns import SIZE, problem_of

from adhesion_jax.discovery.model.bases import first_fits, fits_alone
from adhesion_jax.discovery.model.fitting import Setting, has_room, squares
from adhesion_jax.discovery.model.noise import white_noise
from adhesion_jax.discovery.search.catalogue import entry_of
from adhesion_jax.discovery.search.judgement import curve_doubts, doubtful, undecided
from adhesion_jax.discovery.search.refinement import _harmonics, forms_of, refined
from adhesion_jax.discovery.search.screening import screen
from adhesion_jax.discovery.search.selection import search_columns
from adhesion_jax.discovery.search.state import Accepted, refreshed, settled, slots_of
from adhesion_jax.discovery.types import Candidate
from adhesion_jax.effects import EFFECTS, Covariate, Interaction, Periodic, Spline
from adhesion_jax.simulation.simulator import simulate

LENGTH = 20.0


def state_of(table, *accepted, bases=("burckhardt",)):
    problem = problem_of(table)
    adhesion = np.asarray(problem.data.adhesion)
    setting = Setting(problem, white_noise(problem.points, 0.02), adhesion)
    return settled(first_fits(fits_alone(setting, list(bases))), accepted, ())


def taken(name, part, *covariates, family=None, generic=False, gain=100.0):
    return Accepted(
        name, (name,), family or name, generic, covariates, (part,), p=0.0005, gain=gain
    )


def joint(length=LENGTH):
    part = EFFECTS["rail_joint"](0.04, 0.01, 0.0, 0.0, length=length)
    return taken("rail_joint", part, "position_m", family="place")


@pytest.fixture(scope="module")
def null():
    return simulate(seed=4, base="burckhardt", **SIZE).train


@pytest.fixture(scope="module")
def quiet(null):
    return state_of(null)


@pytest.fixture(scope="module")
def square(null):
    """Rails that are better and worse in turns, with edges."""
    wave = np.sign(np.sin(2 * np.pi * null["position_m"] / LENGTH))
    table = null.assign(adhesion=null["adhesion"] * (1 + 0.06 * wave))
    return state_of(table, joint())


@pytest.mark.thorough
def test_the_harmonics_of_a_wave_are_those_that_its_form_has_not(quiet):
    problem = quiet.setting.problem
    (first,) = joint().parts
    found = _harmonics([first], problem)
    # Its own form has the first two.
    assert [one.frequency * LENGTH for one in found] == pytest.approx([3, 4, 5, 6, 7])
    assert {one.column for one in found} == {"position_m"}
    third = Periodic(0.01, 0.0, 3.02 / LENGTH, column="position_m")
    found = _harmonics([first, third], problem)
    assert [one.frequency * LENGTH for one in found] == pytest.approx([4, 5, 6, 7])
    plain = Periodic(0.01, 0.01, 0.3, column="rail_age_days")
    found = _harmonics([plain], problem)
    assert [one.frequency for one in found] == pytest.approx(0.3 * np.arange(2, 8))
    assert _harmonics([EFFECTS["curve"](k=1.0)], problem) == []


def test_forms_are_of_the_columns_of_the_effect_and_not_those_there_are(quiet):
    problem = quiet.setting.problem
    line = Covariate(0.02, 3.0, 1.0, column="temperature_C", acts_on="slip")
    one = taken("covariate:temperature_C", line, "temperature_C", generic=True)
    entries = forms_of(one, problem)
    assert {entry.covariates for entry in entries} == {("temperature_C",)}
    kinds = {(type(entry.starts[0]).__name__, entry.acts_on) for entry in entries}
    parts = ("level", "slip", "fall")
    assert kinds == {
        (kind, acts_on) for kind in ("Covariate", "Spline", "Threshold") for acts_on in parts
    } - {("Covariate", "slip")}
    two = one._replace(covariates=("temperature_C", "rail_age_days"))
    entries = forms_of(two, problem)
    pairs = [entry for entry in entries if isinstance(entry.starts[0], Interaction)]
    assert {entry.acts_on for entry in pairs} == {*parts}
    assert all({entry.starts[0].first, entry.starts[0].second} == {*two.covariates}
               for entry in pairs)  # fmt: skip


def test_the_slots_of_a_fit_are_in_the_order_of_application():
    lag = taken("lag", EFFECTS["lag"](time_constant=0.2), "slip_ratio")
    bias = taken("slip_bias", EFFECTS["slip_bias"](bias=1e-3), "slip_ratio")
    wave = joint()
    wave = wave._replace(parts=(*wave.parts, EFFECTS["curve"](k=1.0), *bias.parts))
    for accepted in permutations((lag, bias, wave)):
        parts = [accepted[number].parts[part] for number, part in slots_of(accepted)]
        orders = [part.ORDER for part in parts]
        assert orders == sorted(orders)
        # What comes back from a fit by slot is each effect's own again, equal parts included.
        assert refreshed(accepted, parts) == accepted


def test_a_square_wave_gets_its_harmonics(square):
    better = refined(square, seed=0)
    (effect,) = better.accepted
    assert effect.name == "rail_joint"
    waves = [part for part in effect.parts if isinstance(part, Periodic)]
    numbers = sorted(float(wave.frequency) * LENGTH for wave in waves)
    # Of a square wave the odd ones alone, each by one over its number: .06 4/pi/n.
    assert numbers[0] == pytest.approx(3, abs=0.02)
    for wave in waves:
        number = round(float(wave.frequency) * LENGTH)
        assert number % 2 == 1
        amplitude = np.hypot(float(wave.sine), float(wave.cosine))
        assert amplitude == pytest.approx(0.06 * 4 / np.pi / number, abs=0.005)
    assert squares(better.fitted) < 0.95 * squares(square.fitted)


def test_the_parts_of_an_effect_are_its_own_whatever_comes_after_it(null):
    """The wave is the first of two effects; its harmonics are found after the second."""
    wave = np.sign(np.sin(2 * np.pi * null["position_m"] / LENGTH))
    bend = 1 - 60 * null["curvature_per_m"].abs()
    table = null.assign(adhesion=null["adhesion"] * (1 + 0.06 * wave) * bend)
    curve = taken("curve", EFFECTS["curve"](k=30.0), "curvature_per_m", family="curvature")
    better = refined(state_of(table, joint(), curve), seed=0)
    first, second = better.accepted
    assert {type(part) for part in first.parts} == {EFFECTS["rail_joint"], Periodic}
    assert [type(part) for part in second.parts] == [EFFECTS["curve"]]
    assert float(second.parts[0].k) == pytest.approx(60, rel=0.1)
    assert float(first.parts[1].frequency) * LENGTH == pytest.approx(3, abs=0.02)


def test_a_form_that_is_right_is_left_as_it_is(null):
    wave = np.sin(2 * np.pi * null["position_m"] / LENGTH)
    state = state_of(null.assign(adhesion=null["adhesion"] * (1 + 0.06 * wave)), joint())
    better = refined(state, seed=0)
    assert [len(effect.parts) for effect in better.accepted] == [1]
    assert better.fitted.values.tolist() == state.fitted.values.tolist()


def test_a_model_that_fills_its_program_grows_no_further(quiet):
    problem = quiet.setting.problem
    entries = [entry_of("humidity", EFFECTS["humidity"].starts(problem.flat), problem)]
    (wave,) = joint().parts
    line = Covariate(0.1, 0.0, 1.0, column="position_m", acts_on="level")
    # Twelve effects are the most, and 64 parameters: five are the curve's and five a wave's.
    assert has_room([line] * 11, line)
    assert not has_room([line] * 12, line)
    assert has_room([wave] * 10, wave)
    assert not has_room([wave] * 11, wave)
    assert screen(quiet.fitted, entries, seed=0)
    assert screen(quiet.fitted._replace(effects=(line,) * 12), entries, seed=0) == ()


BOTH = ("burckhardt", "polach-falling")


def test_a_curve_that_falls_where_friction_does_so_on_another_is_a_doubt(null):
    slip_velocity = null["slip_ratio"].abs() * null["vehicle_speed_mps"]
    table = null.assign(adhesion=null["adhesion"] * (0.6 + 0.4 * np.exp(-0.6 * slip_velocity)))
    state = state_of(table, bases=BOTH)._replace(base="polach-falling")
    (doubt,) = curve_doubts(state)
    assert doubt.names == ("falling_friction",)
    assert "above that of burckhardt alone" in doubt.sentence
    # It is an effect where the curve does not fall, and none twice.
    assert curve_doubts(state._replace(base="burckhardt")) == ()
    told = taken("falling_friction", EFFECTS["falling_friction"](0.4, 0.6), family="slip velocity")
    assert curve_doubts(state._replace(accepted=(told,))) == ()


def test_a_curve_that_could_fall_and_does_not_is_no_doubt(null):
    assert curve_doubts(state_of(null, bases=BOTH)._replace(base="polach-falling")) == ()


def row(name, p, gain, decision="explains less", number=1):
    return Candidate(number, name, 5.0, p, gain, 2.0, decision)


def test_what_stood_out_and_was_not_accepted_is_undecided(quiet):
    rows = (
        row("sanding", 0.001, 50.0, "accepted", number=0),
        row("wind", 0.001, 9.0, number=0),
        row("humidity", 0.01, 3.0),
        row("lag", 0.002, 4.0),
        row("delay", 0.002, float("nan"), "less telling"),
        row("curve", 0.2, 8.0, "explains less"),
    )
    state = quiet._replace(ranking=rows)
    (doubt,) = undecided(state)
    assert doubt.names == ("lag",)
    assert "lag stands out" in doubt.sentence
    member = taken("relaxation", EFFECTS["relaxation"](length=1.0), "time_s")
    member = member._replace(members=("relaxation", "lag"))
    (doubt,) = undecided(state._replace(accepted=(member,)))
    assert doubt.names == ("humidity",)
    assert undecided(state._replace(ranking=(*rows, row("patch", 0.001, 9.0, "accepted")))) == ()
    assert undecided(state._replace(ranking=rows[-1:])) == ()
    assert undecided(state._replace(ranking=())) == ()


def test_a_bias_that_a_curve_does_without_is_a_doubt(null):
    bias = taken("slip_bias", EFFECTS["slip_bias"](bias=1e-3), "slip_ratio", family="offset")
    bases = ("burckhardt", "kiencke")
    state = state_of(null, bias, bases=bases)
    left, doubts = doubtful(state)
    assert left.accepted == ()
    assert [doubt.names for doubt in doubts] == [("slip_bias", "torque_offset")]
    # One that no curve does without stays.
    campaign = simulate(["slip_bias"], seed=4, base="burckhardt", strength=0.3, **SIZE)
    state = state_of(campaign.train, bias, bases=bases)
    left, doubts = doubtful(state)
    assert doubts == []
    assert [effect.name for effect in left.accepted] == ["slip_bias"]
    true = campaign.parameters["slip_bias"]["bias"]
    assert float(left.accepted[0].parts[0].bias) == pytest.approx(true, rel=0.1)


def test_an_effect_of_falling_friction_is_doubted_by_its_own_name(null):
    drop = EFFECTS["falling_friction"](drop=0.01, b=0.6)
    # Friction at a speed that is the same in all runs is a function of the slip alone.
    table = null.assign(vehicle_speed_mps=12.0, slip_velocity_mps=12.0 * null["slip_ratio"])
    effect = taken(
        "falling_friction", drop, "slip_ratio", "vehicle_speed_mps", family="slip velocity"
    )
    left, doubts = doubtful(state_of(table, effect))
    assert left.accepted == ()
    assert [doubt.names for doubt in doubts] == [("falling_friction",)]


def old(name, gain):
    return taken(
        f"covariate:{name}", Covariate(0.05, 20.0, 10.0, column=name), name,
        generic=True, gain=gain,
    )  # fmt: skip


@pytest.fixture(scope="module")
def bent(null):
    """Adhesion follows the age of the rail by a line and a bend."""
    age = null["rail_age_days"]
    u = (age - age.median()) / age.std()
    return null.assign(adhesion=null["adhesion"] * np.exp(0.06 * u - 0.06 * u**2))


def test_another_look_at_a_column_mends_the_form_of_its_effect(bent):
    state = state_of(bent, old("rail_age_days", 300.0))
    again = search_columns(state, ["rail_age_days"], seed=0)
    (effect,) = again.accepted
    assert effect.name == "covariate:rail_age_days"
    assert len(effect.parts) > 1
    assert {part.column for part in effect.parts} == {"rail_age_days"}
    assert any(not isinstance(part, Covariate) for part in effect.parts)
    assert squares(again.fitted) < 0.9 * squares(state.fitted)


def test_another_look_finds_an_effect_of_another_column_apart(bent):
    warm = (bent["temperature_C"] - bent["temperature_C"].median()) / bent["temperature_C"].std()
    table = bent.assign(adhesion=bent["adhesion"] * np.exp(0.08 * warm))
    state = state_of(table, old("rail_age_days", 300.0))
    again = search_columns(state, ["temperature_C"], seed=0)
    names = [effect.covariates for effect in again.accepted]
    assert names == [("rail_age_days",), ("temperature_C",)]


def test_another_look_where_nothing_is_changes_nothing(quiet):
    again = search_columns(quiet, ["temperature_C", "rail_age_days"], seed=0)
    assert again.accepted == ()
    assert [effect for effect in again.fitted.effects if isinstance(effect, Spline)] == []
