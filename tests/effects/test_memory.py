"""A column with a memory, against the differential equation."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from adhesion_jax.effects import Memory
from adhesion_jax.effects.shape import prior_precision

DRAW = np.random.default_rng(2)
TIME = 500 + np.cumsum(DRAW.uniform(0.05, 0.4, 80))
GUST = DRAW.normal(4.0, 2.0, 80)
MEMORY = Memory(k=0.3, time_constant=0.9, reference=3.5, scale=1.7, column="gust")


def told(memory, column=GUST, time=TIME):
    conditions = {"gust": jnp.asarray(column), "time_s": jnp.asarray(time)}
    return np.asarray(memory.log_factor(conditions))


def test_the_column_is_followed_as_the_differential_equation_says():
    """T y' + y = z with z a straight line between samples, y = z at the first; by Runge-Kutta."""
    found = solve_ivp(
        lambda time, y: (np.interp(time, TIME, GUST) - y) / 0.9,
        (TIME[0], TIME[-1]),
        GUST[:1],
        t_eval=TIME,
        max_step=0.01,
        rtol=1e-9,
    )
    np.testing.assert_allclose(told(MEMORY), 0.3 * (found.y[0] - 3.5) / 1.7, atol=2e-5)


def test_a_step_is_followed_by_an_exponential_and_sample_by_sample_by_the_exact_loop():
    y, expected = GUST[0], [GUST[0]]
    for point in range(1, TIME.size):
        step = TIME[point] - TIME[point - 1]
        slope = (GUST[point] - GUST[point - 1]) / step
        # The ramp z0 + slope t: y = z0 + slope (t - T) + (y0 - z0 + slope T) exp(-t/T).
        away = y - GUST[point - 1] + slope * 0.9
        y = GUST[point - 1] + slope * (step - 0.9) + away * np.exp(-step / 0.9)
        expected.append(y)
    np.testing.assert_allclose(told(MEMORY), 0.3 * (np.array(expected) - 3.5) / 1.7, rtol=1e-10)
    time = np.append(0.0, 1e-6 + 0.1 * np.arange(50))
    column = np.append(0.0, np.ones(50))
    plain = dataclasses.replace(MEMORY, k=1.0, reference=0.0, scale=1.0)
    np.testing.assert_allclose(
        told(plain, column, time)[1:], 1 - np.exp(-time[1:] / 0.9), atol=2e-6
    )


def test_a_short_memory_is_none_and_a_long_one_keeps_what_was_first():
    quick = dataclasses.replace(MEMORY, time_constant=1e-6)
    np.testing.assert_allclose(told(quick), 0.3 * (GUST - 3.5) / 1.7, atol=1e-4)
    slow = dataclasses.replace(MEMORY, time_constant=1e9)
    np.testing.assert_allclose(told(slow), 0.3 * (GUST[0] - 3.5) / 1.7, atol=1e-6)
    # A steady state has no history: there the column is what it is.
    steady = MEMORY.log_factor({"gust": jnp.asarray(4.5)})
    assert float(steady) == pytest.approx(0.3 / 1.7)


def test_it_starts_from_the_median_and_the_spread_of_the_column():
    starts = Memory.starts({"gust": GUST, "still": np.ones(80)})
    assert {start.column for start in starts} == {"gust"}
    for start in starts:
        assert (start.reference, start.scale) == (np.median(GUST), np.std(GUST))
    times = [start.time_constant for start in starts]
    assert len({*times}) == len(times) > 1
    # The prior of g at 1.5 spreads away is N(0, 1.5^2), as of a line.
    places = np.linspace(-1.5, 1.5, 6)
    np.testing.assert_allclose(prior_precision(Memory, "level"), [[(places**2).sum() / 1.5**2]])
