"""A law with effects as a scenario: what it costs an identifier to know the curve alone."""

import functools
import json
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest

from adhesion_jax.campaign.config import Config, build_scenario
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.command_line.command import run
from adhesion_jax.command_line.montecarlo import main
from adhesion_jax.curves.burckhardt import Burckhardt
from adhesion_jax.curves.polach import Polach, PolachFalling
from adhesion_jax.effects import EFFECTS, Covariate
from adhesion_jax.effects.conditions import Calendar
from adhesion_jax.effects.humidity import Humidity
from adhesion_jax.effects.law import CorrectedLaw
from adhesion_jax.effects.saved import save_law
from adhesion_jax.effects.wheel_order import WheelOrder
from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import IDENTIFIERS, identify
from adhesion_jax.library import montecarlo
from adhesion_jax.report.montecarlo import figures
from adhesion_jax.scenarios import SCENARIOS, Options, build, needs_options
from experiments.regression.accuracy import homes

DRY = Burckhardt(c1=0.8287, c2=45.45, c3=0.4)
STRENGTH = -0.2
HUMIDITY = Humidity(k=STRENGTH, centre=50.0, width=150.0, reference=50.0)
HUMID = {"relative_humidity_pct": (30.0, 90.0)}
ORDER = Calendar("run_order", 0.0, 59.0)
FIVE_DAYS = Calendar("time_s", 0.0, 432000.0)

#: Every measured column that an effect of the catalogue rests on.
RANGES = {
    "vehicle_speed_mps": (7.0, 23.0),
    "normal_load_N": (65e3, 130e3),
    "temperature_C": (-3.0, 32.0),
    "relative_humidity_pct": (25.0, 98.0),
    "position_m": (0.0, 900.0),
    "curvature_per_m": (-1e-3, 1e-3),
    "acceleration_mps2": (-0.2, 0.2),
    "lateral_measure": (-0.02, 0.02),
    "sanding": (0.0, 1.0),
    "axle": (0.0, 3.0),
    "campaign_time": (0.0, 1.0),
    "rail_age_days": (1.0, 200.0),
}


# Without optimisation: programs that are run once.
quick_jit = functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})


def bound_of(scenario, record):
    return quick_jit(lambda record: scenario.bound(record))(record)


def saved(folder, *effects, curve=DRY, ranges=HUMID, calendar=ORDER):
    path = folder / "law.json"
    save_law(path, CorrectedLaw(curve, effects, ranges, calendar))
    return path


def options(folder, *effects, points=None, sigma=None, **law):
    return Options(law=saved(folder, *effects, **law).read_text(), points=points, sigma=sigma)


def loss():
    """Mean and mean square of f - 1, mu = f mu_base, over humidity uniform in its range."""
    humidity = np.linspace(30.0, 90.0, 20001)
    factor = STRENGTH * np.tanh((humidity - 50) / 150) / np.tanh(50 / 150)
    return np.trapezoid([factor, factor**2], humidity) / 60


def summary_of(config, workers):
    frames = []
    campaign = run_campaign(config, frames.append, lambda _: None, workers)
    return campaign.tables["summary"].set_index("quantity"), pd.concat(frames, ignore_index=True)


@pytest.fixture(scope="module")
def humid(tmp_path_factory):
    """A campaign, its summary by quantity, its estimates and those that two workers find."""
    chosen = options(tmp_path_factory.mktemp("law"), HUMIDITY, points=60)
    config = Config("corrected", ("ml-exact",), chosen, runs=200)
    return config, *summary_of(config, workers=1), summary_of(config, workers=2)[1]


