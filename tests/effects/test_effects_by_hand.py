import dataclasses
from itertools import permutations

import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from adhesion_jax.curves import BASES, CURVES
from adhesion_jax.effects import EFFECTS, KINDS, Spline
from adhesion_jax.effects.law import with_effects
from adhesion_jax.effects.one_column import turn_of
from adhesion_jax.effects.two_columns import on_grid

BARE = CURVES["burckhardt"]
POINT = {
    "vehicle_speed_mps": 14.0,
    "normal_load_N": 9.3e4,
    "temperature_C": 12.0,
    "curvature_per_m": 0.0022,
    "acceleration_mps2": -0.1,
}


def after(effect, signal, conditions, slip=None):
    signal = jnp.asarray(signal)
    slip = jnp.full_like(signal, 0.05) if slip is None else jnp.asarray(slip)
    return np.asarray(effect.after(signal, slip, conditions))


def test_speed_is_curtius_and_kniffler():
    # 7.5/(44 + V) + .161: .331 at rest, .236 at 56 km/h, .213 at 100 km/h.
    effect = EFFECTS["speed"](k=1.0, reference=0.0)
    speeds = np.array([0.0, 56.0, 100.0]) / 3.6
    found = after(effect, [1.0] * 3, {"vehicle_speed_mps": jnp.asarray(speeds)})
    expected = np.array([7.5 / 44, 7.5 / 100, 7.5 / 144]) + 0.161
    np.testing.assert_allclose(found, expected / expected[0], rtol=1e-14)
    half = after(dataclasses.replace(effect, k=0.5), [1.0] * 3,
                 {"vehicle_speed_mps": jnp.asarray(speeds)})  # fmt: skip
    np.testing.assert_allclose(half, 0.5 + 0.5 * expected / expected[0], rtol=1e-14)


def test_polachs_friction_falls_as_he_says():
    # Dry: A = .4, b = .6 s/m; at a slip velocity of 1 m/s (1 - A) exp(-.6) + A = .7293.
    effect = EFFECTS["falling_friction"](drop=0.6, b=0.6)
    found = after(effect, [1.0] * 3, {"vehicle_speed_mps": jnp.full(3, 20.0)}, [0.0, 0.05, -0.5])
    np.testing.assert_allclose(found, [1.0, 0.72928698, 0.40148725], atol=5e-9)


def test_effects_of_one_line_are_what_their_formulas_say():
    one = {name: jnp.asarray([z]) for name, z in POINT.items()}
    speed, load = POINT["vehicle_speed_mps"], POINT["normal_load_N"]
    cases = [
        (EFFECTS["slip_speed"](c4=0.03), np.exp(-0.03 * 0.05 * speed)),
        (EFFECTS["load_peak"](p=0.5, reference=load / 4), 0.5),
        (EFFECTS["temperature"](k=0.01, reference=POINT["temperature_C"] - 5), 1.05),
        (EFFECTS["curve"](k=20.0), 1 - 20 * POINT["curvature_per_m"]),
        (EFFECTS["load_transfer"](k=0.5), 0.95),
        (EFFECTS["contact_heating"](k=0.4), 1 - 0.4 * 0.3 * 0.05 * np.sqrt(speed)),
        (EFFECTS["torque_offset"](offset=0.03), 1.1),
    ]
    for effect, factor in cases:
        assert after(effect, [0.3], one)[0] == pytest.approx(0.3 * factor, rel=1e-12)
    modes = {"mode": jnp.array([1.0, -1.0, 0.0])}
    found = after(EFFECTS["mode_asymmetry"](k=0.1), [0.3] * 3, modes)
    np.testing.assert_allclose(found, [0.33, 0.27, 0.3], rtol=1e-14)
    axles = {"axle": jnp.array([0.0, 2.0, 5.0, 9.0])}
    effect = EFFECTS["axle_position"](0.1, 0.2, 0.3, 0.4, 0.5)
    np.testing.assert_allclose(after(effect, [0.3] * 4, axles), [0.3, 0.36, 0.45, 0.45])


