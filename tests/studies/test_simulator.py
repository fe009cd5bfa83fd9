import itertools

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from lanes import lanes
from scipy.optimize import least_squares

from adhesion_jax.curves import free_values, physical_box, with_free_values
from adhesion_jax.effects import EFFECTS
from adhesion_jax.effects.law import with_effects
from adhesion_jax.errors import InputError
from experiments.campaigns.plantable import PLANTABLE
from experiments.campaigns.runs import BASE_CURVES, DRAWN
from experiments.campaigns.simulator import (
    TABLE_COLUMNS,
    SetNoise,
    simulate,
)
from experiments.discovery_study.otherwise import FORMS, forms_of

#: Columns that a table has only where an effect needs them.
EXTRA = {
    "axle_position": ("axle",),
    "lateral_creep": ("angle_of_attack_deg",),
    "wheel_order": ("wheel_angle_rad",),
    "product": ("gradient_permille",),
    "periodic": ("groove_depth_um",),
}

QUIET = SetNoise(sigma=1e-9, autocorrelation=0.0, run_scatter=0.0)


def base_adhesion(curve, table: pd.DataFrame) -> np.ndarray:
    conditions = {"vehicle_speed_mps": jnp.asarray(table["vehicle_speed_mps"])}
    return np.asarray(curve(jnp.asarray(table["slip_ratio"]), conditions))


def rms(values) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def test_the_same_seed_gives_the_same_bits_and_another_seed_other_ones():
    first, again, other = (simulate(["humidity"], seed=seed) for seed in (3, 3, 4))
    pd.testing.assert_frame_equal(first.train, again.train, check_exact=True)
    pd.testing.assert_frame_equal(first.test, again.test, check_exact=True)
    assert first.train["adhesion"].iloc[0] != other.train["adhesion"].iloc[0]


def test_weather_excitation_noise_and_split_are_those_of_the_seed_whatever_is_planted():
    null = simulate(seed=8, noise=SetNoise(run_scatter=0.0))
    planted = simulate(["patch"], seed=8, noise=SetNoise(run_scatter=0.0))
    others = [name for name in TABLE_COLUMNS if name != "adhesion"]
    pd.testing.assert_frame_equal(null.test[others], planted.test[others], check_exact=True)
    np.testing.assert_allclose(
        null.test["adhesion"] - null.clean, planted.test["adhesion"] - planted.clean, atol=1e-14
    )


@pytest.mark.parametrize("operational", [False, True])
def test_tables_have_the_columns_the_runs_and_sane_values(operational):
    campaign = simulate(seed=5, operational=operational)
    for table, runs in ((campaign.train, 28), (campaign.test, 12)):
        assert tuple(table) == TABLE_COLUMNS
        assert table["run"].nunique() == runs
        assert (table.groupby("run").size() == 200).all()
        np.testing.assert_allclose(table.groupby("run")["time_s"].diff().dropna(), 0.1, atol=1e-6)
        assert np.isfinite(table).all(axis=None)
        assert table["vehicle_speed_mps"].min() > 1
        assert table["slip_ratio"].abs().between(0.004, 0.17).all()
        assert table["curvature_per_m"].abs().max() < 0.01
    both = pd.concat([campaign.train, campaign.test])
    assert set(campaign.train["run"]).isdisjoint(campaign.test["run"])
    assert (both.groupby("run")["slip_ratio"].max() < 0).sum() == 12
    by_run = both.groupby("run").mean()
    load = by_run["normal_load_N"]
    correlation = abs(by_run["temperature_C"].corr(by_run["relative_humidity_pct"]))
    if operational:
        assert load.between(0.95e5, 1.05e5).all()
        assert correlation > 0.9
    else:
        assert np.ptp(load) > 4e4
        assert correlation < 0.5
    relative = both["slip_velocity_mps"] / both["slip_ratio"] / both["vehicle_speed_mps"] - 1
    assert np.std(relative) == pytest.approx(1e-3, rel=0.05)


def test_base_families_take_turns():
    assert [simulate(seed=seed).base for seed in range(4)] == [*BASE_CURVES]


@pytest.mark.parametrize("family", BASE_CURVES)
def test_a_random_curve_has_about_the_level_and_the_peak_asked_for(family):
    curve = DRAWN[family](0.3, 0.03, np.random.default_rng(4).uniform)
    slips = np.linspace(0.0, 0.5, 5001)
    speed = {"vehicle_speed_mps": jnp.full(slips.size, 15.0)}
    along = np.asarray(curve(jnp.asarray(slips), speed))
    assert 0.7 * 0.3 < along.max() < 1.3 * 0.3
    if family == "kiencke":  # the others have their peak where it falls
        assert along.max() == pytest.approx(0.3, rel=1e-6)
        assert slips[along.argmax()] == pytest.approx(0.03, abs=1e-4)