@pytest.mark.thorough
def test_who_ignores_humidity_is_wrong_by_what_it_takes(humid):
    """A factor on Burckhardt's curve is a factor on c1 and c3, and so on mu_max alone."""
    row, peak = humid[1].loc["mu_max"], humid[1].loc["slip_opt"]
    top = float(DRY.peak({}).adhesion)
    assert row["truth"] == pytest.approx(top, rel=1e-12)
    mean, square = loss()
    assert row["bias"] == pytest.approx(mean * top, abs=4 * row["bias_se"])
    assert row["bias"] < -4 * row["bias_se"]
    expected = np.hypot(np.sqrt(square) * top, row["crlb"])
    assert row["rmse"] == pytest.approx(expected, abs=4 * row["rmse_se"])
    assert row["rmse_over_crlb"] > 20
    assert row["coverage95"] < 0.2
    assert abs(peak["bias"]) < 4 * peak["bias_se"]
    assert peak["coverage95"] == pytest.approx(0.95, abs=4 * np.sqrt(0.95 * 0.05 / 200))
    assert humid[1]["failure_share"].eq(0).all()


@pytest.mark.thorough
def test_without_effects_it_is_a_single_block(tmp_path):
    scenario = build("corrected", options(tmp_path))
    single = build("single")
    key = jax.random.key(2)
    bound = bound_of(scenario, scenario.draw(key))
    np.testing.assert_allclose(bound, bound_of(single, single.draw(key)), rtol=1e-9)
    silent = build("corrected", options(tmp_path, sigma=0.0))
    clean = build("single", Options(sigma=0.0)).draw(key).adhesion
    np.testing.assert_allclose(silent.draw(key).adhesion, clean, atol=1e-15)
    truth = single.quantities()
    for name, value in scenario.quantities().items():
        np.testing.assert_allclose(value, truth[name], rtol=1e-12)

    @quick_jit
    @jax.vmap
    def identified(key):
        found = identify(IDENTIFIERS["ml-exact"], scenario.known, scenario.draw(key), key)
        return jnp.stack([*found.values.values()]), found.covariance

    values, covariance = identified(jax.random.split(key, 300))
    error = np.asarray(values)[..., 0] - np.concatenate(list(truth.values()))
    claimed = np.sqrt(np.diagonal(np.asarray(covariance)[:, 0], axis1=1, axis2=2))
    deviation = np.asarray(bound)[0]
    assert np.all(np.abs(error.mean(axis=0)) < 4 * deviation / np.sqrt(300))
    efficiency = np.sqrt(np.mean(error**2, axis=0)) / deviation
    assert np.all(np.abs(efficiency - 1) < 4 / np.sqrt(2 * 300))
    covered = np.mean(np.abs(error) < 1.965 * claimed, axis=0)
    assert np.all(np.abs(covered - 0.95) < 4 * np.sqrt(0.95 * 0.05 / 300))


def test_the_bound_knows_the_conditions(tmp_path):
    """With a factor f on the whole curve the information on its parameters is f^2 as large."""
    scenario = build("corrected", options(tmp_path, HUMIDITY))
    plain = build("single")
    record = scenario.draw(jax.random.key(1))
    (humidity,) = np.unique(record.conditions["relative_humidity_pct"])
    factor = 1 + STRENGTH * np.tanh((humidity - 50) / 150) / np.tanh(50 / 150)
    alone = np.asarray(bound_of(plain, plain.draw(jax.random.key(1))))
    np.testing.assert_allclose(bound_of(scenario, record), alone / factor, rtol=1e-9)