def test_heat_is_of_the_adhesion_that_there_is_and_an_offset_is_of_the_signal():
    # A factor of 1.2, then the heat of what is left, then the offset, in whatever order they were
    # found.
    heat, offset = EFFECTS["contact_heating"](k=0.4), EFFECTS["torque_offset"](offset=0.03)
    axle = EFFECTS["axle_position"](0.2, 0.0, 0.0, 0.0, 0.0)
    conditions = {"axle": jnp.ones(1), "vehicle_speed_mps": jnp.full(1, 16.0)}
    slip = jnp.full(1, 0.05)
    scaled = 1.2 * float(BARE(slip, {})[0])
    expected = scaled * (1 - 0.4 * scaled * 0.05 * 4) + 0.03
    for effects in permutations((heat, offset, axle)):
        found = with_effects(BARE, effects, slip, conditions)
        assert float(found[0]) == pytest.approx(expected, rel=1e-12)


def test_the_slope_under_load_is_of_the_slip_alone():
    effect = EFFECTS["load_slope"](p=1 / 3, reference=1e5)
    conditions = {"normal_load_N": jnp.array([1e5, 8e5])}
    bent = np.asarray(effect.before(jnp.full(2, 0.04), conditions))
    np.testing.assert_allclose(bent, [0.04, 0.02], rtol=1e-14)
    bent = np.asarray(EFFECTS["slip_bias"](bias=0.001).before(jnp.array([0.01, -0.01, 0.0]), {}))
    np.testing.assert_allclose(bent, [0.011, -0.011, 0.0], rtol=1e-14)


def test_humidity_changes_by_k_over_half_the_range():
    # Linear in a wide range: (s(100) - s(50)) = 1 with the centre in the middle.
    conditions = {"relative_humidity_pct": jnp.array([0.0, 50.0, 100.0])}
    effect = EFFECTS["humidity"](k=0.2, centre=50.0, width=15.0, reference=50.0)
    np.testing.assert_allclose(after(effect, [1.0] * 3, conditions), [0.8, 1.0, 1.2], rtol=1e-12)


def test_a_drift_changes_by_its_tanh_over_the_campaign():
    conditions = {"campaign_time": jnp.array([0.0, 0.5, 1.0])}
    effect = EFFECTS["drift"](k=0.1, centre=0.5, width=0.5, reference=0.5)
    step = 0.1 * np.tanh(1.0) / np.tanh(2.0)
    np.testing.assert_allclose(after(effect, [1.0] * 3, conditions), [1 - step, 1.0, 1 + step])


def test_a_patch_is_where_it_is():
    effect = EFFECTS["patch"](depth=0.4, centre=100.0, width=10.0, flatness=2.0)
    conditions = {"position_m": jnp.array([100.0, 90.0, 110.0, 120.0, 200.0])}
    expected = 1 - 0.4 * np.exp([0.0, -1.0, -1.0, -4.0, -100.0])
    np.testing.assert_allclose(after(effect, [1.0] * 5, conditions), expected, rtol=1e-10)
    box = after(dataclasses.replace(effect, flatness=12.0), [1.0] * 5, conditions)
    np.testing.assert_allclose(box[[0, 3, 4]], [0.6, 1.0, 1.0], atol=1e-12)


def test_lateral_creep_takes_its_share_of_the_creep():
    # mu(l_t) l/l_t with l = .03, l_y = .04: l_t = .05, and .6 of the adhesion there.
    effect = EFFECTS["lateral_creep"](gain=2.0, offset=0.01)
    conditions = {"lateral_measure": jnp.full(2, 0.03)}
    slip = jnp.array([0.03, -0.03])
    found = np.asarray(with_effects(BARE, (effect,), slip, conditions))
    expected = 0.6 * float(BARE(jnp.asarray(0.05), {}))
    np.testing.assert_allclose(found, [expected, -expected], rtol=1e-6)


TIME = np.concatenate([np.arange(0, 2, 0.1), np.arange(2, 6, 0.25)])


def test_a_lag_answers_a_step_and_a_ramp_as_the_differential_equation():
    effect = EFFECTS["lag"](time_constant=0.7)
    conditions = {"time_s": jnp.asarray(TIME)}
    # The signal is straight between points: the step is a ramp from 0 to dt, then constant.
    dt, T = 0.1, 0.7  # noqa: N806  (a time constant)
    step = np.where(TIME > 0, 0.3, 0.0)
    first = 0.3 / dt * (dt - T * (1 - np.exp(-dt / T)))
    expected = 0.3 + (first - 0.3) * np.exp(-(TIME - dt) / T)
    expected[0] = 0.0
    np.testing.assert_allclose(after(effect, step, conditions), expected, rtol=1e-10, atol=1e-15)
    ramp = after(effect, 0.1 * TIME, conditions)
    np.testing.assert_allclose(ramp, 0.1 * (TIME - T * (1 - np.exp(-TIME / T))), atol=1e-12)


