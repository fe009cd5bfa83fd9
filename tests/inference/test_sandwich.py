"""Standard errors by clusters and by cosines, against dense matrices of a linear model."""

import numpy as np
import pytest
import statsmodels.api as sm

from adhesion_jax.curves import CURVES, free_values
from adhesion_jax.curves.bent import FUNCTIONS
from adhesion_jax.inference.law import FittedLaw, Span
from adhesion_jax.inference.rows import Rows
from adhesion_jax.inference.sandwich import COSINES, by_clusters, by_cosines, sandwich
from adhesion_jax.inference.sums import Sums, sums
from adhesion_jax.inference.weighing import alike

#: Rows of each cluster: unequal, so that leverage differs.
SIZES = (3, 9, 4, 7, 5, 12, 6, 3, 8, 5)

#: A penalty on the last two of four columns.
PENALTY = np.array([0.0, 0.0, 3.0, 10.0])


def design(generator, sizes=SIZES, columns=4):
    """Columns that are alike within a cluster, and the cluster of each row."""
    cluster = np.repeat(np.arange(len(sizes)), sizes)
    between = generator.normal(size=(len(sizes), columns))
    x = 0.7 * between[cluster] + generator.normal(size=(cluster.size, columns))
    x[:, 0] = 1.0
    return x, cluster


def summed(x, residual, block):
    """The sums of a linear model whose residuals have the variance 1."""
    count = int(block[-1]) + 1
    score, matrix = np.zeros((count, x.shape[1])), np.zeros((count, x.shape[1], x.shape[1]))
    np.add.at(score, block, x * residual[:, None])
    np.add.at(matrix, block, x[:, :, None] * x[:, None, :])
    squares = np.bincount(block, residual**2)
    return Sums(0.5 * squares, score, matrix, squares, residual, matrix.sum(axis=0))


def dense(x, penalty):
    """B, the inverse of the information with the penalty, and the hat matrix."""
    inverse = np.linalg.inv(x.T @ x + np.diag(penalty))
    return inverse, x @ inverse @ x.T


def found_for(x, y, block, penalty, *, cluster=None, ordered=False, inflation=1.0, free=None):
    _, hat = dense(x, penalty)
    cluster = np.arange(int(block[-1]) + 1) if cluster is None else cluster
    free = np.ones(x.shape[1], dtype=bool) if free is None else free
    return sandwich(summed(x, y - hat @ y, block), cluster, free, penalty, inflation, ordered)


def symmetric_root(matrix):
    """The inverse of the symmetric root."""
    values, vectors = np.linalg.eigh(matrix)
    return vectors @ np.diag(values**-0.5) @ vectors.T


def dense_clusters(x, y, cluster, penalty, direction):
    """The variance CR2 and its degrees of freedom, by matrices of all rows."""
    inverse, hat = dense(x, penalty)
    left = np.eye(len(y)) - hat
    residual, variance = left @ y, 0.0
    g = np.zeros((len(y), int(cluster[-1]) + 1))
    for one in range(g.shape[1]):
        here = cluster == one
        g[here, one] = symmetric_root(left[np.ix_(here, here)]) @ x[here] @ inverse @ direction
        variance += (g[here, one] @ residual[here]) ** 2
    eigenvalues = np.linalg.eigvalsh(g.T @ left @ g)
    return variance, eigenvalues.sum() ** 2 / np.sum(eigenvalues**2)


def drawn_covariance(x, penalty):
    """Of y: independent noise, and penalised parameters drawn from the prior of the penalty."""
    penalised = penalty > 0
    return np.eye(len(x)) + x[:, penalised] / penalty[penalised] @ x[:, penalised].T


def expected(variance_of, covariance):
    """The expectation of a quadratic form of y, exactly: its sum over the columns of a root."""
    return sum(variance_of(column) for column in np.linalg.cholesky(covariance).T)


@pytest.mark.parametrize("penalty", [np.zeros(4), PENALTY])
def test_the_variance_by_clusters_is_that_of_the_dense_formula(penalty):
    generator = np.random.default_rng(1)
    x, cluster = design(generator)
    y = generator.normal(size=len(x)) + generator.normal(size=len(SIZES))[cluster]
    found = found_for(x, y, cluster, penalty)
    directions = np.vstack([np.eye(4), generator.normal(size=(3, 4))])
    variance, degrees = by_clusters(found.clusters, directions @ found.root)
    truth = [dense_clusters(x, y, cluster, penalty, direction) for direction in directions]
    np.testing.assert_allclose(variance, [v for v, _ in truth], rtol=1e-9)
    np.testing.assert_allclose(degrees, [d for _, d in truth], rtol=1e-9)
    # Both are far from those of rows that are taken as independent, so the test tells them apart.
    assert np.all(degrees < len(SIZES))
    assert np.all(variance > 0)


