from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from discovery_campaigns import SIZE, problem_of
from scipy import stats
from scipy.signal import lfilter

from adhesion_jax.discovery.model.fitting import Setting, covariance, fit_model, likeliest
from adhesion_jax.discovery.model.noise import white_noise
from adhesion_jax.discovery.search.catalogue import Entry, library_of
from adhesion_jax.discovery.search.joint import surfaces
from adhesion_jax.discovery.search.scans import torsion, waves
from adhesion_jax.discovery.search.screening import _as_normal, screen
from adhesion_jax.effects import EFFECTS, Covariate
from adhesion_jax.simulation.simulator import simulate

RUNS, POINTS = 17, 100
FLIPS = 1999


@pytest.fixture(scope="module")
def null():
    """The table of a campaign without effects, seed and noise of the simulator."""
    return simulate(seed=4, base="burckhardt", **SIZE).train


def started(table):
    """A campaign with its curve fitted and its noise estimated."""
    problem = problem_of(table)
    adhesion = np.asarray(problem.data.adhesion)
    setting = Setting(problem, white_noise(problem.points, 0.01), adhesion)
    return likeliest(setting, "burckhardt", (0.3, 60.0, 0.3), ())


@pytest.fixture(scope="module")
def quiet(null):
    return started(null)


def at_one_slip(column, response):
    """A campaign at slip .02 about a level of .3: sigma .01, plus what a column does."""
    draw = np.random.default_rng(8)
    table = pd.DataFrame(
        {
            "run": np.repeat(np.arange(RUNS), POINTS),
            "slip_ratio": 0.02,
            "adhesion": 0.3 + 0.01 * draw.standard_normal(RUNS * POINTS) + response * column,
            "wear": column,
        }
    )
    problem = problem_of(table)
    setting = Setting(problem, white_noise(problem.points, 0.01), 0.3 * problem.points)
    return fit_model(setting, "level", (0.25,), ())


def entry(scale):
    start = Covariate(k=0.02, reference=0.0, scale=scale, column="wear")
    return Entry("covariate:wear", (start,), ("wear",), True, "wear")


def deviate(chi_square):
    return stats.norm.isf(stats.chi2.sf(chi_square, 1))


def test_the_statistic_within_runs_is_the_likelihood_ratio():
    column = np.tile(np.linspace(-1, 1, POINTS), RUNS)
    fitted = at_one_slip(column, 0.001)
    (score,) = screen(fitted, [entry(1.0)], seed=0)
    y = np.asarray(fitted.setting.problem.data.adhesion).ravel() / 0.01
    design = np.stack([np.ones_like(y), column], axis=1)
    left = [y - some @ np.linalg.lstsq(some, y, rcond=None)[0] for some in (design[:, :1], design)]
    ratio = (left[0] ** 2).sum() - (left[1] ** 2).sum()
    # Divided by how much more the scores of the runs scatter than those of white noise, if more.
    unit = column / np.linalg.norm(column)
    by_run = (left[1] * unit).reshape(RUNS, POINTS).sum(1)
    assert score.z == pytest.approx(deviate(ratio / max((by_run**2).sum(), 1.0)), rel=0.02)


def test_the_statistic_between_runs_is_that_of_their_levels():
    by_run = np.random.default_rng(9).permutation(np.linspace(-1, 1, RUNS))
    fitted = at_one_slip(np.repeat(by_run, POINTS), 0.0015)
    (score,) = screen(fitted, [entry(1.0)], seed=0)
    levels = np.asarray(fitted.setting.problem.data.adhesion).mean(axis=1)
    r = np.corrcoef(levels, by_run)[0, 1]
    # Bartlett's factor: runs, less one, less (k + 1)/2 for the k = 1 of a line.
    assert score.z == pytest.approx(deviate(-(RUNS - 2) * np.log(1 - r**2)), rel=0.02)


@pytest.mark.parametrize("freedom", [1, 2, 5, 9])
def test_a_chi_square_becomes_the_normal_deviate_of_its_tail(freedom):
    statistic = np.linspace(0.5 * freedom, 200, 400)
    # The series meet at a step of a twentieth.
    expected = stats.norm.isf(stats.chi2.sf(statistic, freedom))
    np.testing.assert_allclose(_as_normal(statistic, np.array(freedom)), expected, atol=0.06)


def test_a_strong_effect_ranks_first_with_the_smallest_p():
    table = simulate(["sanding"], seed=0, base="burckhardt", **SIZE).train
    fitted = started(table)
    scores = screen(fitted, library_of(fitted.setting.problem), seed=0)
    assert scores[0].entry.name == "sanding"
    assert scores[0].p == 1 / (1 + FLIPS)
    assert scores[0].z > 2 * scores[0].needed
    far = {score.entry.name: score.z for score in scores}
    assert far["temperature"] < scores[0].needed