def test_relaxation_is_a_lag_of_length_over_speed():
    effect = EFFECTS["relaxation"](length=6.0)
    signal = 0.3 + 0.1 * np.sin(TIME)
    conditions = {"time_s": jnp.asarray(TIME), "vehicle_speed_mps": jnp.full(TIME.size, 12.0)}
    lag = after(EFFECTS["lag"](time_constant=0.5), signal, conditions)
    np.testing.assert_allclose(after(effect, signal, conditions), lag, rtol=1e-13)
    # Against the differential equation itself, its input straight between points.
    solved = solve_ivp(
        lambda t, y: (np.interp(t, TIME, signal) - y) / 0.5,
        (0, TIME[-1]), [signal[0]], t_eval=TIME, rtol=1e-9, atol=1e-12, max_step=0.05,
    )  # fmt: skip
    np.testing.assert_allclose(lag, solved.y[0], atol=2e-8)


def test_a_delay_moves_the_signal():
    conditions = {"time_s": jnp.asarray(TIME)}
    found = after(EFFECTS["delay"](delay=0.35), TIME, conditions)
    np.testing.assert_allclose(found, np.maximum(TIME - 0.35, 0.0), atol=1e-13)
    early = after(EFFECTS["delay"](delay=-0.35), TIME, conditions)
    np.testing.assert_allclose(early, np.minimum(TIME + 0.35, TIME[-1]), atol=1e-13)


