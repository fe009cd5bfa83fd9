"""The slip to be expected under noise, against the normal distribution written out in full."""

from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from adhesion_jax.effects.slip_noise import (
    SlipNoise,
    expected_slip,
    log_density,
    smoothed_slip,
)

POINTS = 12
DRAW = np.random.default_rng(1)
TIME = 1000 + np.cumsum(DRAW.uniform(0.02, 0.4, POINTS))
SLIP = 0.02 + 0.01 * np.sin(3 * TIME) + 2e-3 * DRAW.standard_normal(POINTS)
SPEED = DRAW.uniform(5, 20, POINTS)
NOISE = SlipNoise(sigma=2e-3, roughness=0.03)
SPEED_NOISE = SlipNoise(sigma=0.03, roughness=0.03, falls_with="vehicle_speed_mps")


def of_run(function, noise, slip, time, speed):
    conditions = {"time_s": jnp.asarray(time), "vehicle_speed_mps": jnp.asarray(speed)}
    return function(noise, jnp.asarray(slip), conditions)


def smoothed(noise, slip=SLIP, time=TIME, speed=SPEED):
    return of_run(smoothed_slip, noise, slip, time, speed)


def density(noise, slip=SLIP, time=TIME, speed=SPEED):
    return float(of_run(log_density, noise, slip, time, speed).sum())


def covariances(noise, time=TIME, speed=SPEED):
    """Of the true slip and of its noise: a Wiener process integrated, from a wide start.

    Slip and its rate start with a variance of one each; of the integral of a Wiener process of
    unit intensity, E[x(s) x(t)] = s^2 (3 t - s)/6 for s < t.
    """
    elapsed = time - time[0]
    early = np.minimum(elapsed[:, None], elapsed)
    late = np.maximum(elapsed[:, None], elapsed)
    walk = noise.roughness**2 * early**2 * (3 * late - early) / 6
    spread = noise.sigma / speed if noise.falls_with else noise.sigma + 0 * elapsed
    return 1.0 + np.outer(elapsed, elapsed) + walk, np.diag(spread**2)


@pytest.mark.parametrize("noise", [NOISE, SPEED_NOISE], ids=["of the slip", "of the speed"])
def test_the_smoothed_slip_is_that_of_the_normal_distribution(noise):
    true, error = covariances(noise)
    gain = np.linalg.solve(true + error, true).T
    found = smoothed(noise)
    expected = SLIP[0] + gain @ (SLIP - SLIP[0])
    np.testing.assert_allclose(found, expected, rtol=1e-7)
    assert np.abs(found - SLIP).max() > 5e-4


@pytest.mark.parametrize("noise", [NOISE, SPEED_NOISE], ids=["of the slip", "of the speed"])
def test_the_density_is_that_of_the_slips_after_the_first(noise):
    whole = sum(covariances(noise))
    error = SLIP - SLIP[0]
    joint = stats.multivariate_normal(cov=whole).logpdf(error)
    first = stats.norm.logpdf(error[0], 0.0, np.sqrt(whole[0, 0]))
    expected = joint - first + 0.5 * (POINTS - 1) * np.log(2 * np.pi)
    assert density(noise) == pytest.approx(expected, rel=1e-8)


def test_what_is_repeated_at_one_time_tells_nothing():
    places = np.sort(np.append(np.arange(POINTS), [4, 4, POINTS - 1]))
    again = np.diff(places, prepend=-1) == 0
    slip = np.where(again, 0.5, SLIP[places])
    found = smoothed(NOISE, slip, TIME[places], SPEED[places])
    np.testing.assert_allclose(found, smoothed(NOISE)[places], rtol=1e-8)
    repeated = density(NOISE, slip, TIME[places], SPEED[places])
    assert repeated == pytest.approx(density(NOISE), rel=1e-10)


def test_a_larger_noise_is_smoothed_more():
    sizes = [0.0, 1e-4, 1e-3, 1e-2, 1.0]
    found = [smoothed(SlipNoise(sigma=size, roughness=0.03)) for size in sizes]
    np.testing.assert_allclose(found[0], SLIP, atol=1e-9)
    # What is left of the bends of the signal, by its second divided differences.
    rough = [np.linalg.norm(np.diff(np.diff(one) / np.diff(TIME))) for one in found]
    assert all(more > less for more, less in pairwise(rough))
    # Where nothing is known of neighbours the slip is that measured.
    still = smoothed(SlipNoise(sigma=1e-3, roughness=1e4))
    np.testing.assert_allclose(still, SLIP, atol=1e-7)


@pytest.mark.slow
def test_the_expected_slip_is_as_rough_as_is_likely_near_each_point():
    rougher = [4.0**power for power in range(-5, 2)]
    kinds = [SlipNoise(sigma=NOISE.sigma, roughness=times * NOISE.roughness) for times in rougher]
    told = np.array([of_run(log_density, kind, SLIP, TIME, SPEED) for kind in kinds])
    near = np.array([told[:, max(at - 12, 0) : at + 13].sum(axis=1) for at in range(POINTS)])
    share = np.exp(near - near.max(axis=1, keepdims=True))
    share /= share.sum(axis=1, keepdims=True)
    rough = NOISE.roughness * np.exp(share @ np.log(rougher))
    found = of_run(expected_slip, NOISE, SLIP, TIME, SPEED)
    by_hand = smoothed(eqx.tree_at(lambda kind: kind.roughness, NOISE, jnp.asarray(rough)))
    np.testing.assert_allclose(found, by_hand, rtol=1e-9)


@pytest.mark.thorough
def test_a_slip_that_is_calm_but_for_events_is_followed_where_it_is_rough():
    """A bump of .15 within 6 s in 60 s of creep; 200 times with noise of its own."""
    time, sigma = 0.1 * np.arange(600), 1.5e-3
    inside = (time > 27) & (time < 33)
    true = 0.004 + 0.15 * np.where(inside, np.sin(np.pi * (time - 27) / 6) ** 2, 0.0)
    slips = true + sigma * np.random.default_rng(3).normal(size=(200, time.size))

    def of(function, roughness):
        noise = SlipNoise(sigma=sigma, roughness=roughness)
        found = jax.vmap(lambda slip: function(noise, slip, {"time_s": jnp.asarray(time)}))(slips)
        return np.asarray(found - true) ** 2

    # The roughness of greatest likelihood for the whole lies between those of the two parts.
    square = of(expected_slip, 0.008)
    # The same roughness everywhere is too rough for the creep ...
    alike = of(smoothed_slip, 0.008)
    assert square[:, ~inside].mean() < 0.8 * alike[:, ~inside].mean()
    # ... and what suits the creep misses the event.
    smooth = of(smoothed_slip, 0.002)
    assert square[:, inside].mean() < 0.2 * smooth[:, inside].mean()


def test_a_straight_course_stays_one():
    line = 0.02 + 0.003 * (TIME - TIME[0])
    # But for the start, whose rate is taken for one of zero, give or take one.
    np.testing.assert_allclose(smoothed(NOISE, line), line, atol=1e-7)
