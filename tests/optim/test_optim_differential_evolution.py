import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lanes import lanes
from scipy import stats
from scipy.optimize import differential_evolution

from adhesion_jax.optim.differential_evolution import (
    Search,
    Settings,
    _three_others,
    as_integer,
    as_uniform,
    begin,
    counter_bits,
    generation,
    local_plus_uniform,
    minimise,
)

LOWER = np.array([0.1, 10.0, 0.05])
UPPER = np.array([1.0, 50.0, 0.5])
SIGMA, MEMBERS, SCALE, CROSSOVER = 0.01, 20, 0.5, 0.6

SLIP = np.linspace(0.0, 0.2, 100)
DRY = 0.8287 * (1 - np.exp(-45.45 * SLIP)) - 0.4 * SLIP
DATA = DRY + SIGMA * np.random.default_rng(1).normal(size=SLIP.size)

#: The test statistics below are the same on every run: a small p is a difference, not bad luck.
LEAST_P = 1e-3


def settings(reflect=False, tolerance=0.0, scale=SCALE, crossover=CROSSOVER):
    return Settings(*map(jnp.asarray, (scale, crossover, reflect, tolerance, -jnp.inf)))


def sum_of_squares(x):
    a, nu, b = x
    slip = jnp.asarray(SLIP)
    model = a * (1 - jnp.exp(-nu * slip)) - b * slip
    return jnp.sum((jnp.asarray(DATA) - model) ** 2)


def uniform_population(key):
    share, radius, reflect = map(jnp.asarray, (0.0, 0.1, False))
    centre = jnp.asarray(0.5 * (LOWER + UPPER))
    return local_plus_uniform(
        key, centre, jnp.asarray(LOWER), jnp.asarray(UPPER), share, radius, reflect, MEMBERS
    )


#: A box so far out that no trial meets it: here alone the two libraries differ by design (scipy
#: draws a trial outside the box anew, we clip or mirror it).
FAR = LOWER - 5 * (UPPER - LOWER), UPPER + 5 * (UPPER - LOWER)


@functools.partial(jax.jit, static_argnames=("generations", "runs"))
def search(seed, generations, runs, box, settings):
    """The best objective of each run after a fixed number of generations."""

    def one(key):
        population_key, search_key = jax.random.split(key)
        population = uniform_population(population_key)
        return minimise(sum_of_squares, population, *box, search_key, settings, generations)

    return jax.vmap(one)(jax.random.split(jax.random.key(seed), runs))


def ours(generations, runs, box=FAR, seed=1, **changes):
    box = tuple(map(jnp.asarray, box))
    return np.asarray(search(seed, generations, runs, box, settings(**changes)).objective)


@functools.cache
def scipys(generations, runs, far=True):
    """The same search by scipy, whose generations end at the same counts."""
    box = FAR if far else (LOWER, UPPER)
    slip, data = SLIP[:, None], DATA[:, None]

    def objective(x):
        residual = data - x[0] * (1 - np.exp(-x[1] * slip)) + x[2] * slip
        return np.sum(residual**2, axis=0)

    found = []
    for run in range(runs):
        rng = np.random.default_rng([generations, run])
        found.append(
            differential_evolution(
                objective,
                list(zip(*box, strict=True)),
                strategy="rand1bin",
                init=rng.uniform(LOWER, UPPER, (MEMBERS, 3)),
                mutation=SCALE,
                recombination=CROSSOVER,
                maxiter=generations,
                tol=0.0,
                atol=-1.0,  # never stops early
                polish=False,
                updating="deferred",
                vectorized=True,
                rng=rng,
            ).fun
        )
    return np.array(found)


def gap(objective):
    """Above the optimum, in units of the noise variance."""
    least = float(ours(1000, 1)[0])
    return (objective - least) / SIGMA**2


@pytest.mark.parametrize("generations", lanes([15, 40], always=0, thorough=1))
def test_objectives_have_the_distribution_of_scipys_at_the_same_settings(generations):
    # Before convergence, where every detail of mutation and crossover shows.
    here, there = ours(generations, 600), scipys(generations, 200)
    assert np.median(gap(here)) > 1e-3
    assert stats.ks_2samp(here, there).pvalue > LEAST_P
    failed = [[np.sum(gap(o) > 1), np.sum(gap(o) <= 1)] for o in (here, there)]
    assert stats.fisher_exact(failed).pvalue > LEAST_P