def test_blocks_within_clusters_change_nothing():
    generator = np.random.default_rng(2)
    x, cluster = design(generator)
    y = generator.normal(size=len(x))
    whole = found_for(x, y, cluster, PENALTY)
    rows = np.arange(len(x))
    cut = found_for(x, y, rows, PENALTY, cluster=cluster)
    np.testing.assert_allclose(whole.errors(np.eye(4)), cut.errors(np.eye(4)), rtol=1e-10)


@pytest.mark.parametrize("penalty", [np.zeros(4), PENALTY])
def test_independent_noise_makes_the_variance_by_clusters_unbiased(penalty):
    """With the prior of the departure the whole is the variance of the estimate about the truth."""
    generator = np.random.default_rng(3)
    x, cluster = design(generator)
    inverse, _ = dense(x, penalty)
    direction = generator.normal(size=4)

    def square(y):
        found = found_for(x, y, cluster, penalty)
        return by_clusters(found.clusters, (direction @ found.root)[None])[0][0]

    def whole(y):
        return found_for(x, y, cluster, penalty).errors(direction[None])[0][0] ** 2

    mean = expected(square, drawn_covariance(x, penalty))
    of_noise = direction @ inverse @ x.T @ x @ inverse @ direction
    assert mean == pytest.approx(of_noise, rel=1e-9)

    y = generator.normal(size=len(x))
    assert mean + whole(y) - square(y) == pytest.approx(direction @ inverse @ direction, rel=1e-9)


def test_the_prior_counts_by_its_inflation_with_eight_degrees_of_freedom():
    generator = np.random.default_rng(4)
    x, cluster = design(generator)
    y = generator.normal(size=len(x))
    direction = np.array([0.5, -1.0, 2.0, 1.0])
    error, degrees = found_for(x, y, cluster, PENALTY, inflation=2.5).errors(direction[None])
    inverse, _ = dense(x, PENALTY)
    variance, own = dense_clusters(x, y, cluster, PENALTY, direction)
    prior = 2.5 * direction @ inverse @ np.diag(PENALTY) @ inverse @ direction
    assert error[0] ** 2 == pytest.approx(variance + prior, rel=1e-9)
    satterthwaite = (variance + prior) ** 2 / (variance**2 / own + prior**2 / 8)
    assert degrees[0] == pytest.approx(satterthwaite, rel=1e-9)


def test_a_held_parameter_is_as_if_it_were_known():
    generator = np.random.default_rng(5)
    x, cluster = design(generator)
    y = generator.normal(size=len(x))
    kept = np.array([True, False, True, True])
    _, hat = dense(x[:, kept], PENALTY[kept])
    found = sandwich(
        summed(x, y - hat @ y, cluster), np.arange(len(SIZES)), kept, PENALTY, 1.0, False
    )
    errors, degrees = found.errors(np.eye(4))
    less = found_for(x[:, kept], y, cluster, PENALTY[kept]).errors(np.eye(3))
    np.testing.assert_allclose(errors[kept], less[0], rtol=1e-9)
    np.testing.assert_allclose(degrees[kept], less[1], rtol=1e-9)
    assert errors[1] < 1e-100


def test_a_cluster_that_alone_tells_a_parameter_is_as_if_both_were_left_out():
    """A cluster of one row with a parameter of its own has the leverage 1."""
    generator = np.random.default_rng(6)
    x, cluster = design(generator, (1, *SIZES), 3)
    y = generator.normal(size=len(x))
    own = np.column_stack([x, cluster == 0])
    errors, degrees = found_for(own, y, cluster, np.zeros(4)).errors(np.eye(4)[:3])
    rest = found_for(x[1:], y[1:], cluster[1:] - 1, np.zeros(3)).errors(np.eye(3))
    np.testing.assert_allclose(errors, rest[0], rtol=1e-5)
    np.testing.assert_allclose(degrees, rest[1], rtol=1e-4)


@pytest.mark.parametrize("weighted", [False, True])
def test_many_small_clusters_have_the_errors_of_statsmodels(weighted):
    generator = np.random.default_rng(7)
    x, cluster = design(generator, (5,) * 300, 3)
    weight = generator.uniform(0.2, 3.0, len(x)) if weighted else np.ones(len(x))
    y = x @ [0.3, -0.2, 0.1] + 0.5 * generator.normal(size=300)[cluster]
    y = y + generator.normal(size=len(x)) / np.sqrt(weight)
    truth = sm.WLS(y, x, weights=weight).fit(
        cov_type="cluster", cov_kwds={"groups": cluster, "use_correction": False}
    )
    scaled = x * np.sqrt(weight)[:, None]
    errors, degrees = found_for(scaled, y * np.sqrt(weight), cluster, np.zeros(3)).errors(np.eye(3))
    np.testing.assert_allclose(errors, truth.bse, rtol=0.02)
    # CR0 is biased downwards, and the leverage of 300 clusters is small.
    assert np.all(errors > truth.bse)
    assert np.all(degrees > 50)
    alone = sm.WLS(y, x, weights=weight).fit()
    assert errors[0] > 1.2 * alone.bse[0]


