"""A plan from one's own log: 12 simulated runs on common rail that end before the peak is clear."""

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from matplotlib.image import imread

import adhesion_jax as aj
from adhesion_jax.command_line.plan import main
from adhesion_jax.effects.conditions import Calendar
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.errors import InputError
from adhesion_jax.inference.noise import RunNoise
from adhesion_jax.planning.plan import Planner, again
from adhesion_jax.planning.truth import Truth
from adhesion_jax.scenarios.rails import RAILS

NOISE = RunNoise(0.004, autocorrelation=0.7, run_scatter=0.01)
RUNS, POINTS, LARGEST = 12, 200, 0.25


def log_of(noise, generator):
    """Runs that sweep the slip up to `LARGEST`, sampled at 10 Hz."""
    slip = np.tile(np.linspace(0.0, LARGEST, POINTS), RUNS)
    error = generator.standard_normal((RUNS, POINTS))
    for k in range(1, POINTS):
        fresh = np.sqrt(1 - noise.autocorrelation**2)
        error[:, k] = noise.autocorrelation * error[:, k - 1] + fresh * error[:, k]
    level = 1 + noise.run_scatter * generator.standard_normal((RUNS, 1))
    clean = 0.32 * (1 - np.exp(-25 * slip)) - 0.1 * slip
    return pd.DataFrame(
        {
            "run": np.repeat(np.arange(RUNS), POINTS),
            "time_s": 0.1 * np.arange(RUNS * POINTS),
            "slip_ratio": slip,
            "adhesion": (clean.reshape(RUNS, POINTS) * level + noise.sigma * error).ravel(),
        }
    )


@pytest.fixture(scope="module")
def found():
    log = log_of(NOISE, np.random.default_rng(3))
    return aj.plan(aj.identify(log, "burckhardt"), want=0.001)


@pytest.mark.thorough
def test_the_log_is_placed_where_its_truth_is(found):
    """The errors of the fitted curve and noise are those of the true ones, to a quarter."""
    starts, slip = POINTS * np.arange(RUNS), np.tile(np.linspace(0.0, LARGEST, POINTS), RUNS)
    settled = Planner(Truth(RAILS["common"], {}), NOISE, again(slip, starts))
    truth = settled.present(LARGEST, RUNS * POINTS, RUNS)
    assert (found.present.samples, found.present.runs) == (RUNS * POINTS, RUNS)
    assert found.present.largest_slip == LARGEST
    np.testing.assert_allclose(found.present.errors, truth.errors, rtol=0.35)
    noise = found.plan.planner.noise
    assert noise.autocorrelation == pytest.approx(0.7, abs=0.06)
    assert noise.sigma == pytest.approx(0.004, rel=0.1)


@pytest.mark.thorough
def test_the_answer_says_what_halves_the_intervals(found):
    said = " ".join(found.verdict.split())
    assert "To halve the 95 % interval of mu_max (now 0.2" in said
    assert "take four times as many samples at the same slips (48 runs like these)" in said
    assert "What was not stated is that of the fit to the log." in said
    assert "Samples: those of the log (2,400 in 12 runs, up to slip 0.25)" in said
    further = found.present.further[1]
    assert f"or go on to a slip of {further:.2g} instead of 0.25 with as many." in said
    # The tables hold the present place, and four times as many samples.
    table = found.table.set_index(["largest_slip", "samples"])
    place = table.loc[(LARGEST, 2400)]
    assert place["mu_max_relative_se"] == pytest.approx(found.present.errors[0])
    assert table.loc[(LARGEST, 9600), "mu_max_relative_se"] == pytest.approx(
        found.present.errors[0] / 2
    )


@pytest.mark.thorough
def test_what_is_stated_of_the_noise_takes_the_place_of_what_is_found(found):
    log = log_of(NOISE, np.random.default_rng(3))
    stated = aj.plan(aj.identify(log, "burckhardt"), sigma=0.008, run_scatter=0.0)
    noise = stated.plan.planner.noise
    assert (noise.sigma, noise.run_scatter) == (0.008, 0.0)
    assert noise.autocorrelation == found.plan.planner.noise.autocorrelation


@pytest.mark.thorough
@pytest.mark.parametrize("fastest", [5.0, 20.0])
def test_the_noise_of_the_wheel_speed_is_stated_as_to_identify(fastest):
    log = log_of(NOISE, np.random.default_rng(3))
    speed = np.where(log["run"] < 6, 5.0, fastest)
    fitted = aj.identify(log.assign(vehicle_speed_mps=speed), "burckhardt", slip_noise=0.02)
    as_fitted, as_stated = aj.plan(fitted), aj.plan(fitted, slip_noise=0.02)
    spread = 0.02 * np.sqrt(np.mean(speed**-2.0))
    for one in (as_fitted, as_stated):
        assert one.plan.planner.noise.slip_noise == pytest.approx(spread, rel=1e-3)


def test_a_log_without_time_is_said_to_be_taken_as_independent():
    log = log_of(NOISE, np.random.default_rng(3)).drop(columns="time_s")
    planned = aj.plan(aj.identify(log, "burckhardt"))
    assert planned.plan.planner.noise.autocorrelation == 0
    assert "has no column time_s" in " ".join(planned.verdict.split())