def test_conditions_are_those_of_one_operating_point_a_run(tmp_path):
    scenario = build("corrected", options(tmp_path, ranges=RANGES, calendar=FIVE_DAYS))
    keys = jax.random.split(jax.random.key(0), 400)
    columns = {k: np.asarray(v) for k, v in jax.vmap(scenario.excitation.conditions)(keys).items()}
    for name, (low, high) in RANGES.items():
        values = columns[name]
        assert values.min() >= low
        assert values.max() <= high
        middle = 4 * (high - low + (name == "axle")) / np.sqrt(12 * 400)
        assert values.mean() == pytest.approx((low + high) / 2, abs=middle)
        assert (np.ptp(values, axis=1) > 0).any() == (name == "position_m")
    assert set(np.unique(columns["axle"])) == {0.0, 1.0, 2.0, 3.0}
    time, speed = columns["time_s"], columns["vehicle_speed_mps"]
    np.testing.assert_allclose(np.diff(time, axis=1), 0.1, atol=1e-9)
    assert time[:, 0].std() == pytest.approx(432000 / np.sqrt(12), rel=0.1)
    # The position moves at the vehicle speed but where it turns back.
    way = np.abs(np.diff(columns["position_m"], axis=1)) / (0.1 * speed[:, 1:])
    assert np.mean(np.isclose(way, 1.0)) > 0.99
    angle = np.diff(columns["wheel_angle_rad"], axis=1) * 0.46
    slip = np.linspace(0, 0.2, 500)[1:]
    np.testing.assert_allclose(angle, 0.1 * speed[:, 1:] * (1 + slip), rtol=1e-9)


@pytest.mark.thorough
def test_every_effect_of_the_catalogue_acts(tmp_path):
    flat = {name: np.linspace(*ends, 50) for name, ends in {**RANGES, "time_s": (0, 5)}.items()}
    effects = [kind.starts(flat)[0] for kind in EFFECTS.values()]
    age = Covariate(k=0.1, reference=100.0, scale=60.0, column="rail_age_days")
    chosen = options(tmp_path, *effects, age, ranges=RANGES, calendar=FIVE_DAYS)
    scenario = build("corrected", chosen)
    record = scenario.draw(jax.random.key(0))
    assert np.isfinite(record.adhesion).all()
    bound = bound_of(scenario, record)
    assert np.isfinite(bound).all()
    assert (np.asarray(bound) > 0).all()


@pytest.mark.slow
def test_a_curve_that_falls_with_speed_has_its_peak_at_the_middle_of_the_speeds(tmp_path):
    curve = PolachFalling(mu0=0.55, a=0.4, b=0.6, stiffness=150.0, k_s=0.4)
    ranges = {"vehicle_speed_mps": (10.0, 30.0)}
    scenario = build("corrected", options(tmp_path, curve=curve, ranges=ranges, sigma=0.0))
    fine = curve(jnp.linspace(0.0, 0.2, 20001), {"vehicle_speed_mps": 20.0})
    assert scenario.quantities()["mu_max"] == pytest.approx(float(jnp.max(fine)), rel=1e-6)
    record = scenario.draw(jax.random.key(3))
    slip, speed = record.slip[0], record.conditions["vehicle_speed_mps"][0]
    np.testing.assert_allclose(
        record.adhesion[0], curve(slip, {"vehicle_speed_mps": speed}), atol=1e-12
    )
    # A figure has a panel for each of its parameters, mu_max and the error of mu_max.
    truth = pd.DataFrame(scenario.quantities()).assign(block=0)
    found = truth.melt("block", var_name="quantity", value_name="median")
    bands = found.assign(p05=found["median"], p95=found["median"], identifier="lm-optimistix")
    axes = figures.tracking(truth, bands).axes
    assert len(axes) == len(truth.columns) - 1
    # What is told is enough to find the run again.
    told = scenario.known.curve(slip, {name: v[0] for name, v in record.conditions.items()})
    np.testing.assert_allclose(told, record.adhesion[0], atol=1e-12)
    assert np.all(scenario.known.lower < scenario.known.upper)


def test_the_slope_of_a_law_is_no_question(tmp_path):
    reason = IDENTIFIERS["rls-slope"].accepts(build("corrected", options(tmp_path)).known)
    assert reason is not None


def test_a_law_is_asked_for_here_alone(tmp_path):
    law = saved(tmp_path, HUMIDITY).read_text()
    for name in SCENARIOS:
        if needs_options(name):
            continue
        with pytest.raises(InputError, match="--law does not go with"):
            build_scenario(Config(name, options=Options(law=law)))
    assert {config.scenario for config in homes({}).values()} == set()