def test_a_row_of_double_weight_counts_as_two_rows():
    curve = CURVES["polach"]
    slip = np.linspace(0.002, 0.2, 12)
    adhesion = 0.3 + 0.02 * np.random.default_rng(8).normal(size=12)
    design_weight = np.where(np.arange(12) % 3 == 0, 2.0, 1.0)
    twice = np.repeat(np.arange(12), design_weight.astype(int))

    def told(chosen, weight):
        edges = np.searchsorted(chosen, [0, 4, 8, 12])
        whole = np.array([0, chosen.size])
        rows = Rows(
            slip[chosen], adhesion[chosen], {}, weight, whole, edges, np.arange(3), True, True
        )
        place = np.append(np.asarray(free_values(curve)), np.full(FUNCTIONS, 0.01))
        stretch = np.ones(place.size)
        variance = alike(rows)
        law = FittedLaw(curve, place, Span(0.01, 0.2), {})
        return sums(rows, law, stretch, variance, False, edges)

    once, doubled = told(np.arange(12), design_weight), told(twice, np.ones(twice.size))
    for name in ("loss", "score", "matrix", "squares", "pulled"):
        np.testing.assert_allclose(getattr(once, name), getattr(doubled, name), rtol=1e-10)


def cosine_variance(x, y, direction, penalty):
    found = found_for(x, y, np.arange(len(y)), penalty, ordered=True)
    return by_cosines(found.blocks, (direction @ found.root)[None])[0]


def test_the_variance_of_a_mean_by_cosines_is_the_published_formula():
    """Lazarus, Lewis, Stock and Watson 2018: the mean square of the cosine transforms, over T."""
    count = 90
    y = np.cumsum(np.random.default_rng(9).normal(size=count))
    t = np.arange(1, count + 1)
    transforms = [
        np.sqrt(2 / count) * np.sum(np.cos(np.pi * j * (t - 0.5) / count) * y)
        for j in range(1, COSINES + 1)
    ]
    found = cosine_variance(np.ones((count, 1)), y, np.ones(1), np.zeros(1))
    assert found == pytest.approx(np.mean(np.square(transforms)) / count, rel=1e-9)


@pytest.mark.parametrize("penalty", [np.zeros(3), np.array([0.0, 0.0, 4.0])])
def test_white_noise_makes_the_variance_by_cosines_unbiased(penalty):
    """The rows tell more at the end than at the start."""
    generator = np.random.default_rng(10)
    x = generator.normal(size=(60, 3)) * np.linspace(0.3, 2.0, 60)[:, None]
    direction = np.array([1.0, -0.5, 0.8])
    inverse, _ = dense(x, penalty)
    mean = expected(
        lambda y: cosine_variance(x, y, direction, penalty), drawn_covariance(x, penalty)
    )
    assert mean == pytest.approx(direction @ inverse @ x.T @ x @ inverse @ direction, rel=1e-9)


@pytest.mark.long
def test_the_mean_by_cosines_of_draws_of_white_noise_is_the_true_variance():
    generator = np.random.default_rng(11)
    x = np.ones((50, 1))
    squares = [
        cosine_variance(x, y, np.ones(1), np.zeros(1)) for y in generator.normal(size=(1000, 50))
    ]
    error = np.std(squares) / np.sqrt(1000)
    assert abs(np.mean(squares) - 1 / 50) < 4 * error
    # A square of as many degrees of freedom as there are cosines.
    assert np.std(squares) / np.mean(squares) == pytest.approx(np.sqrt(2 / COSINES), rel=0.15)


def test_the_variance_by_cosines_of_an_autoregression_is_its_long_run_variance():
    """Of r = 0.5, three times that of independent rows; the bias is less than 3 %."""
    count, r = 400, 0.5
    lag = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    covariance = r**lag / (1 - r**2)
    x = np.ones((count, 1))
    mean = expected(lambda y: cosine_variance(x, y, np.ones(1), np.zeros(1)), covariance)
    assert mean * count == pytest.approx(1 / (1 - r) ** 2, rel=0.03)


def test_the_larger_variance_counts_and_few_clusters_do_not():
    generator = np.random.default_rng(12)
    x = np.column_stack([np.ones(240), generator.normal(size=240)])
    rows, direction = np.arange(240), np.eye(2)
    slow = 2 * np.sin(np.linspace(0, 2 * np.pi, 240)) + generator.normal(size=240)
    for clusters in (3, 12):
        cluster = rows * clusters // 240
        found = found_for(x, slow, rows, np.zeros(2), cluster=cluster, ordered=True)
        grouped, own = by_clusters(found.clusters, direction @ found.root)
        cosines = by_cosines(found.blocks, direction @ found.root)
        takes = (cosines > grouped) | (own < 4)
        assert takes[0] or clusters == 12
        errors, degrees = found.errors(direction)
        np.testing.assert_allclose(errors**2, np.where(takes, cosines, grouped), rtol=1e-9)
        np.testing.assert_allclose(degrees, np.where(takes, COSINES, own), rtol=1e-9)