@pytest.mark.thorough
@pytest.mark.parametrize("change", [{"scale": 0.6}, {"crossover": 0.9}])
def test_that_comparison_sees_other_settings(change):
    assert stats.ks_2samp(ours(15, 600, **change), scipys(15, 200)).pvalue < LEAST_P


@pytest.mark.parametrize("reflect", lanes([False, True], always=0, thorough=1))
def test_in_the_papers_box_the_search_is_as_good_as_scipys(reflect):
    here, there = ours(60, 600, (LOWER, UPPER), reflect=reflect), scipys(60, 100, far=False)
    assert np.mean(gap(there) > 1) < 0.03
    assert np.mean(gap(here) > 1) < 0.03
    ratio = np.median(gap(here)) / np.median(gap(there))
    assert 1 / 3 < ratio < 3
    late = gap(ours(300, 600, (LOWER, UPPER), reflect=reflect))
    assert np.mean(late > 1e-6) < 0.03
    assert np.quantile(late, 0.9) < 1e-9


SEED = jnp.array([0x12345678, 0x9ABCDEF0], dtype=jnp.uint32)


def parents(generations, members):
    seeds = jnp.broadcast_to(SEED[:, None], (2, generations))
    drawn = _three_others(seeds, jnp.arange(generations), members)
    return np.moveaxis(np.asarray(drawn), -1, 0)  # [generations, 3, members]


@pytest.mark.parametrize("members", [4, 5, 20])
def test_parents_are_three_different_others(members):
    drawn = parents(3000, members)
    own = np.broadcast_to(np.arange(members), (3000, 1, members))
    assert drawn.min() == 0
    assert drawn.max() == members - 1
    four = np.sort(np.concatenate([drawn, own], axis=1), axis=1)
    assert np.all(np.diff(four, axis=1) > 0)


def test_every_triple_of_parents_is_equally_likely():
    members, generations = 5, 20_000
    drawn = parents(generations, members)
    for own in range(members):
        code = drawn[:, 0, own] * 25 + drawn[:, 1, own] * 5 + drawn[:, 2, own]
        counts = np.unique(code, return_counts=True)[1]
        assert counts.size == 24  # 4 * 3 * 2
        assert stats.chisquare(counts).pvalue > LEAST_P
    # Parents of neighbours, and of one member in turn, know nothing of each other.
    for first, second in (
        (drawn[:, 0, 0], drawn[:, 0, 1]),
        (drawn[:-1, 0, 2], drawn[1:, 0, 2]),
    ):
        table = stats.contingency.crosstab(first, second).count
        assert stats.chi2_contingency(table).pvalue > LEAST_P


def bits(time, purpose, members=1000):
    return counter_bits(SEED, jnp.asarray(time), purpose, members)


def test_counter_bits_are_uniform_and_independent():
    drawn = np.asarray(jnp.stack([bits(t, p) for t in range(6) for p in range(1, 6)]))
    uniform = np.asarray(as_uniform(jnp.asarray(drawn)))
    assert uniform.min() >= 0
    assert uniform.max() < 1
    assert stats.kstest(uniform.ravel(), "uniform").pvalue > LEAST_P
    for shift in range(32):
        ones = int(np.sum(drawn >> shift & 1))
        assert stats.binomtest(ones, drawn.size).pvalue > LEAST_P / 32
    # Across members, times and purposes: correlations of size 1/sqrt(n) at most.
    centred = (uniform - 0.5) * np.sqrt(12)
    streams = centred @ centred.T / 1000
    assert np.max(np.abs(streams - np.diag(np.diag(streams)))) < 5.5 / np.sqrt(1000)
    for lag in (1, 2, 20):
        assert abs(np.mean(centred[:, lag:] * centred[:, :-lag])) < 4 / np.sqrt(drawn.size)
    assert np.unique(drawn).size > drawn.size - 5
    other = counter_bits(SEED + jnp.uint32(1), jnp.asarray(0), 1, 1000)
    assert not np.any(np.asarray(other) == drawn[0])
    for bound in (3, 17, 20):
        integers = np.asarray(as_integer(jnp.asarray(drawn), bound)).ravel()
        counts = np.bincount(integers, minlength=bound)
        assert counts.size == bound
        assert stats.chisquare(counts).pvalue > LEAST_P


def outward(x):
    """Smaller the farther out: drives every member into a corner of the box."""
    return -jnp.sum(jnp.abs(x - jnp.asarray(0.5 * (LOWER + UPPER))))


def flat(_):
    """Accepts every trial."""
    return jnp.zeros(())