def test_sand_builds_up_and_is_lost():
    effect = EFFECTS["sanding"](k=0.5, build_up=1.0, decay=4.0)
    time = 0.1 * np.arange(121)
    flag = (time < 5.95).astype(float)
    conditions = {"time_s": jnp.asarray(time), "sanding": jnp.asarray(flag)}
    found = after(effect, np.ones(121), conditions)
    on = 1 - np.exp(-np.minimum(time, 5.9))
    expected = 1 + 0.5 * on * np.exp(-np.maximum(time - 5.9, 0.0) / 4)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def test_cleaning_is_by_the_integral_of_the_slip_work():
    effect = EFFECTS["cleaning"](k=0.4, work=0.8, load_power=1.0)
    fine = np.linspace(0, 12, 24_001)

    def columns(time):
        return 0.3 + 0.05 * np.sin(time), 0.05 + 0.02 * np.cos(time), 15 - 0.1 * time, 8e4

    adhesion, slip, speed, load = columns(fine)
    conditions = {
        "time_s": jnp.asarray(fine),
        "vehicle_speed_mps": jnp.asarray(speed),
        "normal_load_N": jnp.full(fine.size, load),
    }
    found = after(effect, adhesion, conditions, slip)
    solved = solve_ivp(
        lambda t, _: columns(t)[0] * columns(t)[1] * columns(t)[2] * 0.8,
        (0, 12), [0.0], t_eval=fine[::2000], rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    expected = adhesion[::2000] * (1 + 0.4 * (1 - np.exp(-solved.y[0] / 0.8)))
    # The sum over points is an integral to a step of the work, 1e-4 of the whole.
    np.testing.assert_allclose(found[::2000], expected, rtol=2e-4)


def test_hysteresis_tells_rising_from_falling_slip():
    effect = EFFECTS["hysteresis"](k=0.1, rate=0.02, memory=0.0)
    time = 0.1 * np.arange(41)
    slip = 0.05 + 0.01 * np.abs(time - 2)
    found = after(effect, np.ones(41), {"time_s": jnp.asarray(time)}, -slip)
    change = 0.1 * np.tanh(0.01 / 0.02)
    np.testing.assert_allclose(found[5:15], 1 - change, rtol=1e-9)
    np.testing.assert_allclose(found[25:35], 1 + change, rtol=1e-9)


def test_hysteresis_begins_a_run_at_rest_and_builds_up_over_its_memory():
    effect = EFFECTS["hysteresis"](k=0.1, rate=0.02, memory=2.0)
    time = 0.1 * np.arange(60)
    found = after(effect, np.ones(60), {"time_s": jnp.asarray(time)}, 0.05 + 0.01 * time)
    change = 0.1 * np.tanh(0.01 / 0.02) * -np.expm1(-(time + 0.1) / 2)  # at rest a step before
    np.testing.assert_allclose(found, 1 + change, rtol=1e-9)


def test_inertia_is_the_acceleration_of_the_circumference():
    effect = EFFECTS["inertia"](k=0.01)
    time = 0.1 * np.arange(50)
    conditions = {
        "time_s": jnp.asarray(time),
        "vehicle_speed_mps": jnp.asarray(10 + 0.5 * time),
        "acceleration_mps2": jnp.full(50, 0.5),
    }
    slip = 0.01 + 0.004 * time
    found = after(effect, np.full(50, 0.3), conditions, slip)
    expected = 0.3 + 0.01 * np.gradient((10 + 0.5 * time) * (1 + slip), time)
    np.testing.assert_allclose(found[1:-1], expected[1:-1], rtol=1e-9)


def test_waves_have_their_length_and_order():
    x = jnp.arange(40.0)
    joint = EFFECTS["rail_joint"](0.1, 0.0, 0.0, 0.02, length=20.0)
    phase = 2 * np.pi * np.arange(40) / 20
    expected = 1 + 0.1 * np.sin(phase) + 0.02 * np.cos(2 * phase)
    np.testing.assert_allclose(after(joint, np.ones(40), {"position_m": x}), expected, rtol=1e-12)
    order = EFFECTS["wheel_order"](0.1, 0.0, 0.0, 0.02, order=np.pi / 10)
    np.testing.assert_allclose(after(order, np.ones(40), {"wheel_angle_rad": x}), expected)
    wave = KINDS["periodic"](0.1, 0.0, 0.05, column="gap")
    np.testing.assert_allclose(after(wave, np.ones(40), {"gap": x}), 1 + 0.1 * np.sin(phase))


@pytest.mark.parametrize(
    ("turn", "columns"),
    [
        (24.0, "hour hours tod_h hour_of_day TimeOfDay Tageszeit Uhrzeit Stunde start_hour"),
        (24.0, "time_of_day_h hours_local Hour[h]"),
        (0.0, "operating_hour operating_hours Betriebsstunden per_hour time_s position_m today"),
        (360.0, "wind_dir heading_deg Windrichtung_Richtung"),
    ],
)
def test_the_name_of_a_column_tells_when_it_begins_anew(turn, columns):
    for column in (*columns.split(), *(["time of day"] if turn == 24 else [])):
        assert turn_of(column) == turn, column
    # Its frequency is then known, and not fitted.
    wave = KINDS["periodic"](0.1, 0.0, 0.05, column=columns.split()[0])
    assert ("frequency" in wave.held) == (turn > 0)


def factors_of(term, conditions):
    """What a term makes of a law that is one everywhere."""
    one = next(iter(conditions.values()))
    flat = dataclasses.replace(BASES["level"], level=1.0)
    found = with_effects(flat, (term,), 1 + 0 * one, conditions)
    return np.asarray(found)


def share_below(column, mean, spread):
    return stats.logistic.cdf(column, mean, spread * 3**0.5 / np.pi)


def test_a_spline_is_the_natural_cubic_spline_through_its_knots():
    """The knots lie at even shares of the data."""
    effect = Spline(0.5, -0.8, 1.1, 0.4, -0.6, mean=2.0, spread=7.0, column="wear")
    column = np.append(stats.logistic(2.0, 7.0 * 3**0.5 / np.pi).ppf(np.linspace(0, 1, 101)), -5.0)
    found = np.log(factors_of(effect, {"wear": jnp.asarray(np.clip(column, -1e4, 1e4))}))
    knots = np.linspace(0.0, 1.0, 6)
    heights = found[[0, 20, 40, 60, 80, 100]]
    assert np.ptp(heights) > 0.1
    expected = CubicSpline(knots, heights, bc_type="natural")(share_below(column, 2.0, 7.0))
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-14)


def test_the_functions_of_a_spline_are_uncorrelated_over_the_data_and_ever_rougher():
    column = stats.logistic(0.0, 3**0.5 / np.pi).ppf((np.arange(2000) + 0.5) / 2000)
    units = [Spline(*unit, mean=0.0, spread=1.0, column="wear") for unit in np.eye(5)]
    found = np.stack([np.log(factors_of(one, {"wear": jnp.asarray(column)})) for one in units])
    np.testing.assert_allclose(np.cov(found), np.eye(5), atol=2e-3)
    roughness = np.sum(np.diff(found, 2, axis=1) ** 2, axis=1)
    assert np.all(np.diff(roughness) > 0)


def test_plain_columns_are_linear_in_the_logarithm():
    one = KINDS["covariate"](k=0.1, reference=3.0, scale=2.0, column="wear")
    conditions = {"wear": jnp.array([3.0, 5.0, -17.0])}
    expected = np.exp([0.0, 0.1, -1.0])
    np.testing.assert_allclose(factors_of(one, conditions), expected, rtol=1e-12)