def broken(law, path, value):
    """The text of a law with one entry changed."""
    saved = json.loads(law)
    *before, last = path
    place = saved
    for step in before:
        place = place[step]
    place[last] = value
    return json.dumps(saved)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("curve", "name"), "moon"),
        (("curve", "c1"), "much"),
        (("curve", "c1"), float("nan")),
        (("curve", "free"), ["c9"]),
        (("curve", "free"), []),
        (("effects", 0, "name"), "magic"),
        (("effects", 0, "k"), None),
        (("ranges",), [1.0]),
        (("ranges", "relative_humidity_pct"), [90.0, 30.0]),
        (("calendar",), {"column": "time_s"}),
    ],
)
def test_what_is_no_law_is_refused(tmp_path, path, value):
    law = saved(tmp_path, HUMIDITY).read_text()
    with pytest.raises(InputError, match="is not a law saved by"):
        build("corrected", Options(law=broken(law, path, value)))


def test_laws_that_nothing_can_be_identified_of_are_refused(tmp_path):
    without_peak = options(tmp_path, curve=Polach(mu0=0.3, stiffness=100.0))
    with pytest.raises(InputError, match="has no peak"):
        build("corrected", without_peak)
    with pytest.raises(InputError, match="rests on relative_humidity_pct and has no range"):
        build("corrected", options(tmp_path, HUMIDITY, ranges={}))
    wave = WheelOrder(0.03, 0.03, 0.0, 0.0, order=1.0)
    with pytest.raises(InputError, match="rests on wheel_angle_rad"):
        build("corrected", options(tmp_path, wave))


def test_the_command_refuses_in_one_sentence(tmp_path, monkeypatch, capsys):
    law = saved(tmp_path, HUMIDITY)
    noise = tmp_path / "noise.json"
    noise.write_bytes(b"\xff\xfe\x00")
    for arguments, words in (
        (("--scenario", "corrected"), "needs --law"),
        (("--scenario", "corrected", "--law", tmp_path / "none.json"), "none.json cannot be read"),
        (("--scenario", "corrected", "--law", tmp_path), "cannot be read"),
        (("--scenario", "corrected", "--law", noise), "no text"),
        (("--scenario", "corrected", "--law", law, "--rail", "wet"), "--rail"),
        (("--scenario", "corrected", "--law", law, "--blocks", "2"), "--blocks"),
        (("--scenario", "single", "--law", law), "--law does not go with --scenario single"),
        (("--law", law), "--law does not go with"),
        (
            ("--scenario", "corrected", "--law", law, "--identifiers", "riv"),
            "riv cannot be run on corrected: ",
        ),
    ):
        given = ["montecarlo", *map(str, arguments), "--out", str(tmp_path / "out")]
        monkeypatch.setattr(sys, "argv", given)
        with pytest.raises(SystemExit) as stopped:
            run(main)
        assert stopped.value.code == 2
        lines = capsys.readouterr().err.strip().splitlines()
        assert len(lines) == 1, lines
        assert words in lines[0]
        assert lines[0].endswith(".")


@pytest.mark.thorough
def test_two_workers_find_what_one_does(humid):
    pd.testing.assert_frame_equal(humid[2], humid[3], check_exact=True)


@pytest.mark.thorough
def test_the_metadata_hold_the_law(humid):
    config = humid[0]
    kept = json.loads(json.dumps(montecarlo._config(config, [config])))
    assert kept["options"]["law"] == json.loads(config.options["law"])
    assert kept["options"]["law"]["effects"][0]["k"] == STRENGTH
    assert montecarlo._config(Config(), [Config("single")])["options"] == {}


def test_no_other_job_loads_the_discovery():
    words = "import sys, adhesion_jax.library.montecarlo; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", words],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
        check=True,
        timeout=120,
    )
    assert "adhesion_jax.scenarios.catalogue" in done.stdout
    assert "adhesion_jax.discovery" not in done.stdout