def test_nothing_is_significant_where_nothing_is(quiet):
    fitted = quiet
    scores = screen(fitted, library_of(fitted.setting.problem), seed=0)
    assert {score.entry.name for score in scores} >= {"humidity", "lag", "covariate:rail_age_days"}
    assert scores[0].p > 0.01
    assert scores[0].z < scores[0].needed
    assert all(a.z >= b.z for a, b in pairwise(scores))
    assert all(0 < score.p <= 1 for score in scores)


def test_the_library_is_of_all_columns_and_their_pairs(quiet):
    problem = quiet.setting.problem
    names = {one.name for one in library_of(problem)}
    # The noise of the slip belongs to the likelihood.
    assert {*EFFECTS} - names == {"axle_position", "slip_noise"}
    columns = ("temperature_C", "normal_load_N", "slip_velocity_mps", "absent")
    pairs = [(one.name, one.acts_on) for one in surfaces(problem, columns)]
    joint = "product:normal_load_N*temperature_C"
    assert [acts_on for name, acts_on in pairs if name == joint] == ["level", "slip", "fall"]
    # With a function of the slip the curve itself is bent, however it acts.
    assert ("product:normal_load_N*slip_velocity_mps", "level") in pairs
    assert len(set(pairs)) == len(pairs) == 5
    beside = surfaces(problem, columns[:1], columns)
    assert {one.name for one in beside} == {joint, "product:slip_velocity_mps*temperature_C"}


@pytest.mark.parametrize("length", [17.3, 41.0])
def test_a_wave_along_the_track_is_found_at_its_length(null, length):
    wave = 1 + 0.03 * np.sin(2 * np.pi * null["position_m"] / length + 0.4)
    fitted = started(null.assign(adhesion=null["adhesion"] * wave))
    found = {one.entry.name: one for one in waves(fitted, [], 0)}
    assert found["rail_joint"].p == 1 / (1 + FLIPS)
    (start,) = found["rail_joint"].entry.starts
    # To half a bin of the spectrum over twice the track.
    track = np.ptp(null["position_m"])
    assert 1 / float(start.length) == pytest.approx(1 / length, abs=0.5 / track)
    assert "rail_joint" not in {one.entry.name for one in waves(fitted, [*found], 0)}
    # And the fit from there has its length and its amplitude to three standard errors.
    joint = fit_model(fitted.setting, "burckhardt", fitted.base_values.tolist(), (start,))
    sine, cosine, _, _, found_length = joint.values[list(joint.places)][3:]
    error = np.sqrt(np.diag(covariance(joint)))[3:]
    assert error[4] < 0.005 * length
    assert found_length == pytest.approx(length, abs=3 * error[4])
    assert np.hypot(sine, cosine) == pytest.approx(0.03, abs=3 * max(error[:2]))
    assert waves(joint, [], 0) == []


def test_a_wave_is_found_at_its_length_though_its_second_harmonic_stands_out_most(null):
    """Joints are short: half a wave is as strong as the whole, and slow noise hides the whole."""
    length = 24.4
    phase = 2 * np.pi * null["position_m"] / length
    wave = 1 + 0.03 * np.sin(phase + 0.4) + 0.03 * np.sin(2 * phase + 1.1)
    draw = np.random.default_rng(5)
    slow = lfilter([0.004], [1, -0.95], draw.standard_normal((RUNS, POINTS)), axis=1)
    fitted = started(null.assign(adhesion=null["adhesion"] * wave + slow.ravel()))
    (start,) = {one.entry.name: one for one in waves(fitted, [], 0)}["rail_joint"].entry.starts
    track = np.ptp(null["position_m"])
    assert 1 / float(start.length) == pytest.approx(1 / length, abs=0.5 / track)


@pytest.mark.parametrize("frequency", [1.7, 3.2])
def test_a_line_in_time_is_found_whatever_its_phase(null, frequency):
    phase = np.repeat(np.random.default_rng(3).uniform(0, 2 * np.pi, RUNS), POINTS)
    line = 0.005 * np.sin(2 * np.pi * frequency * null["time_s"] + phase)
    fitted = started(null.assign(adhesion=null["adhesion"] + line))
    found = torsion(fitted)
    # To half of the resolution, one over the ten seconds of a run.
    assert found.frequency == pytest.approx(frequency, abs=0.05)
    assert found.amplitude == pytest.approx(0.005, rel=0.15)
    assert found.p < 1e-6
    assert waves(fitted, [], 0) == []


def test_in_noise_there_is_neither(quiet):
    assert waves(quiet, [], 0) == []
    assert torsion(quiet) is None
