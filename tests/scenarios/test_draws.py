"""The random numbers of the scenarios against published values, exact formulas and statistics."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from adhesion_jax.scenarios.draws import _logarithm, _mixed, _words, normal, uniform

#: Runs and points of one draw in the statistics below.
RUNS, POINTS = 4000, 500

WORD = 2**64


def keys(first, runs):
    return jax.vmap(lambda run: jax.random.fold_in(jax.random.key(3), run))(
        jnp.arange(first, first + runs)
    )


drawn = jax.jit(jax.vmap(lambda key: normal(key, (POINTS,))))


def test_words_are_those_published_for_splitmix64():
    """Seed 1234567 and the golden gamma: the test vector of Vigna's reference code."""
    places = jnp.arange(1, 6, dtype=jnp.uint64)
    words = _mixed(
        np.uint64(1234567) + places * np.uint64(0x9E3779B97F4A7C15),
        (30, 27, 31),
        (0xBF58476D1CE4E5B9, 0x94D049BB133111EB),
    )
    assert [int(word) for word in words] == [
        6457827717110365317,
        3203168211198807973,
        9817491932198370423,
        4593380528125082431,
        16408922859458223821,
    ]


def mixed_by_integers(word, shifts, factors):
    for shift, factor in zip(shifts[:2], factors, strict=True):
        word = (word ^ (word >> shift)) * factor % WORD
    return word ^ (word >> shifts[2])


def gamma_by_integers(seed):
    golden = (seed + 0x9E3779B97F4A7C15) % WORD
    factors = 0xFF51AFD7ED558CCD, 0xC4CEB9FE1A85EC53
    return mixed_by_integers(golden, (33, 33, 33), factors) | 1


def is_alike(gamma):
    """Whether so few neighbouring bits of gamma differ that it is repaired."""
    return (gamma ^ gamma >> 1).bit_count() < 24


def seed_of(key):
    high, low = (int(part) for part in jax.random.key_data(key))
    return high << 32 | low


def words_by_integers(key, count):
    seed = seed_of(key)
    gamma = gamma_by_integers(seed)
    if is_alike(gamma):
        gamma ^= 0xAAAAAAAAAAAAAAAA
    return [
        mixed_by_integers(
            (seed + place * gamma) % WORD, (30, 27, 31), (0xBF58476D1CE4E5B9, 0x94D049BB133111EB)
        )
        for place in range(1, count + 1)
    ]


def test_numbers_are_what_python_integers_and_libm_give():
    some = [jax.random.fold_in(jax.random.key(5), run) for run in range(60)]
    assert any(is_alike(gamma_by_integers(seed_of(key))) for key in some)
    for key in some:
        words = words_by_integers(key, 8)
        assert [int(word) for word in _words(key, 8)] == words
        fractions = [((word >> 11) + 0.5) / 2**53 for word in words]
        np.testing.assert_array_equal(uniform(key, (4, 2), 0.2).ravel(), 0.2 * np.array(fractions))
        expected = np.empty(8)
        for place in range(4):
            radius = math.sqrt(-2 * math.log(fractions[place]))
            angle = math.pi / 4 * fractions[place + 4]
            turn = words[place + 4]
            pair = [math.cos(angle), math.sin(angle)]
            if turn & 1 == 0:
                pair.reverse()
            expected[place] = radius * pair[0] * (-1 if turn & 2 else 1)
            expected[place + 4] = radius * pair[1] * (-1 if turn & 4 else 1)
        np.testing.assert_allclose(normal(key, (8,)), expected, rtol=2e-15, atol=0)
        np.testing.assert_allclose(normal(key, (7,)), expected[:7], rtol=2e-15, atol=0)


def test_logarithm_over_its_whole_range():
    x = np.concatenate([
        2.0 ** -np.linspace(0, 54, 20001),
        1 - 2.0 ** -np.arange(1.0, 54),
        np.sqrt(0.5) * (1 + np.arange(-4, 5) * 2.0**-53),
    ])  # fmt: skip
    np.testing.assert_allclose(_logarithm(jnp.asarray(x)), np.log(x), rtol=1e-15, atol=0)