def test_a_threshold_is_a_step_about_its_centre():
    effect = KINDS["threshold"](k=0.2, centre=4.0, width=0.5, reference=3.0, column="wear")
    conditions = {"wear": jnp.array([3.0, 4.0, 4.5, -1e3, 1e3])}
    # tanh(2) = .96402758, tanh(1) = .76159416.
    expected = 0.2 * (np.array([-0.96402758, 0.0, 0.76159416, -1.0, 1.0]) + 0.96402758)
    np.testing.assert_allclose(np.log(factors_of(effect, conditions)), expected, atol=1e-8)


def test_an_interaction_is_of_legendre_polynomials_on_the_shares_below():
    numbers = (0.1, -0.2, 0.3, 0.05, 0.15, -0.1, 0.25, -0.3, 0.2)
    effect = KINDS["interaction"](*numbers, 2.0, 6.0, 1.0, 9.0, "wear", "gap")
    wear, gap = np.array([2.0, 3.0, 4.0, 6.0, 5.0]), np.array([-1.0, 6.5, 4.0, 9.0, 40.0])
    u, v = 2 * share_below(wear, 2.0, 6.0) - 1, 2 * share_below(gap, 1.0, 9.0) - 1
    weights = np.zeros((4, 4))
    weights[1:, 1:] = np.reshape(numbers, (3, 3))
    expected = np.polynomial.legendre.legval2d(u, v, weights)
    found = factors_of(effect, {"wear": jnp.asarray(wear), "gap": jnp.asarray(gap)})
    np.testing.assert_allclose(np.log(found), expected, atol=1e-14)


def test_the_places_of_a_prior_tell_the_polynomials_apart():
    """P_2(-1/3) = -1/3 and P_3(-1/3) = 11/27; of the first degree the four corners are enough."""
    found = on_grid((1, 1), (1, 2), (2, 3), (3, 3))
    assert found.shape == (16, 4)
    low = -1 / 3
    expected = [low * low, low * low, low * 11 / 27, (11 / 27) ** 2]
    np.testing.assert_allclose(found[5], expected, rtol=1e-12)
    np.testing.assert_allclose(found[15], 1.0, rtol=1e-12)
    assert np.linalg.matrix_rank(KINDS["interaction"].at_places()) == 9
    assert on_grid((1, 1)).ravel().tolist() == [1.0, -1.0, -1.0, 1.0]


def test_a_surface_is_of_legendre_polynomials_up_to_the_second_degree():
    numbers = (0.1, -0.2, 0.3, 0.05, 0.15)
    effect = KINDS["surface"](*numbers, 2.0, 6.0, 1.0, 9.0, "wear", "gap")
    wear, gap = np.array([2.0, 3.0, 4.0, 6.0, 5.0]), np.array([-1.0, 6.5, 4.0, 9.0, 40.0])
    u, v = 2 * share_below(wear, 2.0, 6.0) - 1, 2 * share_below(gap, 1.0, 9.0) - 1
    weights = np.array([[0.0, -0.2, 0.15], [0.1, 0.05, 0.0], [0.3, 0.0, 0.0]])
    expected = np.polynomial.legendre.legval2d(u, v, weights)
    found = factors_of(effect, {"wear": jnp.asarray(wear), "gap": jnp.asarray(gap)})
    np.testing.assert_allclose(np.log(found), expected, atol=1e-14)


def test_effects_are_applied_from_the_contact_outwards():
    slope = EFFECTS["load_slope"](p=0.5, reference=1e5)
    bias = EFFECTS["slip_bias"](bias=0.002)
    peak = EFFECTS["temperature"](k=0.01, reference=0.0)
    offset = EFFECTS["torque_offset"](offset=0.01)
    late = EFFECTS["delay"](delay=0.1)
    slip = jnp.asarray(0.01 + 0.002 * np.arange(30))
    conditions = {
        "time_s": 0.1 * jnp.arange(30),
        "normal_load_N": jnp.full(30, 4e5),
        "temperature_C": jnp.full(30, 10.0),
    }
    found = with_effects(BARE, (late, peak, offset, slope, bias), slip, conditions)
    # The bias is added to the slip first, for the load acts on what slip there is.
    inner = np.asarray(BARE((slip + 0.002) / 2, {})) * 1.1 + 0.01
    np.testing.assert_allclose(found[1:], inner[:-1], rtol=1e-12)
