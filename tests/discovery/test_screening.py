"""The score test of the library: its numbers, its size where nothing is, its power."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
from discovery_campaigns import (
    POINTS,
    RUNS,
    SIZE,
    TRUE,
    alone,
    campaign,
    curve,
    levels,
    noise,
    seen,
)
from scipy import stats
from scipy.interpolate import CubicSpline

from adhesion_jax.discovery.model.fitting import nearly_fitted
from adhesion_jax.discovery.search import rules
from adhesion_jax.discovery.search.catalogue import Entry, library_of
from adhesion_jax.discovery.search.probes import (
    beside_levels,
    beside_smoothing,
    directions_of,
    null_of,
    signals,
    split,
    stretches,
)
from adhesion_jax.discovery.search.screening import (
    FLIPS,
    _gained,
    _of_runs,
    _variance,
    least_p,
    orthonormal,
    screen,
    signed,
)
from adhesion_jax.effects import Covariate, Labels, Memory, Spline
from adhesion_jax.effects.shape import ACTS_ON
from experiments.campaigns.simulator import SetNoise, simulate


@pytest.fixture(scope="module")
def table():
    """Nothing but the curve and noise of 2 %."""
    draw = np.random.default_rng(11)
    table = campaign(draw)
    return table.assign(adhesion=curve(table["slip_ratio"]) + noise(draw))


@pytest.fixture(scope="module")
def fitted(table):
    return alone(table)


@pytest.fixture(scope="module")
def null(fitted):
    return null_of(fitted)


@pytest.fixture(scope="module")
def library(fitted):
    return library_of(fitted.setting.problem)


def line(column, acts_on="level", k=0.02):
    start = Covariate(k, 0.1, 0.7, column=column, acts_on=acts_on)
    return Entry(f"covariate:{column}", (start,), (column,), True, column, acts_on)


def of_rows(null, values):
    """An array [runs, points] at the points that there are."""
    return np.asarray(values)[null.inside]


# ------------------------------------------------------------------------------- what is given


@pytest.mark.parametrize("acts_on", ACTS_ON)
def test_a_probe_is_the_derivative_of_the_prediction_times_its_function(null, table, acts_on):
    """Of mu exp(g), mu(l exp(g)), mu + g, mu(l + g) and of the loss beyond the peak, by g."""
    fitted = null.fitted
    data = fitted.setting.problem.data
    slip, mu = of_rows(null, data.slip), of_rows(null, fitted.adhesion)
    # The fitted curve is smooth in slip: its slope by a spline through points apart.
    apart = np.unique((slip / 2e-4).astype(int), return_index=True)[1]
    slope = CubicSpline(slip[apart], mu[apart]).derivative()(slip)
    top = mu.max()
    derivative = {
        "level": mu,
        "slip": slope * slip,
        "offset": np.ones_like(mu),
        "shift": slope,
        "fall": np.where(slip > slip[mu.argmax()], mu - top, 0.0),
    }[acts_on]
    g = (table["warm"].to_numpy() - 0.1) / 0.7
    (found,) = signals(null, [line("warm", acts_on).starts[0]]).T
    expected = of_rows(null, fitted.setting.root) * derivative * 0.02 * g
    size = np.abs(expected).max()
    inside = np.abs(slip) > 3e-3
    np.testing.assert_allclose(found[inside], expected[inside], atol=0.03 * size)


def test_smoothing_a_slip_that_is_noisy_is_given_and_a_memory_of_it_is_not(table):
    """No mean over neighbours on both sides is left; what came before a point alone is left."""
    draw = np.random.default_rng(3)
    rough = table["slip_ratio"] + 1e-3 * draw.normal(size=len(table))
    fitted = alone(table.assign(slip_ratio=rough, adhesion=curve(rough) + noise(draw)))
    setting, rough = fitted.setting, rough.to_numpy().reshape(RUNS, POINTS)
    slope = TRUE[0] * TRUE[1] * np.exp(-TRUE[1] * np.abs(rough)) - TRUE[2]
    places = np.arange(POINTS)

    def beside(signal, k):
        """What the signal was k points before, or is -k points ahead, less what it is.

        At the ends of a run the last point stands in for the neighbour that it lacks.
        """
        return signal[:, np.clip(places - k, 0, POINTS - 1)] - signal

    def left(spread, change, given=lambda null: null):
        whole = np.full(setting.root.shape, spread)
        null = given(null_of(fitted._replace(setting=setting._replace(spread=whole))))
        flat = setting.root[null.inside] * change.ravel()
        flat = beside_levels(null, flat[:, None])[:, 0]
        kept = flat - null.basis @ (null.basis.T @ flat)
        return np.linalg.norm(kept) / np.linalg.norm(flat)

    ahead, before = (slope * beside(rough, k) for k in (-1, 1))
    assert left(0.0, ahead + before) > 0.5
    assert left(1e-3, ahead + before) < 0.1
    assert left(1e-3, before) > 0.4
    # A mean whose weights fall over many neighbours.
    long = sum(np.exp(-k / 9) * (beside(rough, k) + beside(rough, -k)) for k in range(1, 50))
    assert left(1e-3, slope * long) < 0.1
    # Those of the prediction, which is not linear in a noisy slip, are given beside memories.
    predicted = np.asarray(fitted.adhesion)[:RUNS, :POINTS]
    for k in (1, 2):
        both = beside(predicted, k) + beside(predicted, -k)
        assert left(1e-3, both, beside_smoothing) < 0.1
        assert left(0.0, both, beside_smoothing) > 0.5
    assert left(1e-3, beside(predicted, 1), beside_smoothing) > 0.4


def test_a_column_that_is_constant_within_runs_may_bend(library):
    """It has as many values as there are runs, however many points a run has."""
    kinds = {
        type(start).__name__
        for entry in library
        if entry.name == "covariate:warm"
        for start in entry.starts
    }
    assert kinds == {"Covariate", "Spline"}


def test_no_function_of_the_slip_is_left_to_be_found(null, table):
    """Whatever bends the curve itself, alone or as a constant in the place of a column."""
    fitted = null.fitted
    root = of_rows(null, fitted.setting.root)
    mu, slip = of_rows(null, fitted.adhesion), of_rows(null, fitted.setting.problem.data.slip)
    bends = [mu, mu * slip, mu * np.sin(25 * slip), mu * np.exp(-slip / 0.02), 1 + 0 * mu]
    for bend in bends:
        whole = beside_levels(null, (root * bend)[:, None])[:, 0]
        left = whole - null.basis @ (null.basis.T @ whole)
        assert np.linalg.norm(left) < 0.03 * np.linalg.norm(whole)
    np.testing.assert_allclose(null.basis.T @ null.basis, np.eye(null.basis.shape[1]), atol=1e-9)
    # What a column does to the level is left, whether or not it moves within the runs.
    for column in ("warm", "gust"):
        whole = beside_levels(null, (root * mu * table[column].to_numpy())[:, None])[:, 0]
        left = whole - null.basis @ (null.basis.T @ whole)
        assert np.linalg.norm(left) > 0.7 * np.linalg.norm(whole - whole.mean())


def test_a_direction_is_what_is_given_cannot_explain(null):
    probes = [line("warm").starts[0], line("gust", "slip").starts[0]]
    testable, flat = directions_of(null, probes)
    assert testable.all()
    whole = beside_levels(null, signals(null, probes))
    for found, signal in zip(flat.T, whole.T, strict=True):
        left = signal - null.basis @ np.linalg.lstsq(null.basis, signal, rcond=None)[0]
        np.testing.assert_allclose(found, left / np.linalg.norm(left), atol=1e-9)


def test_a_term_of_several_strengths_is_the_sum_of_what_each_multiplies(null):
    (start,) = Spline.starts({"gust": null.fitted.setting.problem.flat["gust"]})
    strengths = start.FACTS.strengths
    sizes = dict(zip(strengths, np.linspace(-0.03, 0.05, len(strengths)), strict=True))
    probe = replace(start, **sizes)
    problem = null.fitted.setting.problem
    column = problem.data.columns[problem.columns.index("gust")]
    g = np.asarray(probe.log_factor({"gust": jnp.asarray(column)}))
    (found,) = signals(null, [probe]).T
    changed = null.fitted.setting.root * null.changed["level"] * g
    np.testing.assert_allclose(found, changed[null.inside], rtol=1e-9, atol=1e-12)


# ------------------------------------------------------------------------- one direction by hand


def by_hand(null, start):
    """The normal deviate of F of a start, with matrices over all points."""
    x = orthonormal(directions_of(null, split([start])[0])[1])
    left = np.eye(len(x)) - null.basis @ null.basis.T - x @ x.T
    run = np.nonzero(null.inside)[0]
    of_run = 1.0 * (run[:, None] == np.unique(run))  # [points, runs]
    squares, traces, freedoms = [], [], []
    for one in x.T:
        # What the scores of runs beside the effect covary by, if errors are independent.
        scores = one[:, None] * of_run
        covariance = scores.T @ left @ scores
        larger = np.sqrt((scores**2).sum(axis=0) / np.diag(covariance))
        covariance *= np.outer(larger, larger)
        squares.append(((larger * (scores.T @ left @ null.residual)) ** 2).sum())
        traces.append(np.trace(covariance))
        freedoms.append(np.trace(covariance) ** 2 / (covariance**2).sum())
    k, b = x.shape[1], x.T @ null.residual
    f = (b @ b / k) / (np.sum(squares) / np.sum(traces))
    return stats.norm.isf(stats.f.sf(f, k, np.mean(freedoms) * np.sqrt(k)))


def check_by_hand(now, entry, rel):
    (score,) = screen([([now], [entry])], seed=5)
    assert score.z == pytest.approx(by_hand(now, entry.starts[0]), rel=rel)
    # Of one form alone, one in a hundred.
    assert score.needed == pytest.approx(stats.norm.isf(0.01), abs=0.1)
    return score


def test_what_is_ordinary_under_signs_is_told_by_them_and_all_else_by_its_runs(null):
    """The limit is a deviate of one, to a twentieth of it."""
    start = line("gust").starts[0]
    block = orthonormal(directions_of(null, [start])[1])
    draw, firsts = np.random.default_rng(41), stretches(null, 0.0)
    ordinary, others = [], []
    for _ in range(400):
        now = null._replace(residual=beside(null, draw.normal(size=len(block))))
        (z,), _ = signed(now, [block], 0)
        sums = np.add.reduceat(block[:, 0] * now.residual, firsts)
        by_signs = stats.norm.isf(stats.chi2.sf(sums.sum() ** 2 / (sums**2).sum(), 1))
        is_told = z == pytest.approx(by_signs, abs=1e-9)
        (ordinary if is_told else others).append(by_signs)
    assert 0.95 < max(ordinary) <= 1.0 < min(others) < 1.05


def beside(null, errors):
    return errors - null.basis @ (null.basis.T @ errors)


def test_runs_alike_are_held_against_students_t():
    """One score a run: their mean against its error; and two groups of runs against each other."""
    draw = np.random.default_rng(2)
    u = draw.normal(size=12)
    even = np.full((12, 1, 1), 1 / 12)
    variance, freedom = _variance(u[:, None], even, np.zeros((1, 12, 1)))
    assert u.sum() ** 2 / variance == pytest.approx(stats.ttest_1samp(u, 0)[0] ** 2)
    assert freedom == pytest.approx(11)
    group = np.repeat([1.0, -1.0], 6)
    e = u - u.mean()
    variance, freedom = _variance((group * e)[:, None] / 12**0.5, even, group[None, :, None] / 12)
    t = stats.ttest_ind(u[:6], u[6:])[0]
    assert (group @ e / 12**0.5) ** 2 / variance == pytest.approx(t**2)
    assert freedom == pytest.approx(10)


@pytest.mark.parametrize("sizes", [(1.0, 1.0, 1.0, 1.0, 1.0), (5.0, 1.0, 1.0, 1.0, 1.0)])
def test_one_p_in_a_hundred_is_a_hundredth_however_unlike_the_directions_scatter(sizes):
    """Of 2,000 draws of 20 runs; with five degrees of freedom it would be one in 17 of the second.

    A chance of one in a thousand is left to the draws.
    """
    draw, draws = np.random.default_rng(7), 2000
    even, nothing = np.broadcast_to(np.eye(5) / 20, (20, 5, 5)), np.zeros((5, 20, 1))
    small = 0
    for _ in range(draws):
        u = draw.normal(size=(20, 5)) * sizes / 20**0.5
        variance, *freedom = _of_runs(u, even, nothing)
        small += stats.f.sf(np.sum(u.sum(axis=0) ** 2) / variance, *freedom) <= 0.01
    low, high = stats.binom.ppf([5e-4, 1 - 5e-4], draws, 0.01)
    assert low <= small <= high


@pytest.mark.long
def test_a_lag_that_hides_its_curve_is_told_by_the_slip_before():
    """Of 15 s in runs of 10 s: the fitted curve is nearly flat, and no lag of it explains much."""
    hidden = SetNoise(sigma=0.01, autocorrelation=0.3, run_scatter=0.005)
    made = simulate(["lag"], seed=367, base="exponential", noise=hidden, strength=0.5, **SIZE)
    fitted = alone(made.train)
    (lag,) = [one for one in library_of(fitted.setting.problem) if one.name == "lag"]
    (score,) = screen([([null_of(fitted, within=True)], [lag])], seed=5)
    assert score.p <= rules.SIGNIFICANT
    assert score.start.time_constant == made.parameters["lag"]["time_constant"]


def test_z_of_one_direction_is_the_deviate_of_its_f(null, table):
    draw = np.random.default_rng(3)
    adhesion = curve(table["slip_ratio"]) * np.exp(0.03 * table["warm"]) + noise(draw)
    score = check_by_hand(seen(null, adhesion.to_numpy()), line("warm"), 0.01)
    assert 2 < score.z < 8


def test_several_directions_are_held_against_the_scatter_beside_their_own_effect(null, table):
    """Of the four levels of a label, which a variance of one direction at a time would hide."""
    draw = np.random.default_rng(8)
    level = table["place"].map({"a": 1.0, "b": 0.9, "c": 1.08, "d": 0.97}).to_numpy()
    now = seen(null, (curve(table["slip_ratio"]) * level).to_numpy() + noise(draw))
    entries = [one for one in library_of(null.fitted.setting.problem) if one.acts_on == "level"]
    (entry,) = [one for one in entries if isinstance(one.starts[0], Labels)]
    assert check_by_hand(now, entry, 0.02).p == least_p(RUNS)


def in_few_runs(null, count):
    """The null of the first runs alone."""
    setting = null.fitted.setting
    kept = (np.arange(setting.root.shape[0]) < count)[:, None]
    setting = setting._replace(root=setting.root * kept)
    return null_of(nearly_fitted(setting, "burckhardt", TRUE, ()))


@pytest.fixture(scope="module")
def eight(null):
    return in_few_runs(null, 8)


@pytest.mark.long
def test_of_eight_runs_one_form_in_twenty_has_a_p_of_a_twentieth(eight):
    """Of 400 draws of errors with levels of the runs, but for one chance in 1000."""
    draw, entries = np.random.default_rng(1), [line("gust"), line("load", "offset")]
    told = {entry.name: [] for entry in entries}
    for _ in range(400):
        rows = int(eight.inside.sum())
        whole = draw.normal(size=rows) + 0.1 * np.repeat(draw.normal(size=8), POINTS)
        now = eight._replace(residual=whole - eight.basis @ (eight.basis.T @ whole))
        for entry in entries:
            (score,) = screen([([now], [entry])], 0)
            told[entry.name].append(score.z)
    for z in told.values():
        for level in (0.01, 0.05, 0.2):
            count = int(np.sum(np.array(z) >= stats.norm.isf(level)))
            assert count <= stats.binom.isf(1e-3, 400, level)
        assert np.mean(np.array(z) >= stats.norm.isf(0.2)) > 0.12


def test_what_rests_on_few_runs_is_not_tested(null):
    three = in_few_runs(null, 3)
    assert screen([([three], [line("gust"), line("warm")])], seed=0) == ()
    # Nor what is different in one run of many.
    spike = Covariate(0.02, 0.0, 1.0, column="old")
    problem = null.fitted.setting.problem
    columns = np.array(problem.data.columns)
    columns[problem.columns.index("old")] = (np.arange(columns.shape[1]) == 4)[:, None]
    changed = problem._replace(data=problem.data._replace(columns=columns), terms={})
    fitted = null.fitted._replace(setting=null.fitted.setting._replace(problem=changed))
    entry = Entry("covariate:old", (spike,), ("old",), True, "old")
    assert screen([([null._replace(fitted=fitted)], [entry])], seed=0) == ()


def test_p_falls_to_that_of_all_draws_and_no_further(null, table):
    adhesion = curve(table["slip_ratio"]) * np.exp(0.2 * table["gust"])
    (score,) = screen([([seen(null, adhesion.to_numpy())], [line("gust")])], seed=0)
    assert score.p == 1 / (1 + FLIPS)


def test_gains_are_those_of_ridge_fits_without_the_run():
    draw = np.random.default_rng(4)
    run = np.repeat(np.arange(6), [9, 12, 7, 11, 10, 8])
    x, _ = np.linalg.qr(draw.normal(size=(run.size, 3)))
    e = draw.normal(size=run.size) + 3 * x @ [1.0, -1.0, 0.5]
    ends = np.flatnonzero(np.diff(run, prepend=-1))
    gains, change = _gained(x, e, ends)
    best = None
    for ridge in (0.02, 0.2, 1.0):
        found = []
        for number in range(6):
            some, own = run != number, run == number
            left = x[some].T @ x[some] + ridge * np.eye(3)
            b = np.linalg.solve(left, x[some].T @ e[some])
            found.append(0.5 * ((e[own] ** 2).sum() - ((e[own] - x[own] @ b) ** 2).sum()))
        if best is None or sum(found) > sum(best[0]):
            best = found, x @ (x.T @ e) / (1 + ridge)
    np.testing.assert_allclose(gains, best[0], rtol=1e-9)
    np.testing.assert_allclose(change, best[1], rtol=1e-9)


# ------------------------------------------------------------------------------ size and power


def drawn(null, table, draw, degrees=np.inf):
    """The curve with noise of AR .8 within runs and levels of runs that scatter by 3 %."""
    clean = curve(table["slip_ratio"]).to_numpy()
    return seen(null, clean * levels(draw, table) + noise(draw, degrees=degrees))


def claims_of(null, table, library, draws, degrees):
    """The smallest p of each of some draws of noise."""
    found = []
    for seed in range(draws):
        draw = np.random.default_rng([21, seed])
        scores = screen([([drawn(null, table, draw, degrees)], library)], seed)
        found.append(min(score.p for score in scores))
    return np.array(found)


def few_enough(found):
    """Whether p is at most .01, .05 and .2 no oftener than it says, but for one chance in 1000."""
    return [
        int(np.sum(found <= level)) <= stats.binom.isf(1e-3, found.size, level)
        for level in (0.01, 0.05, 0.2)
    ]


@pytest.mark.parametrize("degrees", [pytest.param(np.inf, marks=pytest.mark.long), 3.0])
def test_where_nothing_is_hidden_p_is_as_rarely_small_as_it_says(null, table, library, degrees):
    """Of everything in the library: lines, splines, labels and memories of columns, and causes."""
    kinds = {type(start) for entry in library for start in entry.starts}
    assert {Covariate, Labels, Memory} <= kinds
    still = [entry for entry in library if entry.covariates[0] in ("warm", "old", "place")]
    found = claims_of(null, table, still, 40, degrees)
    assert few_enough(found) == [True] * 3


@pytest.mark.thorough
@pytest.mark.parametrize("degrees", [np.inf, 3.0])
def test_in_four_hundred_sets_of_noise_one_in_a_hundred_is_claimed(null, table, library, degrees):
    found = claims_of(null, table, library, 400, degrees)
    assert few_enough(found) == [True] * 3
    # Nor is it much rarer, so that power is not given away.
    assert np.mean(found <= 0.2) > 0.08


PLANTED = {
    "level": lambda mu, slip, z: mu(slip) * np.exp(0.03 * z),
    "slip": lambda mu, slip, z: mu(slip * np.exp(0.15 * z)),
    "offset": lambda mu, slip, z: mu(slip) + 0.008 * z,
    "shift": lambda mu, slip, z: mu(slip + 0.0008 * z),
    "fall": lambda mu, slip, z: np.where(
        slip > 0.066, 0.2934 - (0.2934 - mu(slip)) * np.exp(0.5 * z), mu(slip)
    ),
}


@pytest.mark.parametrize("acts_on", ACTS_ON)
def test_what_a_column_does_to_a_part_of_the_curve_is_found_there(null, table, library, acts_on):
    """Planted by its formula in the exact curve, whose peak of .2934 is at .066."""
    draw = np.random.default_rng(31)
    z = (table["gust"] / table["gust"].std()).to_numpy()
    adhesion = PLANTED[acts_on](curve, table["slip_ratio"].to_numpy(), z)
    now = seen(null, adhesion + noise(draw, correlation=0.5, sigma=0.0025))
    scores = screen([([now], library)], seed=0)
    assert scores[0].entry.name == "covariate:gust"
    assert scores[0].p <= rules.SIGNIFICANT
    best = max(scores, key=lambda score: score.gains.sum())
    assert best.entry.acts_on == acts_on
    assert best.entry.name == "covariate:gust"


@pytest.mark.parametrize("acts_on", ["offset", "shift"])
def test_an_offset_or_a_shift_may_be_a_curve_over_its_column(null, table, library, acts_on):
    """cos(pi z/2) is the same at both ends of the column: no line goes with it."""
    draw = np.random.default_rng(34)
    z = np.cos(0.5 * np.pi * table["warm"].to_numpy())
    adhesion = PLANTED[acts_on](curve, table["slip_ratio"].to_numpy(), 2.0 * (z - z.mean()))
    now = seen(null, adhesion + noise(draw, correlation=0.5, sigma=0.0025))
    scores = screen([([now], library)], seed=0)
    p = {score.form: score.p for score in scores}
    assert p["covariate:warm", Spline, acts_on] <= rules.SIGNIFICANT
    assert p["covariate:warm", Covariate, acts_on] > 0.1


@pytest.mark.long
def test_a_curve_over_the_bulk_of_a_column_of_long_tails_is_found():
    """Half of the data lie below a fortieth of its range."""
    draw = np.random.default_rng(36)
    table = campaign(draw).assign(wear=lambda own: np.exp(1.2 * own["gust"] / own["gust"].std()))
    wave = np.cos(1.5 * np.pi * table["wear"].rank() / len(table))
    assert table["wear"].median() < table["wear"].min() + np.ptp(table["wear"]) / 40
    made = curve(table["slip_ratio"]) * np.exp(0.02 * wave) + noise(draw, correlation=0.5)
    whole = table.drop(columns="gust").assign(adhesion=made)
    null = null_of(alone(whole), within=True)
    best = screen([([null], library_of(null.fitted.setting.problem))], seed=0)[0]
    assert best.form == ("covariate:wear", Spline, "level")
    assert best.p <= rules.SIGNIFICANT


def test_labels_are_found_where_each_has_a_level_of_its_own(null, table, library):
    draw = np.random.default_rng(32)
    level = table["place"].map({"a": 1.0, "b": 0.9, "c": 1.08, "d": 0.97}).to_numpy()
    clean = curve(table["slip_ratio"].to_numpy()) * level
    scores = screen([([seen(null, clean + noise(draw))], library)], seed=0)
    found = [score for score in scores if score.p == 1 / (1 + FLIPS)]
    assert ("covariate:place", Labels, "level") in [score.form for score in found]
    best = max(scores, key=lambda score: score.gains.sum())
    assert best.entry.name == "covariate:place"


@pytest.mark.long
def test_a_column_of_two_names_is_found_as_names_and_one_of_two_numbers_as_a_line():
    draw = np.random.default_rng(35)
    table = campaign(draw)
    scraper = np.where(table["run"] % 2, "on", "off")
    level = np.where(scraper == "on", 1.06, 1.0)
    whole = table.assign(adhesion=curve(table["slip_ratio"]) * level + noise(draw))
    for column, kind in ((scraper, Labels), (1.0 * (scraper == "on"), Covariate)):
        null = null_of(alone(whole.assign(scraper=column)))
        library = library_of(null.fitted.setting.problem)
        own = {type(one.starts[0]) for one in library if one.covariates == ("scraper",)}
        assert own == {kind}
        scores = screen([([null], library)], seed=0)
        assert scores[0].form == ("covariate:scraper", kind, "level")
        assert scores[0].p == 1 / (1 + FLIPS)


def test_a_memory_is_found_where_the_column_alone_is_not_enough(null, table, library):
    """With a time constant of 1.2 s, by the recursion for samples .1 s apart."""
    draw = np.random.default_rng(33)
    kept = np.exp(-0.1 / 1.2)
    gust = table["gust"].to_numpy().reshape(RUNS, POINTS)
    y = gust.copy()
    for point in range(1, POINTS):
        y[:, point] = kept * y[:, point - 1] + (1 - kept) * gust[:, point]
    clean = curve(table["slip_ratio"].to_numpy()) * np.exp(0.06 * y.ravel())
    scores = screen([([seen(null, clean + noise(draw))], library)], seed=0)
    best = max(scores, key=lambda score: score.gains.sum())
    assert best.form == ("covariate:gust", Memory, "level")
    assert best.p == 1 / (1 + FLIPS)
    assert float(best.start.time_constant) == pytest.approx(1.2)