def test_largest_numbers_are_finite():
    smallest, largest = 0.5 * 2.0**-53, 1.0
    at_ends = jnp.sqrt(-2 * _logarithm(jnp.array([smallest, largest])))
    np.testing.assert_allclose(at_ends, [math.sqrt(108 * math.log(2)), 0.0], rtol=1e-15)


def standard(x, expected, variance):
    """How many standard errors the mean of x is from what is expected."""
    return float((jnp.mean(x) - expected) * math.sqrt(x.size / variance))


def double_factorial(n):
    return math.prod(range(n, 0, -2))


def test_mean_to_eighth_moment():
    x = drawn(keys(0, RUNS))
    for power in range(1, 9):
        expected = 0 if power % 2 else double_factorial(power - 1)
        variance = double_factorial(2 * power - 1) - expected**2
        assert abs(standard(x**power, expected, variance)) < 4, power


def test_distribution_is_normal():
    x = np.sort(np.asarray(drawn(keys(0, RUNS))).ravel())
    assert stats.kstest(x, "norm", method="asymp").pvalue > 1e-4
    # And each half of a pair, and the lowest bits of a number, which the density does not show.
    last = np.asarray(uniform(jax.random.key(8), (10**6,))) * 2.0**43 % 1
    assert stats.kstest(last, "uniform").pvalue > 1e-4


@pytest.mark.parametrize("power", [1, pytest.param(2, marks=pytest.mark.thorough)])
def test_no_correlation_along_a_run_between_runs_and_within_pairs(power):
    x = np.asarray(drawn(keys(0, RUNS))) ** power
    x = (x - np.mean(x)) / np.std(x)
    along = [
        np.mean(x[:, lag:] * x[:, :-lag]) * math.sqrt(x[:, lag:].size) for lag in range(1, 400)
    ]
    between = [np.mean(x[lag:] * x[:-lag]) * math.sqrt(x[lag:].size) for lag in range(1, 400)]
    half = POINTS // 2
    pairs = np.mean(x[:, :half] * x[:, half:]) * math.sqrt(x.size / 2)
    for correlations in (along, between):
        assert np.max(np.abs(correlations)) < 4.5
        assert abs(np.std(correlations) - 1) < 5 / math.sqrt(2 * 399)
    assert abs(pairs) < 4


def test_neighbouring_keys_and_places_share_no_numbers():
    x = np.asarray(drawn(keys(0, RUNS)))
    assert np.unique(x).size > x.size - 3


@pytest.mark.thorough
def test_tails_to_six_sigma():
    """Two thousand million numbers: 4 are expected beyond six standard deviations."""
    runs, batches = 200, 20_000  # a batch stays in the cache of a core
    limits = np.concatenate([np.arange(1.0, 7.0), -np.arange(1.0, 7.0)])[:, None, None]
    fast = {"xla_backend_optimization_level": 3, "xla_cpu_use_fusion_emitters": True}

    def counted(batch, found):
        keys = jax.vmap(lambda run: jax.random.fold_in(jax.random.key(11), run))
        x = jax.vmap(lambda key: normal(key, (POINTS,)))(keys(batch * runs + jnp.arange(runs)))
        x = jax.lax.optimization_barrier(x)  # else each sum draws the numbers for itself
        return found + jnp.sum(x > limits, axis=(1, 2))

    every = jax.jit(
        lambda: jax.lax.fori_loop(0, batches, counted, jnp.zeros(12, dtype=int)),
        compiler_options=fast,
    )
    found = np.array(every())
    found[6:] = runs * batches * POINTS - found[6:]
    expected = np.tile(stats.norm.sf(np.arange(1.0, 7.0)), 2) * runs * batches * POINTS
    for number, mean in zip(found, expected, strict=True):
        chance = 2 * min(stats.poisson.cdf(number, mean), stats.poisson.sf(number - 1, mean))
        assert chance > 1e-4, (number, mean)
    assert found[5] + found[11] > 0  # 4 are expected
