"""What is made of an effect once it is found: its form, and what is left undecided."""

import dataclasses
from itertools import permutations

import numpy as np
import pytest
from discovery_campaigns import SIZE, campaign, curve, state_of

from adhesion_jax.discovery.engine import _full_words
from adhesion_jax.discovery.model.fitting import size_of, slope_of
from adhesion_jax.discovery.model.program import _TOGETHER
from adhesion_jax.discovery.search.catalogue import entry_of, library_of
from adhesion_jax.discovery.search.probes import null_of
from adhesion_jax.discovery.search.refinement import (
    _harmonics,
    _smaller,
    forms_of,
    pruned,
    refined,
)
from adhesion_jax.discovery.search.screening import screen
from adhesion_jax.discovery.search.selection import nominated, search, undecided
from adhesion_jax.discovery.search.state import (
    MOST_FORMS,
    Accepted,
    slots_of,
    with_constants,
    with_parts,
)
from adhesion_jax.discovery.types import Candidate, Opinion
from adhesion_jax.effects import EFFECTS, Constant, Covariate, Interaction, Labels, Periodic
from adhesion_jax.effects.shape import ACTS_ON
from adhesion_jax.runtime import silent
from experiments.campaigns.simulator import simulate

LENGTH = 20.0


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
    forms = {(kind, part) for kind in ("Covariate", "Spline", "Threshold") for part in ACTS_ON}
    # Where the column moves within runs it may act with a memory, on the level or on the slip.
    memory = {("Memory", "level"), ("Memory", "slip")}
    assert kinds - memory == forms - {("Covariate", "slip")}
    two = one._replace(covariates=("temperature_C", "rail_age_days"))
    entries = forms_of(two, problem)
    pairs = [entry for entry in entries if isinstance(entry.starts[0], Interaction)]
    assert {entry.acts_on for entry in pairs} == {*ACTS_ON}
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
        assert with_parts(accepted, slots_of(accepted), parts) == accepted


@pytest.mark.thorough
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
    left, before = (np.sum(one.fitted.error[:17, :100] ** 2) for one in (better, square))
    assert left < 0.95 * before


@pytest.mark.thorough
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


@pytest.mark.thorough
def test_a_form_that_is_right_is_left_as_it_is(null):
    wave = np.sin(2 * np.pi * null["position_m"] / LENGTH)
    state = state_of(null.assign(adhesion=null["adhesion"] * (1 + 0.06 * wave)), joint())
    better = refined(state, seed=0)
    assert [len(effect.parts) for effect in better.accepted] == [1]
    assert better.fitted.values.tolist() == state.fitted.values.tolist()


@pytest.mark.thorough
def test_a_model_may_grow_beyond_any_program(quiet):
    """Thirty lines over a column that moves nothing leave the slope and every candidate there."""
    problem = quiet.setting.problem
    entries = [entry_of("humidity", EFFECTS["humidity"].starts(problem.flat), problem)]
    line = Covariate(0.0, 0.0, 1.0, column="position_m", acts_on="level")
    (start,) = Labels.starts({"axle": np.arange(3.0)})
    for effects in ((line,) * 30, (start,) * 12):
        slots, parameters = size_of("burckhardt", effects)
        strengths = sum(len(effect.FACTS.strengths) for effect in effects)
        # 37 are the curve's and its departure's.
        assert slots >= len(effects)
        assert parameters >= 37 + strengths
        assert parameters % _TOGETHER == 0
    crowded = quiet.fitted._replace(effects=(line,) * 30)
    np.testing.assert_allclose(slope_of(crowded), slope_of(quiet.fitted), atol=1e-6)
    null = null_of(quiet.fitted)
    (alone,) = screen([([null], entries)], seed=0)
    (beside,) = screen([([null._replace(fitted=crowded)], entries)], seed=0)
    assert beside.z == pytest.approx(alone.z, abs=1e-6)


def test_nothing_is_added_to_a_full_law_and_that_is_said(square):
    """Though the wave of that law lacks harmonics, which a law of one form less would be given."""
    nothing = Covariate(0.0, 0.0, 1.0, column="position_m", acts_on="level")

    def with_forms(count):
        return square._replace(fitted=square.fitted._replace(effects=(nothing,) * count))

    full = with_forms(MOST_FORMS)
    entries = library_of(square.setting.problem)
    assert search(full, entries, 0, silent) is full
    assert nominated(full, entries, Opinion(0.5, 0.1, 1e-9, ("position_m",)), 0) is full
    assert refined(full, 0) is full
    # Constants, and lines that are tested as one, may make it one form more.
    (words,) = _full_words(with_forms(13))
    assert "consists of 13 forms, and to a law of 12 or more a search adds none" in words
    assert "not looked for" in words
    assert _full_words(with_forms(MOST_FORMS - 1)) == []


