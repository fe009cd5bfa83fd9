"""Laws that another version saved: read where they mean the same, else refused in one sentence."""

import json

import jax.numpy as jnp
import pytest
from discovery_examples import BASE, HUMIDITY, SLIP_SPEED, law

from adhesion_jax.effects.saved import load_law, save_law
from adhesion_jax.errors import InputError

STEADY = {
    name: jnp.array(value)
    for name, value in (
        ("relative_humidity_pct", 80.0),
        ("vehicle_speed_mps", 20.0),
        ("time_s", 0.0),
    )
}


def saved(folder, **changes):
    """A law of humidity and slip speed in a file, with changes; None takes a key away."""
    path = folder / "law.json"
    save_law(path, law(HUMIDITY, SLIP_SPEED))
    whole = {**json.loads(path.read_text()), **changes}
    path.write_text(json.dumps({k: value for k, value in whole.items() if value is not None}))
    return path


def test_a_law_is_saved_in_format_five(tmp_path):
    assert json.loads(saved(tmp_path).read_text())["format"] == 5


@pytest.mark.parametrize("written", [None, 1, 2, 3, 4, 5])
def test_a_law_of_an_older_format_is_read(tmp_path, written):
    read = load_law(saved(tmp_path, format=written))
    curve, factor = (
        float(value)
        for value in (
            BASE(jnp.array(0.1), {}),
            HUMIDITY.after(jnp.array(1.0), jnp.array(0.1), STEADY) * jnp.exp(-0.0312 * 0.1 * 20),
        )
    )
    assert float(read(jnp.array(0.1), STEADY)) == pytest.approx(curve * factor, rel=1e-12)
    assert factor < 0.95


@pytest.mark.parametrize("written", [None, 1])
def test_effects_whose_formula_has_changed_are_refused_in_format_one(tmp_path, written):
    noise = {"name": "slip_noise", "k": 0.5, "width": 0.4}
    linear = {
        "name": "covariate",
        "k": 0.1,
        "reference": 3.0,
        "scale": 1.0,
        "column": "wind_mps",
    }
    path = saved(tmp_path, format=written, effects=[noise, linear])
    with pytest.raises(InputError) as refused:
        load_law(path)
    assert str(refused.value) == (
        f"{path} is a law of format 1 with slip_noise and covariate, which this version does "
        "not know, or has with another formula or place among the others; find the effects again "
        "with adhesion discover of this version."
    )


def test_a_spline_over_the_range_of_a_column_is_refused(tmp_path):
    spline = {"name": "spline", **{f"k{j}": 0.1 for j in range(1, 6)}, "low": 0.0, "high": 9.0}
    with pytest.raises(InputError, match="a law of format 2 with spline, which this version"):
        load_law(saved(tmp_path, format=2, effects=[{**spline, "column": "wind_mps"}]))


def test_mixed_terms_up_to_the_second_degree_are_refused(tmp_path):
    strengths = {f"k{i}{j}": 0.1 for i in (1, 2) for j in (1, 2)}
    scales = dict.fromkeys(("first_mean", "first_spread", "second_mean", "second_spread"), 1.0)
    columns = {"first": "wind_mps", "second": "relative_humidity_pct"}
    pair = {"name": "interaction", **strengths, **scales, **columns}
    with pytest.raises(InputError, match="a law of format 4 with interaction, which this version"):
        load_law(saved(tmp_path, format=4, effects=[pair]))


@pytest.mark.parametrize(
    "effect",
    [
        {"name": "contact_heating", "k": 0.1},
        {"name": "cleaning", "k": 0.1, "work": 1.0, "load_power": 1.0},
        {"name": "torque_offset", "offset": 0.01},
    ],
    ids=lambda effect: effect["name"],
)
def test_what_has_another_place_among_the_effects_now_is_refused(effect, tmp_path):
    assert len(load_law(saved(tmp_path, format=4, effects=[effect])).effects) == 1
    with pytest.raises(InputError, match=f"a law of format 3 with {effect['name']}, which this"):
        load_law(saved(tmp_path, format=3, effects=[effect]))


def test_a_newer_format_is_refused(tmp_path):
    path = saved(tmp_path, format=6)
    with pytest.raises(InputError) as refused:
        load_law(path)
    assert str(refused.value) == (
        f"{path} is a law of format 6, and this version reads up to 5; use the version that "
        "saved it, or a newer one."
    )


@pytest.mark.parametrize("written", ["two", [2], {}])
def test_a_format_that_is_none_is_no_law(tmp_path, written):
    with pytest.raises(InputError, match="is not a law saved by"):
        load_law(saved(tmp_path, format=written))


def test_a_law_nested_too_deeply_is_no_law(tmp_path):
    path = tmp_path / "law.json"
    path.write_text('{"law":' * 100_000 + "1" + "}" * 100_000)
    with pytest.raises(InputError, match="is not a law saved by"):
        load_law(path)


def test_an_effect_of_width_zero_is_no_effect(tmp_path):
    step = {"name": "threshold", "k": 0.1, "centre": 50.0, "width": 0.0, "reference": 60.0}
    path = saved(tmp_path, effects=[{**step, "column": "relative_humidity_pct"}])
    with pytest.raises(InputError, match="is not a law saved by"):
        load_law(path)
    path = saved(tmp_path, effects=[{**step, "width": 5.0, "column": "relative_humidity_pct"}])
    assert float(load_law(path).effects[0].width) == 5.0