def advanced(state, objective, chosen, box=(LOWER, UPPER)):
    """One run after one more generation, the first of which evaluates the population."""
    given = jax.tree.map(lambda x: jnp.asarray(x)[..., None], (*box, SEED, chosen))

    def of_members(x):
        return jax.vmap(objective, in_axes=1)(x[..., 0])[:, None]

    return generation(of_members, Search(*given), state, jnp.asarray(True))


def evaluated(population, objective, box=(LOWER, UPPER)):
    return advanced(begin(population[..., None]), objective, settings(), box)


@pytest.mark.parametrize("reflect", [False, True])
def test_the_box_is_respected(reflect):
    step = jax.jit(lambda state: advanced(state, outward, settings(reflect, scale=1.9)))
    state = evaluated(uniform_population(jax.random.key(3)), outward)
    for _ in range(60):
        state = step(state)
        x = np.asarray(state.population)[..., 0]
        assert np.all(x >= LOWER[:, None])
        assert np.all(x <= UPPER[:, None])
    on_bound = np.isin(x, [*LOWER, *UPPER])
    # Clipping reaches the corner itself, reflection comes near it.
    assert np.all(on_bound[:, np.argmin(state.objective[:, 0])]) or reflect
    assert np.min(state.objective) < 0.97 * float(outward(jnp.asarray(UPPER)))


def test_clipping_and_reflection_place_a_trial_where_they_should():
    # One parameter, crossover certain, an objective that accepts everything.
    box = jnp.zeros(1), jnp.ones(1)
    population = jnp.array([[0.05, 0.5, 0.9, 0.3, 0.7, 0.1]])
    trials = {}
    for reflect in (False, True):
        chosen = settings(reflect, scale=1.0, crossover=1.0)
        state = advanced(evaluated(population, flat, box), flat, chosen, box)
        trials[reflect] = np.asarray(state.population)[0, :, 0]
    first, second, third = parents(1, 6)[0]
    x = np.asarray(population)[0]
    mutant = x[first] + x[second] - x[third]
    assert np.any(mutant < 0) or np.any(mutant > 1)
    np.testing.assert_allclose(trials[False], np.clip(mutant, 0, 1), atol=1e-15)
    mirrored = np.where(mutant < 0, -mutant, np.where(mutant > 1, 2 - mutant, mutant))
    np.testing.assert_allclose(trials[True], mirrored, atol=1e-15)


def test_a_generation_never_loses_ground_and_a_member_never_mixes_with_another():
    population = uniform_population(jax.random.key(4))
    before = evaluated(population, sum_of_squares)
    np.testing.assert_array_equal(before.population[..., 0], population)
    after = advanced(before, sum_of_squares, settings())
    assert np.all(after.objective <= before.objective)
    of_members = jax.vmap(sum_of_squares, in_axes=1)(after.population[..., 0])
    np.testing.assert_allclose(after.objective[:, 0], of_members, rtol=1e-12)
    first, second, third = parents(1, MEMBERS)[0]
    mutant = population[:, first] + SCALE * (population[:, second] - population[:, third])
    mutant = np.clip(mutant, LOWER[:, None], UPPER[:, None])
    now = after.population[..., 0]
    kept, taken = (np.isclose(now, v, rtol=1e-14) for v in (population, mutant))
    assert np.all(kept | taken)
    improved = np.asarray(after.objective < before.objective)[:, 0]
    assert np.all(taken.any(axis=0) | ~improved)
    assert 0.05 < improved.mean() < 0.95


def test_crossover_takes_the_share_asked_for_and_at_least_one():
    population = uniform_population(jax.random.key(5))
    step = jax.jit(lambda state, chosen: advanced(state, flat, chosen, FAR))
    begun = evaluated(population, flat)
    for crossover in (0.0, 0.6, 1.0):
        changed = []
        for time in range(100):
            state = begun._replace(generation=jnp.full(1, time, jnp.int32))
            state = step(state, settings(crossover=crossover))
            changed.append(np.asarray(state.population[..., 0] != population))
        changed = np.stack(changed)
        assert np.all(changed.any(axis=1))
        expected = 1 / 3 + 2 / 3 * crossover
        error = np.sqrt(expected * (1 - expected) / changed.size)
        assert abs(changed.mean() - expected) <= 4 * error
        assert np.all(np.abs(changed.mean(axis=(0, 2)) - expected) <= 7 * error)