@pytest.mark.parametrize("family", BASE_CURVES)
def test_a_null_set_refitted_by_its_own_base_has_the_stated_noise(family):
    noise = SetNoise(sigma=0.01, autocorrelation=0.5, run_scatter=0.02)
    campaign = simulate(seed=11, base=family, noise=noise)
    assert campaign.visible < 1e-3
    table, law = campaign.train, campaign.curve
    start, measured = np.asarray(free_values(law)), table["adhesion"].to_numpy()

    def residual(values: np.ndarray) -> np.ndarray:
        return base_adhesion(with_free_values(law, jnp.asarray(values)), table) - measured

    bounds = tuple(np.asarray(bound) for bound in physical_box(law))
    fitted = least_squares(residual, start, bounds=bounds, x_scale=start, max_nfev=20)
    left = -fitted.fun.reshape(28, 200)
    level = base_adhesion(law, table).reshape(28, 200)
    # The factor of each run by least squares; what is left of it is the noise in time.
    factor = np.sum(left * level, axis=1) / np.sum(level**2, axis=1)
    error = left - factor[:, None] * level
    assert np.std(error) == pytest.approx(noise.sigma, rel=0.05)
    assert np.mean(error[:, 1:] * error[:, :-1]) / np.var(error) == pytest.approx(0.5, abs=0.03)
    # 28 runs: a standard error of 13 %.
    assert np.std(factor) == pytest.approx(noise.run_scatter, rel=0.35)


@pytest.mark.parametrize(
    ("name", "form"),
    lanes(itertools.product(PLANTABLE, FORMS), always=12, thorough=20),
)
def test_an_effect_changes_adhesion_by_its_strength(name, form):
    sizes = {"strength": 0.2, "noise": QUIET, "runs": 16, "points": 100}
    campaign = simulate([name], seed=1, forms=forms_of(form, [name]), **sizes)
    assert campaign.truth == (name,)
    assert tuple(campaign.train) == (*TABLE_COLUMNS, *EXTRA.get(name, ()))
    both = pd.concat([campaign.train, campaign.test])
    bare = base_adhesion(campaign.curve, both)
    change = both["adhesion"] - bare
    size = np.quantile(np.abs(change), 0.95) / np.quantile(np.abs(bare), 0.95)
    assert size == pytest.approx(0.2, rel=0.1)
    assert campaign.visible * QUIET.sigma > 1e-3


@pytest.mark.parametrize("effects", [["load_slope", "sanding"], ["slip_noise", "patch"], ["lag"]])
def test_the_stated_errors_of_the_test_set_are_recomputed(effects):
    campaign = simulate(effects, seed=6)
    table = campaign.test
    assert campaign.test_rms_noise == pytest.approx(rms(table["adhesion"] - campaign.clean))
    # The base at the measured speed, where the truth has the true one, and only this base has any.
    effect = rms(campaign.clean - base_adhesion(campaign.curve, table))
    assert campaign.test_rms_effect == pytest.approx(effect, rel=1e-3)


def test_exact_effects_are_those_that_a_corrected_law_wears():
    campaign = simulate(["load_slope", "humidity"], seed=10, base="kiencke", noise=QUIET)
    effects = tuple(EFFECTS[name](**campaign.parameters[name]) for name in campaign.truth)
    table = campaign.test
    columns = {name: jnp.asarray(table[name].to_numpy(float)) for name in TABLE_COLUMNS}
    law = with_effects(campaign.curve, effects, columns["slip_ratio"], columns)
    np.testing.assert_allclose(law, campaign.clean, atol=1e-12)


def test_slip_noise_is_white_on_the_slip_signal_and_of_the_stated_size():
    noisy = simulate(["slip_noise"], seed=2, noise=QUIET)
    true = simulate(seed=2, noise=QUIET)
    added = (noisy.train["slip_ratio"] - true.train["slip_ratio"]).to_numpy().reshape(28, 200)
    assert rms(added) == pytest.approx(noisy.parameters["slip_noise"]["sigma"], rel=0.03)
    assert abs(np.mean(added[:, 1:] * added[:, :-1])) < 0.05 * np.var(added)
    np.testing.assert_allclose(noisy.train["adhesion"], true.train["adhesion"], atol=1e-7)


def test_two_effects_at_once_have_both_parameters():
    campaign = simulate(["humidity", "patch"], seed=9, operational=True)
    assert set(campaign.parameters) == {"humidity", "patch"}
    alone = simulate(["patch"], seed=9, operational=True)
    assert campaign.parameters["patch"] == alone.parameters["patch"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"effects": ["humidty"]}, "no way to plant 'humidty'; known are speed, slip_speed"),
        ({"effects": ["speed", "speed"]}, "name each once"),
        ({"base": "pacejka"}, "auto, burckhardt"),
        ({"strength": 2.0}, "not between 0 and 1"),
        ({"noise": SetNoise(sigma=0.0)}, "sigma above 0"),
        ({"noise": SetNoise(autocorrelation=1.0)}, "below 1"),
        ({"runs": 3}, "at least 4 runs"),
    ],
)
def test_what_is_not_known_is_refused_in_one_sentence(arguments, said):
    with pytest.raises(InputError, match=said):
        simulate(**{"effects": [], "seed": 0, **arguments})