def row(name, p, gain, decision="explains less", number=1, z=5.0):
    return Candidate(number, name, z, p, gain, 2.0, decision)


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
    assert doubt.sentence == (
        "A lag of the adhesion signal stands out in the residual (adjusted p = 0.002), but taken "
        "into the law it does not raise the likelihood of runs left out by enough (4 with a "
        "standard error of 2): it is not counted as an effect. It may be weak, act differently at "
        "other values of another column, or be a proxy for a cause that has no column here; more "
        "runs in which it varies would decide."
    )
    member = taken("relaxation", EFFECTS["relaxation"](length=1.0), "time_s")
    member = member._replace(members=("relaxation", "lag"))
    (doubt,) = undecided(state._replace(accepted=(member,)))
    assert doubt.names == ("humidity",)
    assert undecided(state._replace(ranking=(*rows, row("patch", 0.001, 9.0, "accepted")))) == ()
    assert undecided(state._replace(ranking=rows[-1:])) == ()
    assert undecided(state._replace(ranking=())) == ()


def test_what_stands_out_in_few_runs_is_told_though_no_p_of_theirs_is_significant(null):
    """By its score, which must reach what acceptance needs where runs are many."""
    first = null[null["run"].isin(null["run"].unique()[:5])]
    five = state_of(first)._replace(thresholds=(4.2,))
    assert five.setting.problem.runs == 5
    least = [
        row(name, 0.0625, np.nan, z=z)
        for name, z in (("covariate:wind (spline)", 6.1), ("lag", 5.0))
    ]
    (doubt,) = undecided(five._replace(ranking=(*least, row("patch", 0.3, np.nan, z=3.9))))
    assert doubt.names == ("covariate:wind",)
    assert "A dependence on wind (spline) stands out most" in doubt.sentence
    assert "as far as 5 runs can show it (adjusted p <= 0.062" in doubt.sentence
    assert undecided(five._replace(ranking=(row("patch", 0.0625, np.nan, z=4.1),))) == ()
    assert undecided(five._replace(ranking=())) == ()


@pytest.mark.parametrize("acts_on", ["offset", "shift"])
def test_an_offset_or_a_shift_need_not_be_nothing_at_the_middle_of_its_column(acts_on):
    """A curve has neither; within 3 % of the truth and to the noise, and no bend is made of it."""
    draw = np.random.default_rng(5)
    table = campaign(draw, kind="both")
    slip, warm = table["slip_ratio"], table["warm"]
    added = {"offset": 0.0, "shift": 0.0, acts_on: {"offset": 0.01, "shift": 0.002}[acts_on]}
    more = curve(slip + added["shift"] * (1 + warm)) + added["offset"] * (1 + warm)
    line = Covariate(0.0, 0.0, 1.0, column="warm", acts_on=acts_on)
    state = state_of(
        table.assign(adhesion=more + draw.normal(0, 0.001, len(table))),
        taken("covariate:warm", line, "warm", generic=True),
    )
    (effect,) = state.accepted
    slope, constant = effect.parts
    assert isinstance(constant, Constant)
    assert constant.acts_on == acts_on
    assert float(slope.k) == pytest.approx(added[acts_on], rel=0.03)
    assert float(constant.k) == pytest.approx(added[acts_on], rel=0.03)
    inside = state.setting.problem.points > 0
    assert np.sqrt(np.mean(state.fitted.error[inside] ** 2)) == pytest.approx(0.001, rel=0.05)
    # Where nothing acts on it any more there is no constant.
    level = dataclasses.replace(line, acts_on="level")
    (bare,) = with_constants([effect._replace(parts=(level, constant))])
    assert bare.parts == (level,)
    assert with_constants([effect]) == (effect,)


def test_a_constant_is_not_left_out_alone():
    """It would stand there again, and what is unnecessary would be looked for without end."""
    draw = np.random.default_rng(6)
    table = campaign(draw)
    # A shift that is nothing at the middle of its column, so that its constant gains nothing.
    more = curve(table["slip_ratio"] + 0.002 * table["warm"]) * (1 + 0.1 * table["load"])
    shift = Covariate(0.002, 0.0, 1.0, column="warm", acts_on="shift")
    level = Covariate(0.1, 0.0, 1.0, column="load")
    state = state_of(
        table.assign(adhesion=more + draw.normal(0, 0.003, len(table))),
        taken("covariate:warm", shift, "warm", generic=True),
        taken("covariate:load", level, "load", generic=True),
    )
    first, _ = state.accepted
    assert [type(part) for part in first.parts] == [Covariate, Constant]
    assert all(with_constants(rest) != state.accepted for rest in _smaller(state))
    kept = pruned(state)
    assert [effect.name for effect in kept.accepted] == ["covariate:warm", "covariate:load"]
