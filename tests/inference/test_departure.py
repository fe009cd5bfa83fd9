"""The size of the departure of a curve, against the likelihood by dense matrices."""

import numpy as np
import pytest
from test_sandwich import summed

from adhesion_jax.curves.bent import FUNCTIONS, functions
from adhesion_jax.inference.departure import departure_of

#: Standard deviations of the factors over that of the first.
SMOOTH = (2 * np.arange(FUNCTIONS) + 1.0) ** -1.5

#: Clusters, the rows of each, and the standard deviation of their noise in adhesion.
CLUSTERS, EACH, NOISE = 20, 60, 0.005


def model(slip):
    """Derivatives of a rising curve by two parameters, and the functions, in standard deviations.

    And the block of each row.
    """
    level, rate = 0.3, 40.0
    curve = level * (1 - np.exp(-rate * slip))
    by_rate = level * slip * np.exp(-rate * slip)
    bend = curve[:, None] * np.asarray(functions(slip, 0.01, 0.2))
    x = np.column_stack([curve / level, by_rate, bend]) / NOISE
    return x, np.repeat(np.arange(CLUSTERS), EACH)


def scattered(generator):
    return model(generator.uniform(0.0, 0.2, CLUSTERS * EACH))


def at_least_squares(x, y, factors):
    """The parameters of the curve that are best with these factors, and the factors."""
    own, bend = x[:, :-FUNCTIONS], x[:, -FUNCTIONS:]
    return np.append(np.linalg.lstsq(own, y - bend @ factors)[0], factors)


def found_for(x, y, block, *, factors=None, cluster=None):
    """The departure, from sums at the best curve with these factors, or with none."""
    place = at_least_squares(x, y, np.zeros(FUNCTIONS) if factors is None else factors)
    free = np.ones(x.shape[1], dtype=bool)
    cluster = np.arange(int(block[-1]) + 1) if cluster is None else cluster
    return departure_of(summed(x, y - x @ place, block), place[-FUNCTIONS:], free, cluster, True)


