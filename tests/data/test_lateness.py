"""The delay between two signals: against delays that were put in by hand."""

import numpy as np
import pytest
from late_log import trip

from adhesion_jax.data.lateness import best_lag, grid_of, lateness


def delay_between(time, first, second, run):
    grid = grid_of(time, run, {"first": first, "second": second})
    return best_lag(grid, *grid.signals.values())


def wavy(seed, rows=6000, step=0.05):
    """A signal that can be asked for at any time: 60 waves of 0.02 to 0.5 Hz."""
    chance = np.random.default_rng(seed)
    rate = 2 * np.pi * chance.uniform(0.02, 0.5, 60)
    phase = chance.uniform(0, 2 * np.pi, 60)

    def at(time):
        return np.sin(np.outer(time, rate) + phase).sum(axis=1)

    return step * np.arange(rows), at, chance


@pytest.mark.parametrize("late", [0.23, -0.4])
@pytest.mark.parametrize("step", [0.05, 0.013])
def test_a_signal_that_was_moved_is_found_to_be_late(late, step):
    time, at, _ = wavy(1, step=step)
    found = delay_between(time, at(time - late), 7 * at(time) + 3, np.zeros(time.size, int))
    assert found.seconds == pytest.approx(late, abs=0.005)
    assert found.clear
    none = delay_between(time, at(time), at(time), np.zeros(time.size, int))
    assert none.seconds == pytest.approx(0.0, abs=1e-9)
    assert not none.clear


@pytest.mark.long
def test_the_standard_error_is_the_scatter_of_repeated_logs():
    found = []
    for seed in range(60):
        time, at, chance = wavy(seed, rows=4000)
        noise = chance.normal(0, 2.0, (2, time.size))
        zero = np.zeros(time.size, int)
        found.append(delay_between(time, at(time - 0.2) + noise[0], at(time) + noise[1], zero))
    seconds = np.array([one.seconds for one in found])
    error = np.sqrt(np.mean([one.standard_error**2 for one in found]))
    # The scatter of 60 is known to 9 %, and a jackknife of 20 blocks to about 16 %.
    assert seconds.std() == pytest.approx(error, rel=0.35)
    assert abs(seconds.mean() - 0.2) < 4 * error / np.sqrt(60) + 0.003


def test_runs_are_not_joined():
    """Two halves in the wrong order, each late by 0.2 s: where they meet nothing agrees."""
    time, at, _ = wavy(3)
    there = np.concatenate([time[3000:], time[:3000]])
    run = np.repeat([0, 1], 3000)
    found = delay_between(there, at(there - 0.2), at(there), run)
    assert found.seconds == pytest.approx(0.2, abs=0.003)


def test_a_signal_without_any_change_tells_nothing():
    time, at, _ = wavy(4)
    found = delay_between(time, np.ones(time.size), at(time), np.zeros(time.size, int))
    assert not found.clear
    assert found.standard_error == np.inf


@pytest.mark.parametrize("late", [0.2, -0.2])
def test_both_ways_find_a_late_speed_whatever_the_unit_of_wheel_and_force(late):
    which = {"vehicle_late": late} if late > 0 else {"wheel_late": -late}
    time, vehicle, wheel, force = trip(2, seconds=900.0, **which)
    zero = np.zeros(time.size, int)
    plain = lateness(time, vehicle, wheel, force, zero)
    other = lateness(time, vehicle, wheel / 0.46, 2e5 * force, zero)
    for found in (plain, other):
        assert found.clear
        assert abs(found.seconds - late) < 4 * found.standard_error + 0.003
        seconds, error = found.by_accelerations
        assert abs(seconds - late) < 4 * error + 0.01
    assert other.seconds == pytest.approx(plain.seconds, abs=1e-3)


def test_the_noise_of_the_vehicle_speed_does_not_make_the_delay_smaller():
    time, vehicle, wheel, force = trip(2, seconds=900.0, vehicle_late=0.2, noise=(0.15, 0.01))
    found = lateness(time, vehicle, wheel, force, np.zeros(time.size, int))
    assert abs(found.seconds - 0.2) < min(4 * found.standard_error, 0.03)


def trapezia(seed, late):
    """Half an hour of trips of one kind: pull for 70 s, roll for 210 s, brake for 120 s."""
    chance = np.random.default_rng(seed)
    time = 0.1 * np.arange(18_000)
    phase = time % 400
    pull, roll = phase < 70, (phase >= 70) & (phase < 280)
    change, slip = (
        np.select([pull, roll], [0.35, -0.02], -0.2),
        np.select([pull, roll], [0.012, 0]),
    )
    speed = np.empty(time.size)
    now = 1.0
    for row, by in enumerate(change):
        now = float(np.clip(now + 0.1 * by, 0.0, 27.0))
        speed[row] = now
    slip = slip - 0.002 * (~pull & ~roll) + chance.normal(0, 0.0004, time.size)
    noise = chance.normal(0, [[0.01], [0.01], [0.005]], (3, time.size))
    vehicle = np.interp(time - late, time, speed) + noise[0]
    moving = speed > 0.5
    measured = time, vehicle, speed * (1 + slip) + noise[1], 25 * slip + noise[2]
    return *(one[moving] for one in measured), np.zeros(moving.sum(), int)


def test_a_late_speed_is_found_where_the_train_mostly_rolls():
    """At a small force it then hardly accelerates, and noise is most of dv/dt."""
    for seed in range(4):
        found = lateness(*trapezia(seed, 0.5))
        assert found.clear
        assert found.seconds == pytest.approx(0.55, abs=0.1)
        assert not lateness(*trapezia(seed, 0.0)).clear