@pytest.mark.thorough
def test_a_log_whose_curves_have_no_peak_is_refused():
    log = log_of(NOISE, np.random.default_rng(3))
    with pytest.raises(InputError, match="has a peak"):
        aj.plan(aj.identify(log, "polach"))


def points(place, low, high, column="slip_ratio"):
    """300 points of .6 x / (1 + x^2), x the slip over that of the peak, with noise of .01."""
    draw = np.random.default_rng(0)
    slip = draw.uniform(low * place, high * place, 300)
    adhesion = 0.6 * (slip / place) / (1 + (slip / place) ** 2) + draw.normal(0, 0.01, 300)
    return aj.identify(pd.DataFrame({column: slip, "adhesion": adhesion}), "kiencke")


@pytest.mark.parametrize(("low", "high"), [(0.7, 3.0), (0.0, 0.6)])
def test_a_log_without_an_answer_is_refused_for_the_reason_of_identify(low, high):
    found = points(0.03, low, high)
    with pytest.raises(InputError) as refused:
        aj.plan(found)
    why = " ".join(found.vetoes) or found.judgement.why
    assert why
    assert str(refused.value).startswith(f"{why} So there is no mu_max to plan for")


def test_a_log_of_a_wheel_that_spins_is_planned():
    planned = aj.plan(points(0.3, 0.0, 5.0))
    assert planned.present.largest_slip > 1.4
    assert planned.plan.planner.peak.slip_opt == pytest.approx(0.3, rel=0.03)


@pytest.mark.parametrize("place", [0.5, 1.5])
def test_a_law_of_the_slip_velocity_is_saved_as_one(place, tmp_path):
    points(place, 0.0, 4.0, "slip_velocity_mps").write(tmp_path)
    planned = aj.plan(aj.load_law(tmp_path / "law.json"))
    assert planned.plan.planner.peak.slip_opt == pytest.approx(place, rel=0.03)
    assert f"at slip {planned.plan.planner.peak.slip_opt:.4g} m/s" in planned.verdict
    assert planned.table["largest_slip"].max() == pytest.approx(4 * place, rel=0.05)


@pytest.mark.thorough
def test_the_files(found, tmp_path):
    found.write(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        "plan.csv",
        "plan.txt",
        "plan.png",
        "wanted.csv",
    }
    table = pd.read_csv(tmp_path / "plan.csv")
    assert len(table) == found.plan.errors[..., 0].size
    wanted = pd.read_csv(tmp_path / "wanted.csv")
    assert (wanted["mu_max_relative_se"] == 0.001).all()
    image = imread(tmp_path / "plan.png")
    assert image.shape[0] > 700
    assert image.std() > 0.05
    assert "pre-wrap" in found._repr_html_()


def answer(*arguments):
    return CliRunner().invoke(main, [*map(str, arguments)])


@pytest.mark.thorough
def test_the_command_plans_a_rail_and_a_law(tmp_path):
    size = ["--largest-slips", "0.1:0.4:3", "--samples", "100:1000:2"]
    told = answer("--rail", "common", *size, "--want", "1%", "--out", tmp_path / "rail")
    assert told.exit_code == 0, told.output
    rail = pd.read_csv(tmp_path / "rail" / "plan.csv")
    assert sorted(rail["samples"].unique()) == [100, 1000]
    assert "A standard error of 1.0 % of mu_max" in " ".join(told.output.split())
    law = CorrectedLaw(RAILS["common"], (), {}, Calendar("time_s", 0.0, 1.0))
    aj.save_law(tmp_path / "law.json", law)
    told = answer("--law", tmp_path / "law.json", *size, "--out", tmp_path / "law")
    assert told.exit_code == 0, told.output
    under = pd.read_csv(tmp_path / "law" / "plan.csv")
    np.testing.assert_allclose(under["mu_max_relative_se"], rail["mu_max_relative_se"], rtol=1e-4)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "Name one of LOG, --rail and --law."),
        (["eurosprinter", "--rail", "dry"], "not LOG and --rail together"),
        (["--rail", "icy"], "--rail icy is not known; name one of dry, common or wet."),
        (["--rail", "dry", "--curve", "kiencke"], "--curve goes with LOG, not with --rail"),
        (["--rail", "dry", "--want", "1"], "--want 1 is no share; write it as 1% or 0.01"),
        (["--rail", "dry", "--samples", "9:3"], "--samples 9:3 is no range; write LOW:HIGH"),
        (["--rail", "dry", "--samples", "many"], "--samples many is no range"),
        (["--rail", "dry", "--largest-slips", "0.1:0.2:1"], "is no range"),
        (["--rail", "dry", "--largest-slips", "0.1:0.2:3:4"], "is no range"),
        (["--rail", "dry", "--samples", "100:200:2:"], "is no range"),
        (["--rail", "dry", *2 * ["--condition", "a=1"]], "--condition a is given twice; name one"),
        (["--rail", "dry", "--condition", "speed"], "--condition speed is no condition"),
        (["eurosprinter", "--samples-per-run", "9"], "--samples-per-run does not go with LOG"),
        (["missing.csv"], "missing.csv does not exist"),
    ],
)
def test_the_command_refuses_in_one_sentence(arguments, says, tmp_path):
    out = tmp_path / "out"
    told = answer(*arguments, "--out", out)
    assert isinstance(told.exception, InputError)
    assert says in str(told.exception)
    assert not out.exists()