def autoregression(generator, r, clusters=CLUSTERS):
    """Of the variance 1, anew in each cluster."""
    noise = generator.normal(size=(CLUSTERS * EACH // clusters, clusters))
    for i in range(1, len(noise)):
        noise[i] = r * noise[i - 1] + np.sqrt(1 - r**2) * noise[i]
    return noise.T.ravel()


def likeliest(x, y, sizes, inflation):
    """The size by the restricted likelihood: of what no parameter of the curve can change."""
    own, bend = x[:, :-FUNCTIONS], x[:, -FUNCTIONS:] * SMOOTH
    basis = np.linalg.qr(own, mode="complete")[0][:, own.shape[1] :]
    values, vectors = np.linalg.eigh(basis.T @ bend @ bend.T @ basis)
    variance = inflation + np.square(sizes)[:, None] * np.maximum(values, 0.0)
    square = (vectors.T @ basis.T @ y) ** 2
    return sizes[np.argmin(np.sum(np.log(variance) + square / variance, axis=1))]


@pytest.mark.parametrize("true_size", [0.03, 0.2])
def test_the_size_is_the_likeliest(true_size):
    generator = np.random.default_rng(1)
    x, cluster = scattered(generator)
    x, cluster = x[::6], cluster[::6]
    factors = true_size * SMOOTH * generator.normal(size=FUNCTIONS)
    y = x @ np.append([0.02, 3.0], factors) + generator.normal(size=len(x))
    found = found_for(x, y, cluster)
    assert 1.0 <= found.inflation < 2.5
    assert found.size > 1e-3
    # The sizes that are considered are 12 % apart.
    truth = likeliest(x, y, np.geomspace(1e-3, 1.0, 181), found.inflation)
    assert found.size == pytest.approx(truth, rel=0.08)


@pytest.mark.parametrize("true_size", [0.0, 0.2])
def test_of_fewer_slips_than_functions_the_size_is_the_likeliest_too(true_size):
    """Some functions are then sums of others, and rounding says which of them are known."""
    generator = np.random.default_rng(11)
    x, cluster = model(generator.permuted(np.tile(np.linspace(0.01, 0.2, 8), CLUSTERS * EACH // 8)))
    factors = true_size * SMOOTH * generator.normal(size=FUNCTIONS)
    y = x @ np.append([0.02, 3.0], factors) + generator.normal(size=len(x))
    found = [found_for(x, y * (1 + 1e-14 * k), cluster) for k in range(12)]
    inflation = found[0].inflation
    assert [one.inflation for one in found] == pytest.approx([inflation] * 12, rel=1e-9)
    truth = likeliest(x, y, np.geomspace(1e-3, 1.0, 181), inflation)
    assert [one.size for one in found] == pytest.approx([truth] * 12, rel=0.08)


def test_the_penalty_its_cost_and_its_degrees_follow_from_the_size():
    generator = np.random.default_rng(2)
    x, cluster = scattered(generator)
    y = x @ np.append([0.0, 0.0], 0.1 * SMOOTH * generator.normal(size=FUNCTIONS))
    found = found_for(x, y + generator.normal(size=len(x)), cluster)
    prior = (found.size * SMOOTH) ** 2
    np.testing.assert_allclose(found.penalty, found.inflation / prior, rtol=1e-10)

    own, bend = x[:, :-FUNCTIONS], x[:, -FUNCTIONS:]
    bend = bend - own @ np.linalg.lstsq(own, bend)[0]
    information = bend.T @ bend
    narrowing = np.eye(FUNCTIONS) + information * prior / found.inflation
    assert found.occam == pytest.approx(0.5 * np.linalg.slogdet(narrowing)[1], rel=1e-6)
    taken = np.linalg.solve(information + np.diag(found.penalty), information)
    assert found.degrees == pytest.approx(np.trace(taken), rel=1e-6)


def test_the_departure_is_the_same_wherever_the_sums_of_a_linear_model_are_taken():
    generator = np.random.default_rng(3)
    x, cluster = scattered(generator)
    y = x @ np.append([0.0, 0.0], 0.1 * SMOOTH * generator.normal(size=FUNCTIONS))
    y = y + generator.normal(size=len(x))
    here = found_for(x, y, cluster)
    there = found_for(x, y, cluster, factors=0.05 * generator.normal(size=FUNCTIONS))
    assert here.size == there.size
    assert here.inflation == pytest.approx(there.inflation, rel=1e-6)


def test_without_a_departure_the_size_is_at_its_least_in_most_draws():
    generator = np.random.default_rng(4)
    x, cluster = scattered(generator)
    found = [found_for(x, generator.normal(size=len(x)), cluster) for _ in range(40)]
    assert np.mean([one.size <= 1e-3 for one in found]) > 0.5
    assert np.median([one.inflation for one in found]) < 1.5
    # What noise makes of it, if anything, is a small share of the curve.
    assert np.quantile([one.size for one in found], 0.9) < 0.03


def test_a_planted_departure_is_found_within_a_factor_of_two():
    generator = np.random.default_rng(5)
    x, cluster = scattered(generator)
    sizes = []
    for _ in range(40):
        factors = 0.1 * SMOOTH * generator.normal(size=FUNCTIONS)
        y = x @ np.append([0.01, 1.0], factors) + generator.normal(size=len(x))
        sizes.append(found_for(x, y, cluster).size)
    assert 0.05 < np.median(sizes) < 0.2
    assert min(sizes) > 0.01


def true_inflation(x, covariance):
    """The variance of the functions' score under this noise, over that of independent rows."""
    own, bend = x[:, :-FUNCTIONS], x[:, -FUNCTIONS:] * SMOOTH
    bend = bend - own @ np.linalg.lstsq(own, bend)[0]
    return np.trace(bend.T @ covariance @ bend) / np.sum(bend**2)


@pytest.mark.long
@pytest.mark.parametrize("single_log", [False, True])
def test_slow_noise_is_not_taken_for_a_departure(single_log):
    """The slip sweeps up once in a run, or again and again in one log."""
    generator = np.random.default_rng(6)
    x, run = model(np.tile(np.linspace(0.0, 0.2, EACH), CLUSTERS))
    rows = np.arange(len(x))
    covariance = 0.9 ** np.abs(np.subtract.outer(rows, rows))
    block, cluster = run, None
    if single_log:
        block, cluster = rows // 3, np.zeros(len(x) // 3, dtype=int)
    else:
        covariance = np.where(np.equal.outer(run, run), covariance, 0.0)
    noises = [autoregression(generator, 0.9, 1 if single_log else CLUSTERS) for _ in range(60)]
    found = [found_for(x, noise, block, cluster=cluster) for noise in noises]

    truth = true_inflation(x, covariance)
    assert truth > 6
    assert np.median([one.inflation for one in found]) == pytest.approx(truth, rel=0.3)
    assert np.mean([one.size <= 1e-3 for one in found]) > 0.5

    # Were each row a cluster of its own, the same noise would be taken for a departure.
    alone = [found_for(x, noise, rows) for noise in noises[:10]]
    assert np.mean([one.size > 0.01 for one in alone]) > 0.7


def test_a_few_outliers_far_away_do_not_pass_for_noise():
    """They pull at functions of which nothing else tells, and have no information themselves."""
    generator = np.random.default_rng(7)
    x, cluster = scattered(generator)
    far = np.array([30, 31, 400, 640, 641, 642])
    slip = generator.uniform(0.0, 0.2, len(x))
    slip[far] = generator.uniform(0.5, 0.7, far.size)
    x[:, 2:] = 0.3 * np.asarray(functions(slip, 0.01, 0.7)) / NOISE
    x[far, :2] = 1 / NOISE, 0.0
    factors = 0.02 * SMOOTH * generator.normal(size=FUNCTIONS)
    z = x[:, 2:] @ factors + generator.normal(size=len(x))
    near = np.setdiff1d(np.arange(len(x)), far)
    z -= x[:, :2] @ np.linalg.lstsq(x[near, :2], z[near])[0]
    z[far] = 40.0
    pull = np.minimum(1.0, 2.0 / np.abs(z))
    sums = summed(x * (pull >= 1)[:, None], z, cluster)._replace(
        score=summed(x, z * pull, cluster).score,
        pulled=summed(x * np.sqrt(pull)[:, None], z, cluster).pulled,
    )
    free = np.ones(x.shape[1], dtype=bool)
    told = departure_of(sums, np.zeros(FUNCTIONS), free, np.arange(CLUSTERS), True)
    assert told.inflation < 1.5