@jax.jit
def one_run(target, key):
    """A run on its own data, with its own time to stop."""

    def objective(x):
        return jnp.sum((x - target) ** 2)

    population_key, search_key = jax.random.split(key)
    return minimise(
        objective,
        uniform_population(population_key),
        jnp.asarray(LOWER),
        jnp.asarray(UPPER),
        search_key,
        settings(tolerance=1e-3),
        80,
    )


@pytest.mark.long
def test_a_stopped_run_does_not_depend_on_its_neighbours():
    keys = jax.random.split(jax.random.key(6), 16)
    # Some optima outside the box, where the spread vanishes at a corner; some never stop in time.
    targets = np.random.default_rng(6).uniform(0.2 * LOWER, 1.2 * UPPER, (16, 3))
    batch = jax.vmap(one_run)(jnp.asarray(targets), keys)
    assert len(set(np.asarray(batch.generations).tolist())) > 4
    assert set(np.asarray(batch.converged).tolist()) == {True, False}
    for size in (1, 5):
        part = jax.vmap(one_run)(jnp.asarray(targets[:size]), keys[:size])
        for alone, together in zip(part, batch, strict=True):
            np.testing.assert_array_equal(alone, together[:size])
    reversed_ = jax.vmap(one_run)(jnp.asarray(targets[::-1]), keys[::-1])
    for backwards, forwards in zip(reversed_, batch, strict=True):
        np.testing.assert_array_equal(backwards[::-1], forwards)


def test_a_run_stops_when_its_spread_is_small_and_says_so():
    targets = jnp.asarray(np.array([[0.5, 30.0, 0.2], [0.05, 60.0, 0.6]]))
    result = jax.vmap(one_run)(targets, jax.random.split(jax.random.key(7), 2))
    np.testing.assert_array_equal(result.evaluations, (result.generations + 1) * MEMBERS)
    # Outside the box the least objective is not zero, so the relative spread can vanish.
    assert list(result.converged) == [False, True]
    assert int(result.generations[0]) == 80
    assert 1 < int(result.generations[1]) < 80
    corner = np.array([LOWER[0], UPPER[1], UPPER[2]])
    np.testing.assert_allclose(result.x[1], corner, rtol=0.02)
    expected = np.sum((np.asarray(result.x[1]) - np.asarray(targets[1])) ** 2)
    assert float(result.objective[1]) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(("share", "count"), [(0.0, 0), (0.5, 10), (1.0, 20)])
def test_the_initial_population_is_local_and_uniform_in_the_shares_asked_for(share, count):
    centre = np.array([0.5, 30.0, 0.3])
    keys = jax.random.split(jax.random.key(8), 400)
    drawn = jax.vmap(
        lambda key: local_plus_uniform(
            key, *map(jnp.asarray, (centre, LOWER, UPPER, share, 0.05, False)), MEMBERS
        )
    )(keys)
    x = (np.asarray(drawn) - LOWER[:, None]) / (UPPER - LOWER)[:, None]  # [runs, p, members]
    assert x.min() >= 0
    assert x.max() <= 1
    at = (centre - LOWER) / (UPPER - LOWER)
    for axis in range(3):
        local, uniform = x[:, axis, :count].ravel(), x[:, axis, count:].ravel()
        if local.size:
            assert stats.kstest(local, "norm", (at[axis], 0.05)).pvalue > LEAST_P
        if uniform.size:
            assert stats.kstest(uniform, "uniform").pvalue > LEAST_P
    flat = x.transpose(1, 0, 2).reshape(3, -1)
    correlation = np.corrcoef(flat)[np.triu_indices(3, 1)]
    assert np.all(np.abs(correlation) < 4.5 / np.sqrt(flat.shape[1]))


@pytest.mark.parametrize("reflect", [True, False])
def test_local_members_around_a_centre_on_the_bound_are_brought_into_the_box(reflect):
    drawn = jax.vmap(
        lambda key: local_plus_uniform(
            key, *map(jnp.asarray, (LOWER, LOWER, UPPER, 1.0, 0.1, reflect)), MEMBERS
        )
    )(jax.random.split(jax.random.key(9), 200))
    x = (np.asarray(drawn)[:, 1].ravel() - LOWER[1]) / (UPPER[1] - LOWER[1])
    assert x.min() >= 0
    if not reflect:  # clipped: half of them end on the bound itself
        assert np.mean(x == 0) == pytest.approx(0.5, abs=4.5 * 0.5 / np.sqrt(x.size))
    assert stats.kstest(x[x > 0], "halfnorm", (0.0, 0.1)).pvalue > LEAST_P
