"""What terms of columns make of a curve, against its formulas written out."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from discovery_campaigns import SIZE, setting_of
from scipy.signal import lfilter

from adhesion_jax.curves import BASES, CURVES
from adhesion_jax.curves.bent import Bent
from adhesion_jax.curves.polach import PolachFalling
from adhesion_jax.discovery.model.fitting import fit_model, in_order, raw_changes
from adhesion_jax.discovery.model.packing import base_curve
from adhesion_jax.effects import EFFECTS, KINDS, Covariate, kind_of
from adhesion_jax.effects.conditions import Calendar
from adhesion_jax.effects.law import CorrectedLaw, with_effects
from adhesion_jax.effects.one_column import Spline
from adhesion_jax.effects.saved import load_law, save_law
from adhesion_jax.effects.shape import ACTS_ON, prior_precision
from adhesion_jax.errors import InputError
from experiments.campaigns.simulator import simulate

C1, C2, C3 = 0.35, 90.0, 0.5
MU0, A, B, STIFFNESS, K_S = 0.5, 0.4, 0.6, 90.0, 0.4
SPEED = 14.0


def burckhardt(slip):
    size = np.abs(slip)
    return np.sign(slip) * (C1 * (1 - np.exp(-C2 * size)) - C3 * size)


def polach(slip):
    size = np.abs(slip)
    friction = MU0 * ((1 - A) * np.exp(-B * size * SPEED) + A)
    e = np.pi * STIFFNESS * size / (4 * friction)
    return np.sign(slip) * 2 * friction / np.pi * (e / (1 + e**2) + np.arctan(K_S * e))


LAWS = {
    "burckhardt": (burckhardt, dataclasses.replace(CURVES["burckhardt"], c1=C1, c2=C2, c3=C3)),
    "polach": (polach, PolachFalling(mu0=MU0, a=A, b=B, stiffness=STIFFNESS, k_s=K_S)),
}

BELOW_EFFECTS = np.linspace(0.0, 1.0, 1_000_001)

#: The column z of each point and its g = .4 (z - 3)/2.
Z = np.array([3.0, 4.5, -2.0, 7.0])
G = 0.2 * (Z - 3)


def term(acts_on, k=0.4):
    return Covariate(k, 3.0, 2.0, column="z", acts_on=acts_on)


_with_effects = jax.jit(with_effects)


def worn(law, effects, slip, z):
    slip, z = jnp.asarray(slip), jnp.asarray(z)
    conditions = {"z": z, "vehicle_speed_mps": SPEED * jnp.ones_like(z)}
    return np.asarray(_with_effects(law, tuple(effects), slip, conditions))


def by_hand(curve, acts_on, slip, g):
    peak = curve(BELOW_EFFECTS).argmax()
    place, top = BELOW_EFFECTS[peak], curve(BELOW_EFFECTS[peak])
    match acts_on:
        case "level":
            return curve(slip) * np.exp(g)
        case "slip":
            return curve(slip * np.exp(g))
        case "offset":
            return curve(slip) + g
        case "shift":
            return curve(slip + g)
        case _:
            beyond = np.abs(slip) > place
            fallen = np.sign(slip) * (top - (top - np.abs(curve(slip))) * np.exp(g))
            return np.where(beyond, fallen, curve(slip))


@pytest.mark.parametrize("acts_on", ACTS_ON)
@pytest.mark.parametrize("name", LAWS)
def test_a_term_bends_the_curve_as_its_formula_says(name, acts_on):
    curve, law = LAWS[name]
    # A tenth of g is much for an offset, or a shift of the slip.
    share = 0.1 if acts_on in ("offset", "shift") else 1.0
    slip, g = (part.ravel() for part in np.meshgrid(np.linspace(-0.3, 0.3, 401), share * G))
    z = np.broadcast_to(Z[:, None], (4, 401)).ravel()
    found = worn(law, [term(acts_on, 0.4 * share)], slip, z)
    expected = by_hand(curve, acts_on, slip, g)
    # The peak is found on a grid of slips: to 1e-4 of adhesion, the others to rounding.
    atol = 1e-4 * curve(BELOW_EFFECTS).max() if acts_on == "fall" else 1e-14
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=atol)
    changed = np.abs(found - curve(slip)).max()
    assert changed > 0.02


@pytest.mark.parametrize("name", LAWS)
def test_a_fall_begins_at_the_peak_and_without_a_kink(name):
    curve, law = LAWS[name]
    place = BELOW_EFFECTS[curve(BELOW_EFFECTS).argmax()]
    slip = np.linspace(0.3 * place, 4 * place, 4001)
    bare = curve(slip)
    for z in Z:
        found = worn(law, [term("fall")], slip, np.full(slip.size, z))
        below = slip < 0.98 * place
        np.testing.assert_allclose(found[below], bare[below], rtol=1e-12)
        # Derivatives by finite differences: no jump beyond what the curve itself bends by.
        step = slip[1] - slip[0]
        slope, own = np.diff(found) / step, np.diff(bare) / step
        steep = curve(1e-6) / 1e-6
        assert np.abs(np.diff(slope)).max() < 3 * np.abs(np.diff(own)).max() + 2e-3 * steep
        assert np.abs(np.diff(found)).max() < 3 * np.abs(np.diff(bare)).max()


@pytest.mark.slow
@pytest.mark.parametrize("acts_on", ACTS_ON)
@pytest.mark.parametrize("name", LAWS)
def test_derivatives_of_a_bent_curve_are_those_of_finite_differences(name, acts_on):
    law = LAWS[name][1]
    slip, z = jnp.array([0.004, 0.02, 0.11, -0.2]), jnp.array([1.0, 5.0, 6.0, -1.0])
    conditions = {"z": z, "vehicle_speed_mps": SPEED * jnp.ones(4)}
    k = 0.005 if acts_on == "shift" else 0.4
    free = jnp.array([float(getattr(law, field)) for field in law.free] + [k])

    def adhesion(values):
        curve = dataclasses.replace(law, **dict(zip(law.free, values[:-1], strict=True)))
        return with_effects(curve, (term(acts_on, values[-1]),), slip, conditions)

    found = np.asarray(jax.jacfwd(adhesion)(free))
    for place in range(free.size):
        step = 1e-5 * free[place]
        moved = step * np.eye(free.size)[place]
        expected = np.asarray((adhesion(free + moved) - adhesion(free - moved)) / (2 * step))
        size = np.abs(expected).max()
        # Of the place of the peak there is no derivative: there the curve is flat, to the grid.
        tolerance = 2e-2 if acts_on == "fall" else 1e-6
        np.testing.assert_allclose(found[:, place], expected, atol=tolerance * size)


@pytest.mark.parametrize("acts_on", ACTS_ON)
@pytest.mark.parametrize("name", [*LAWS, "rising", "level"])
def test_without_strength_a_law_is_left_as_it_is(name, acts_on):
    law = {**{key: pair[1] for key, pair in LAWS.items()}, "rising": CURVES["polach"]}.get(
        name, BASES["level"]
    )
    slip = jnp.linspace(-0.3, 0.3, 41)
    conditions = {"vehicle_speed_mps": jnp.full(41, SPEED)}
    bare = np.asarray(law(slip, conditions))
    found = worn(law, [term(acts_on, 0.0)], slip, np.linspace(-9, 9, 41))
    np.testing.assert_allclose(found, bare, rtol=1e-13, atol=1e-15)


def test_a_curve_without_a_peak_is_left_alone_by_its_fall():
    slip, law = jnp.linspace(-0.4, 0.4, 81), CURVES["polach"]
    # To the last bit, so neither is compiled whole.
    found = with_effects(law, (term("fall", 2.0),), slip, {"z": jnp.linspace(-9, 9, 81)})
    np.testing.assert_array_equal(found, law(slip, {}))


def test_terms_that_act_on_the_same_add_up_and_the_parts_of_the_curve_are_apart():
    curve, law = LAWS["burckhardt"]
    slip, z = np.linspace(0.002, 0.3, 60), np.linspace(-2, 6, 60)
    twice = worn(law, [term("slip", 0.1), term("slip", 0.25)], slip, z)
    np.testing.assert_allclose(twice, worn(law, [term("slip", 0.35)], slip, z), rtol=1e-12)
    found = worn(law, [term("level", 0.1), term("fall", 0.3), term("slip", -0.2)], slip, z)
    g = (z - 3) / 2
    bent = by_hand(curve, "fall", slip * np.exp(-0.2 * g), 0.3 * g)
    np.testing.assert_allclose(found, bent * np.exp(0.1 * g), atol=1e-4 * C1)
    # The slip is scaled before it is shifted, and an offset is not scaled with the level.
    all_but_fall = [
        term("level", 0.1),
        term("shift", 0.02),
        term("slip", -0.2),
        term("offset", 0.03),
    ]
    found = worn(law, all_but_fall, slip, z)
    expected = curve(slip * np.exp(-0.2 * g) + 0.02 * g) * np.exp(0.1 * g) + 0.03 * g
    np.testing.assert_allclose(found, expected, rtol=1e-12)


FACTORS, BRAKING = np.random.default_rng(4).normal(0, 0.1, (2, 16))


def departing(braking=BRAKING):
    return Bent(LAWS["burckhardt"][1], FACTORS, 0.01, 0.2, braking)


def departure(slip, factors):
    """Of those factors, term by term, held beyond the largest slip."""
    u = np.log1p(np.minimum(np.abs(slip), 0.2) / 0.01) / np.log1p(0.2 / 0.01)
    return sum(factor * np.sin(np.pi * (j - 0.5) * u) for j, factor in enumerate(factors, 1))


def test_a_curve_departs_from_its_form_otherwise_in_braking():
    slip = np.linspace(-0.3, 0.3, 301)
    found = np.asarray(departing()(jnp.asarray(slip), {}))
    factors = np.where(slip[:, None] < 0, FACTORS + BRAKING, FACTORS)
    expected = burckhardt(slip) * (1 + departure(slip, factors.T))
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    assert np.abs(found + found[::-1]).max() > 0.01
    alike = np.asarray(departing(None)(jnp.asarray(slip), {}))
    np.testing.assert_allclose(alike, burckhardt(slip) * (1 + departure(slip, FACTORS)), rtol=1e-12)
    # Nothing departs at slip zero, where the curve keeps its slope.
    ends = np.asarray(departing()(jnp.array([-1e-8, 1e-8]), {}))
    np.testing.assert_allclose(ends / 1e-8, [-(C1 * C2 - C3), C1 * C2 - C3], rtol=1e-4)


@pytest.mark.parametrize("braking", [None, BRAKING])
def test_a_departure_is_saved_with_the_law(tmp_path, braking):
    law = CorrectedLaw(departing(braking), (), {}, Calendar("time_s", 0.0, 1.0))
    save_law(tmp_path / "law.json", law)
    loaded = load_law(tmp_path / "law.json")
    slip = jnp.linspace(-0.3, 0.3, 61)
    np.testing.assert_array_equal(loaded(slip, {}), law(slip, {}))
    assert (loaded.curve.braking is None) == (braking is None)
    text = (tmp_path / "law.json").read_text()
    for spoiled in (
        text.replace('"reach": 0.01', '"reach": -0.01'),
        text.replace('"factors": [', '"factors": [[0.1], '),
    ):
        (tmp_path / "law.json").write_text(spoiled)
        with pytest.raises(InputError, match="not a law saved by"):
            load_law(tmp_path / "law.json")


@pytest.fixture(scope="module")
def setting():
    return setting_of(simulate(["temperature"], seed=1, base="burckhardt", **SIZE).train)


@pytest.mark.slow
@pytest.mark.parametrize("base", ["burckhardt", "kiencke", "polach-falling", "polach"])
def test_the_compiled_program_predicts_what_the_law_does(setting, base):
    """Of one term of each kind, an effect that bends the slip, a wave, and one with a memory."""
    problem = setting.problem
    (start,) = KINDS["labels"].starts({"sanding": np.arange(3.0)})
    labels = dataclasses.replace(start, k1=0.1, k2=-0.1, acts_on="level")
    scales = {name: (float(z.mean()), float(z.std())) for name, z in problem.flat.items()}
    names = ("relative_humidity_pct", "temperature_C", "rail_age_days")
    humid, warm, age = (scales[name] for name in names)
    effects = (
        Covariate(0.1, 60.0, 15.0, column="relative_humidity_pct", acts_on="fall"),
        KINDS["spline"](0.3, -0.2, 0.5, 0.1, -0.4, *warm, column="temperature_C", acts_on="slip"),
        KINDS["threshold"](0.1, age[0], 3.0, 0.0, column="rail_age_days"),
        labels,
        KINDS["memory"](0.02, 0.8, 0.5, 0.6, column="slip_velocity_mps", acts_on="offset"),
        Covariate(0.002, 9e4, 1e4, column="normal_load_N", acts_on="shift"),
        KINDS["interaction"](
            *(0.2, -0.1, 0.05, 0.1, 0.02, -0.03, 0.1, 0.04, -0.05), *warm, *humid,
            "temperature_C", "relative_humidity_pct", acts_on="fall",
        ),
        KINDS["surface"](
            *(0.1, -0.2, 0.05, 0.1, -0.1), *age, *warm, "rail_age_days", "temperature_C",
            acts_on="slip",
        ),
        EFFECTS["load_slope"](p=0.3, reference=9e4),
        EFFECTS["lag"](time_constant=0.6),
        KINDS["periodic"](0.03, 0.02, 0.04, column="position_m"),
        KINDS["constant"](0.003, acts_on="offset"),
    )  # fmt: skip
    assert {*KINDS} - {*EFFECTS} <= {kind_of(effect) for effect in effects}
    start = {"burckhardt": (0.3, 60.0, 0.5), "kiencke": (30.0, 10.0, 400.0), "polach": (0.3, 90.0)}
    fitted = fit_model(setting, base, start.get(base, (0.5, 0.4, 0.6, 90.0, 0.4)), ())
    data = problem.data
    conditions = {**data.conditions, **dict(zip(problem.columns, data.columns, strict=False))}
    curve = base_curve(base, fitted.base_values, data.span)
    expected = jax.jit(jax.vmap(lambda slip, given: with_effects(curve, effects, slip, given)))(
        data.slip, conditions
    )
    *others, last = in_order(effects)
    model = fitted._replace(effects=tuple(others), adhesion=0 * fitted.adhesion)
    (found,) = raw_changes(model, [last])
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-12)
    assert np.abs(found - fitted.adhesion).max() > 0.02


def at_knots(weights):
    """g of a spline of these weights at its knots, a fifth of the data apart."""
    below = np.array([1e-12, 0.2, 0.4, 0.6, 0.8, 1 - 1e-12])
    z = np.log(below / (1 - below)) * 3**0.5 / np.pi
    spline = Spline(*weights, 0.0, 1.0, column="z")
    return np.asarray(spline.log_factor({"z": jnp.asarray(z)}))


def test_the_prior_of_a_spline_holds_its_values_and_more_firmly_its_bends():
    """By hand: a line in u has no second difference, b (u - .5)^2 has .08 b at each inner knot."""
    u = np.linspace(0, 1, 6) - 0.5
    each = np.stack([at_knots(one) for one in np.eye(5)], axis=1)
    line, bow = (
        np.linalg.lstsq(np.column_stack([each, np.ones(6)]), values, rcond=None)[0][:5]
        for values in (u, u**2)
    )
    for acts_on, spread in (("fall", 1.5), ("shift", 0.05)):
        precision = prior_precision(Spline, acts_on) * spread**2
        assert line @ precision @ line == pytest.approx((u**2).sum(), rel=1e-6)
        values = (at_knots(bow) ** 2).sum()
        assert bow @ precision @ bow == pytest.approx(values + 4 * (0.08 / 0.2) ** 2, rel=1e-6)


@pytest.mark.thorough
def test_where_a_column_has_a_gap_a_spline_goes_on_through_it_nearly_straight():
    """g = .6 (z/1000 - .5) of eight runs at z of 0 to 300 and 700 to 1000, in slow noise."""
    slip = 1e-3 + 0.15 * np.abs(np.sin(np.linspace(0, 6, 150)))
    peak = np.log(C1 * 60 / 0.5) / 60
    clean, top = (C1 * (1 - np.exp(-60 * one)) - 0.5 * one for one in (slip, peak))
    at = np.array([100.0, 300.0, 400.0, 600.0, 700.0, 900.0])
    ends = (0, 120), (60, 200), (100, 260), (150, 300), (1000, 760), (950, 720), (900, 700)
    off = []
    for seed in range(5):
        rng, runs = np.random.default_rng(seed), []
        for run, (first, last) in enumerate([*ends, (980, 860)]):
            z = np.linspace(first, last, 150)
            fallen = top - (top - clean) * np.exp(0.6 * (z / 1000 - 0.5))
            noise = lfilter([0.004], [1, -0.9], rng.standard_normal(150))
            runs.append(
                pd.DataFrame(
                    {
                        "time_s": 100 * run + 0.1 * np.arange(150),
                        "run": run,
                        "vehicle_speed_mps": 10.0,
                        "slip_ratio": slip,
                        "adhesion": np.where(slip > peak, fallen, clean) + noise,
                        "position_m": z,
                    }
                )
            )
        setting = setting_of(pd.concat(runs))
        (start,) = Spline.starts({"position_m": setting.problem.flat["position_m"]})
        start = dataclasses.replace(start, acts_on="fall")
        (spline,) = fit_model(setting, "burckhardt", (C1, 60.0, 0.5), [start]).effects
        found = np.asarray(spline.log_factor({"position_m": jnp.asarray(at)}))
        off.append(found - 0.6 * (at / 1000 - 0.5))
    # Free to bend by 1.5 at any knot it would be off by .8 in the mean square.
    assert np.sqrt(np.mean(np.square(off))) < 0.3
    assert np.abs(off).max() < 0.7


def test_what_a_term_acts_on_is_saved_with_the_law(tmp_path):
    law = CorrectedLaw(
        CURVES["burckhardt"],
        tuple(term(acts_on) for acts_on in ACTS_ON),
        {"z": (-2.0, 7.0)},
        Calendar("time_s", 0.0, 1.0),
    )
    save_law(tmp_path / "law.json", law)
    loaded = load_law(tmp_path / "law.json")
    assert [effect.acts_on for effect in loaded.effects] == [*ACTS_ON]
    slip, z = jnp.linspace(0.01, 0.3, 20), jnp.linspace(-4.0, 9.0, 20)
    np.testing.assert_array_equal(loaded(slip, {"z": z}), law(slip, {"z": z}))
