"""The library of the search, waves along columns and lines in time."""

import numpy as np
import pytest
from discovery_campaigns import SIZE, alone, seen
from scipy.signal import lfilter

from adhesion_jax.discovery.model.fitting import covariance, fit_model
from adhesion_jax.discovery.model.packing import effect_places
from adhesion_jax.discovery.search.catalogue import library_of, pair_entries
from adhesion_jax.discovery.search.probes import null_of
from adhesion_jax.discovery.search.scans import torsion, waves
from adhesion_jax.effects import EFFECTS, Surface
from adhesion_jax.effects.shape import ACTS_ON
from experiments.campaigns.simulator import simulate

RUNS, POINTS = 17, 100
FLIPS = 1999


@pytest.fixture(scope="module")
def null():
    """The table of a campaign without effects, seed and noise of the simulator."""
    return simulate(seed=4, base="burckhardt", **SIZE).train


@pytest.fixture(scope="module")
def quiet(null):
    return null_of(alone(null))


def test_the_library_is_of_all_columns_and_their_pairs(quiet):
    problem = quiet.fitted.setting.problem
    names = {one.name for one in library_of(problem)}
    # A difference of braking is a part of the curve.
    assert {*EFFECTS} - names == {"axle_position", "mode_asymmetry"}
    columns = ("temperature_C", "normal_load_N", "slip_velocity_mps", "absent")
    pairs = [(one.name, one.acts_on) for one in pair_entries(Surface, problem, columns)]
    joint = "product:normal_load_N*temperature_C"
    assert [acts_on for name, acts_on in pairs if name == joint] == [*ACTS_ON]
    # With a function of the slip the curve itself is bent, however it acts.
    assert ("product:normal_load_N*slip_velocity_mps", "level") in pairs
    assert len(set(pairs)) == len(pairs) == 2 + len(ACTS_ON)
    beside = pair_entries(Surface, problem, columns[:1], columns)
    assert {one.name for one in beside} == {joint, "product:slip_velocity_mps*temperature_C"}


@pytest.mark.parametrize("length", [17.3, 41.0])
def test_a_wave_along_the_track_is_found_at_its_length(null, quiet, length):
    wave = 1 + 0.03 * np.sin(2 * np.pi * null["position_m"] / length + 0.4)
    now = seen(quiet, null["adhesion"] * wave)
    found = {one.entry.name: one for one in waves(now, [], 0)}
    assert found["rail_joint"].p == 1 / (1 + FLIPS)
    (start,) = found["rail_joint"].entry.starts
    # To half a bin of the spectrum over twice the track.
    track = np.ptp(null["position_m"])
    assert 1 / float(start.length) == pytest.approx(1 / length, abs=0.5 / track)
    assert "rail_joint" not in {one.entry.name for one in waves(now, [*found], 0)}


@pytest.mark.thorough
def test_the_fit_of_a_wave_has_its_length_and_amplitude(null):
    """To three standard errors; and no wave is left."""
    wave = 1 + 0.03 * np.sin(2 * np.pi * null["position_m"] / 41.0 + 0.4)
    fitted = alone(null.assign(adhesion=null["adhesion"] * wave))
    start = EFFECTS["rail_joint"].of_frequency(1 / 41.2)
    joint = fit_model(fitted.setting, "burckhardt", fitted.base_values.tolist(), (start,))
    places = [joint.places.index(place) for place in effect_places(0, start).values()]
    names = [*effect_places(0, start)]
    errors = dict(zip(names, np.sqrt(np.diag(covariance(joint)))[places], strict=True))
    (part,) = joint.effects
    assert errors["length"] < 0.005 * 41
    assert part.length == pytest.approx(41.0, abs=3 * errors["length"])
    amplitude = np.hypot(part.sine, part.cosine)
    assert amplitude == pytest.approx(0.03, abs=3 * max(errors["sine"], errors["cosine"]))
    assert waves(null_of(joint), [], 0) == []


def test_a_wave_is_found_at_its_length_though_its_second_harmonic_stands_out_most(null, quiet):
    """Joints are short: half a wave is as strong as the whole, and slow noise hides the whole."""
    length = 24.4
    phase = 2 * np.pi * null["position_m"] / length
    wave = 1 + 0.03 * np.sin(phase + 0.4) + 0.03 * np.sin(2 * phase + 1.1)
    draw = np.random.default_rng(5)
    slow = lfilter([0.004], [1, -0.95], draw.standard_normal((RUNS, POINTS)), axis=1)
    now = seen(quiet, null["adhesion"] * wave + slow.ravel())
    (start,) = {one.entry.name: one for one in waves(now, [], 0)}["rail_joint"].entry.starts
    track = np.ptp(null["position_m"])
    assert 1 / float(start.length) == pytest.approx(1 / length, abs=0.5 / track)


def sampled(quiet, rate, line=0.0):
    """The fit with a line [rows] more in the adhesion, of samples at that rate in Hz."""
    setting = quiet.fitted.setting
    data = setting.problem.data
    adhesion = np.array(data.adhesion)
    adhesion[quiet.inside] += line
    time = np.arange(adhesion.shape[1]) / rate + np.zeros((adhesion.shape[0], 1))
    data = data._replace(adhesion=adhesion, conditions={**data.conditions, "time_s": time})
    problem = setting.problem._replace(data=data)
    return quiet.fitted._replace(setting=setting._replace(problem=problem))


@pytest.mark.parametrize("frequency", [17.0, 32.0])
def test_a_line_in_time_is_found_whatever_its_phase(quiet, frequency):
    draw = np.random.default_rng(3)
    phase = np.repeat(draw.uniform(0, 2 * np.pi, RUNS), POINTS)
    time = np.tile(np.arange(POINTS) / 100, RUNS)
    line = 0.005 * np.sin(2 * np.pi * frequency * time + phase)
    found = torsion(sampled(quiet, 100.0, line))
    # To half of the resolution, one over the second of a run.
    assert found.frequency == pytest.approx(frequency, abs=0.5)
    assert found.amplitude == pytest.approx(0.005, rel=0.15)
    assert found.p < 1e-6
    # No wheelset twists as slowly as samples at 10 Hz could show.
    assert torsion(sampled(quiet, 10.0, line)) is None


@pytest.mark.long
def test_in_noise_there_is_neither(quiet):
    assert waves(quiet, [], 0) == []
    assert torsion(quiet.fitted) is None


@pytest.mark.parametrize("correlation", [0.0, 0.4, 0.8])
def test_noise_that_is_slower_than_its_samples_has_no_line_in_time(quiet, correlation):
    """Of 60 sets at 100 Hz; a p of .001 is met in two of them once in 500 tries."""
    data = quiet.fitted.setting.problem.data
    found = 0
    for seed in range(60):
        draw = np.random.default_rng([9, seed])
        white = draw.normal(size=(20, 162))
        noise = 0.01 * lfilter([1.0], [1.0, -correlation], white, axis=1)[:, 50:]
        drawn = quiet.fitted._replace(adhesion=np.asarray(data.adhesion) - noise)
        found += torsion(sampled(quiet._replace(fitted=drawn), 100.0)) is not None
    assert found <= 2
