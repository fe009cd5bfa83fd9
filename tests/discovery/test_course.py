"""The slip smoothed in time, against its formula and against slips whose course is known."""

import numpy as np
import pandas as pd
import pytest
from discovery_campaigns import runs_of

from adhesion_jax.discovery.model.course import as_measured, smoothed


def log_of(slip, time=None, speed=12.0, **columns):
    """A log of one run with the slip of each row, and any adhesion."""
    time = np.arange(slip.size) / 10 if time is None else time
    adhesion = 0.3 * np.tanh(60 * slip)
    table = {"time_s": time, "slip_ratio": slip, "adhesion": adhesion, "vehicle_speed_mps": speed}
    return runs_of(pd.DataFrame({**table, **columns}))


def course_of(runs, sigma):
    """The course of a slip whose noise is stated, m/s."""
    return smoothed(as_measured(runs, sigma))


def by_hand(slip, spread):
    """The smoothed slip [rows] by one stretch of rows after another."""
    value, weight = 1e-3 * slip, np.full(slip.size, 1e-3)
    for window in (9, 17, 33, 65, 129, 257):
        for first in range(slip.size - window + 1):
            rows = slice(first, first + window)
            place = np.arange(window) - window // 2
            parabola = np.polynomial.Polynomial.fit(place, slip[rows], 2)(place)
            sixth = np.polynomial.Polynomial.fit(place, slip[rows], 6)(place)
            beyond = np.sum((sixth - parabola) ** 2) / spread[first + window // 2] ** 2 - 4
            design = np.vander(place / window, 3)
            leverage = np.diag(design @ np.linalg.inv(design.T @ design) @ design.T)
            own = np.exp(-max(beyond, 0) / 2) / leverage
            value[rows] += own * parabola
            weight[rows] += own
    return value / weight


def test_the_course_is_the_mean_of_the_parabolas_that_fit():
    draw = np.random.default_rng(0)
    time = np.arange(150)
    true = 0.01 + 0.1 * np.exp(-0.5 * ((time - 80) / 9) ** 2)
    slip = true + 2e-3 * draw.normal(size=time.size)
    speed = 10 + 0.01 * time
    course = course_of(log_of(slip, speed=speed), 0.02)
    np.testing.assert_allclose(course.runs.whole.slip, by_hand(slip, 0.02 / speed), atol=1e-12)


def test_a_parabola_stays_as_it_is():
    time = np.linspace(-1, 1, 300)
    slip = 0.05 + 0.02 * time - 0.03 * time**2
    course = course_of(log_of(slip), 0.01)
    np.testing.assert_allclose(course.runs.whole.slip, slip, rtol=1e-10, atol=1e-14)


def test_noise_falls_where_the_slip_rests_and_a_slip_that_jumps_keeps_its_jump():
    """Of white noise a parabola through n rows leaves 9/(4 n) of the variance in their middle."""
    draw, sigma = np.random.default_rng(1), 1e-3
    true = np.where(np.arange(1200) < 600, 0.01, 0.11)
    slip = true + sigma * draw.normal(size=true.size)
    course = course_of(log_of(slip), 12 * sigma)
    error = np.abs(course.runs.whole.slip - true) / sigma
    calm = np.r_[150:450, 750:1050]
    assert np.sqrt(np.mean(error[calm] ** 2)) < 1.5 * np.sqrt(9 / 4 / 129)
    # Beside the jump an error of the noise may stay, and none of the jump, which is 100 of them.
    assert error.max() < 4
    left = course.left.spread[calm] / sigma
    assert np.sqrt(np.mean(left**2)) == pytest.approx(np.sqrt(9 / 4 / 129), rel=0.5)


def test_nothing_is_laid_over_a_gap_or_from_one_run_to_the_next():
    draw = np.random.default_rng(2)
    slip = np.repeat([0.01, 0.02], 200) + 1e-3 * draw.normal(size=400)
    time = np.arange(400) / 10 + np.repeat([0.0, 500.0], 200)
    whole = course_of(log_of(slip, time), 0.012).runs.whole.slip
    for half in (slice(0, 200), slice(200, 400)):
        alone = course_of(log_of(slip[half]), 0.012).runs.whole.slip
        np.testing.assert_allclose(whole[half], alone, atol=1e-12)


def test_axles_whose_rows_are_told_in_turn_are_smoothed_each_by_itself():
    draw = np.random.default_rng(5)
    axle, run = np.tile([1, 2], 200), np.repeat([1, 2], 200)
    slip = np.where(axle == 1, 0.02, 0.03) + 1e-3 * draw.normal(size=400)
    time = np.repeat(np.arange(200) / 10, 2)
    whole = course_of(log_of(slip, time, axle=axle, run=run), 0.012).runs.whole.slip
    for own in ((axle == which) & (run == number) for which in (1, 2) for number in (1, 2)):
        alone = course_of(log_of(slip[own]), 0.012).runs.whole.slip
        np.testing.assert_allclose(whole[own], alone, atol=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_slip_velocity_follows_with_or_without_its_sign(sign):
    draw = np.random.default_rng(3)
    slip = -0.05 + 2e-3 * draw.normal(size=300)
    told = {"slip_velocity_mps": 12 * (slip if sign > 0 else np.abs(slip))}
    runs = log_of(slip, **told)
    whole = course_of(runs, 0.024).runs.whole
    assert np.std(whole.slip) < 0.3 * np.std(slip)
    velocity = whole.conditions["slip_velocity_mps"]
    np.testing.assert_allclose(np.abs(velocity), 12 * np.abs(whole.slip), rtol=1e-9)


def test_a_slip_without_noise_or_without_a_time_is_as_it_was():
    slip = np.linspace(0.01, 0.2, 100)
    for runs, sigma in ((log_of(slip), 0.0), (untimed(slip), 0.01)):
        assert course_of(runs, sigma).runs is runs


def untimed(slip):
    return runs_of(pd.DataFrame({"slip_ratio": slip, "adhesion": 0.3 * np.tanh(60 * slip)}))


def test_half_of_what_jumps_is_smoothed_as_a_noise_of_half_the_size():
    draw = np.random.default_rng(4)
    measured = as_measured(log_of(0.05 + 2e-3 * draw.normal(size=300)), 0.024)
    half, alone = smoothed(measured, 0.5), course_of(measured.runs, 0.012)
    np.testing.assert_allclose(half.runs.whole.slip, alone.runs.whole.slip, rtol=1e-12)
    np.testing.assert_allclose(half.left.spread, alone.left.spread, rtol=1e-12)
    assert half.noise.sigma == pytest.approx(0.012)


def test_noise_is_estimated_in_a_short_log_whose_blocks_have_a_few_rows_each():
    draw = np.random.default_rng(6)
    runs = log_of(0.05 + 2e-3 * draw.normal(size=300))
    assert runs.blocks
    assert runs.lengths.max() < 15
    assert as_measured(runs, None).noise.sigma == pytest.approx(2e-3, rel=0.15)


def test_what_differs_between_axles_in_turn_is_no_noise():
    draw = np.random.default_rng(7)
    axle, run = np.tile([1, 2], 300), np.repeat([1, 2], 300)
    slip = np.where(axle == 1, 0.02, 0.05) + 1e-3 * draw.normal(size=600)
    runs = log_of(slip, np.repeat(np.arange(300) / 10, 2), axle=axle, run=run)
    assert as_measured(runs, None).noise.sigma == pytest.approx(1e-3, rel=0.15)


def test_noise_is_estimated_over_runs_of_different_lengths():
    draw = np.random.default_rng(8)
    run = np.repeat([1, 2], [200, 150])
    runs = log_of(0.05 + 2e-3 * draw.normal(size=350), run=run)
    assert as_measured(runs, None).noise.sigma == pytest.approx(2e-3, rel=0.15)
