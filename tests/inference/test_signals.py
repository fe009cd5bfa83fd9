"""What signals are is judged by the points alone, on records of an independent generator."""

import re

import numpy as np
import pytest
from fault_forms import DRY
from stranger_runs import STRANGERS, autoregression

from adhesion_jax.data.plausible import exchanged
from adhesion_jax.inference.rows import Rows
from adhesion_jax.measured.vetoes import (
    Points,
    independent_of_slip,
    passages,
    shifted,
    zero_elsewhere,
)

STEP = 0.1


def record(rng, runs, length, truth=DRY, late=0, noise=0.004, slow=0.0, back=True):
    """Runs in which slip rises to .12 (and returns), with adhesion `late` rows later."""
    course = np.linspace(0, 1, length)
    course = np.sin(np.pi * course) ** 2 if back else course
    slip = np.concatenate([0.001 + 0.11 * rng.uniform(0.85, 1.15) * course for _ in range(runs)])
    level = [autoregression(rng, length, 0.97, slow) for _ in range(runs)]
    clean = truth.adhesion(slip).reshape(runs, length) * (1 + np.array(level))
    clean = np.concatenate([np.repeat(clean[:, :1], late, 1), clean[:, : length - late]], 1)
    adhesion = clean.ravel() + rng.normal(0.0, noise, slip.size)
    starts = np.arange(runs + 1) * length
    rows = Rows(
        slip, adhesion, {}, np.ones(slip.size), starts, starts, np.arange(runs), True, runs > 1
    )
    return as_points(slip, adhesion), rows


def as_points(slip, adhesion):
    nothing = np.zeros(slip.size)
    return Points(np.abs(slip), np.where(slip < 0, -1.0, 1.0) * adhesion, *3 * [nothing])


@pytest.mark.parametrize("name", STRANGERS)
@pytest.mark.parametrize("runs", [1, 6])
def test_exchanged_columns_are_told_from_right_ones(name, runs):
    for seed in range(5):
        points, _ = record(np.random.default_rng([seed, 1]), runs, 100, STRANGERS[name])
        assert not exchanged(points.slip, points.adhesion)
        assert exchanged(points.adhesion, points.slip)


def test_no_signals_look_exchanged_or_late_where_adhesion_does_not_depend_on_slip():
    for seed in range(20):
        rng = np.random.default_rng([seed, 2])
        points, rows = record(rng, 4, 60)
        points = points._replace(adhesion=rng.normal(0.2, 0.03, points.slip.size))
        assert not exchanged(points.slip, points.adhesion)
        assert not exchanged(points.adhesion, points.slip)
        assert not shifted(points, rows, STEP)


@pytest.mark.parametrize(("runs", "length", "late"), [(1, 100, 12), (2, 100, 15), (6, 40, 5)])
def test_a_delay_in_few_rows_is_named(runs, length, late):
    for seed in range(10):
        points, rows = record(np.random.default_rng([seed, 3]), runs, length, late=late)
        told = shifted(points, rows, STEP)
        assert "s before" in told
        seconds = float(told.split("the slip of ")[1].split(" s ")[0])
        assert seconds == pytest.approx(STEP * late, abs=4 * STEP)


@pytest.mark.parametrize(("runs", "length"), [(3, 40), (6, 100), (2, 400)])
def test_neither_noise_nor_a_slow_rail_is_taken_for_a_delay(runs, length):
    for seed in range(20):
        for noise in ({"noise": 0.02}, {"slow": 0.05}, {"slow": 0.15}):
            points, rows = record(np.random.default_rng([seed, 4]), runs, length, **noise)
            assert not shifted(points, rows, STEP)


@pytest.mark.parametrize(("runs", "back", "count"), [(1, False, 1), (1, True, 2), (3, True, 6)])
def test_passages_of_a_slip_are_counted(runs, back, count):
    points, rows = record(np.random.default_rng(5), runs, 80, back=back)
    noisy = points._replace(slip=points.slip + np.random.default_rng(6).normal(0, 4e-4, 80 * runs))
    assert passages(points, rows) == passages(noisy, rows) == count


def test_rows_of_three_rails_are_not_said_to_show_no_dependence_on_slip():
    """Their scatter is large at the peak, and small where adhesion rises from 0."""
    chance = np.random.default_rng(3)
    slip = np.abs(chance.normal(0, 0.08, 1200))
    level = np.repeat([0.31, 0.19, 0.08], 400)
    shape = 2 * (slip / 0.03) / (1 + (slip / 0.03) ** 2)
    adhesion = level * shape + 0.005 * chance.normal(size=1200)
    assert independent_of_slip(as_points(slip, adhesion)) == ""
    flat = level + 0.005 * chance.normal(size=1200)
    assert "show no dependence on slip" in independent_of_slip(as_points(slip, flat))


@pytest.mark.parametrize("name", STRANGERS)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_wrong_radius_is_seen_where_adhesion_is_zero_beyond_slip_zero(name, side):
    """1.2 % are added to every slip; a curve from the origin is never told so."""
    chance = np.random.default_rng(8)
    slip = chance.uniform(0.0, 0.25, 900) ** 2 / 0.25
    adhesion = STRANGERS[name].adhesion(slip) + 0.005 * chance.normal(size=slip.size)
    assert zero_elsewhere(as_points(side * slip, side * adhesion), side * slip, 0.0, "") == ""
    off = side * (slip + 0.012)
    said = zero_elsewhere(as_points(off, side * adhesion), off, 0.0, "")
    found = re.search(r"adhesion is 0 at slip (\S+) and not at slip 0", said)
    assert float(found[1]) == pytest.approx(0.012, abs=0.003)
    assert "a wheel radius that is wrong by 1" in said


def test_where_a_straight_rise_meets_zero_is_told_to_three_digits():
    slip = np.linspace(0.0124, 0.2, 400)
    adhesion = np.minimum(8.0 * (slip - 0.0123), 0.3)
    said = zero_elsewhere(as_points(slip, adhesion), slip, 0.0, "")
    assert "adhesion is 0 at slip 0.0123 and not at slip 0: a wheel radius" in said
    assert "a force whose zero is off by 0.098 of the load" in said
    velocity = zero_elsewhere(as_points(slip, adhesion), slip, 0.0, " m/s")
    assert "adhesion is 0 at slip 0.0123 m/s and" in velocity
    assert "radius" not in velocity
