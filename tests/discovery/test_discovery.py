import jax
import numpy as np
import pytest
from discovery_campaigns import SIZE, problem_of
from lanes import lanes
from scipy import stats
from scipy.linalg import solve_triangular
from scipy.optimize import least_squares

from adhesion_jax.curves import BASES, with_free_values
from adhesion_jax.discovery.model.bases import first_fits, fits_alone
from adhesion_jax.discovery.model.fitting import (
    Setting,
    fit_model,
    loss_without,
    own_noise,
    squares,
)
from adhesion_jax.discovery.model.noise import estimated, white_noise, whitening
from adhesion_jax.discovery.model.prediction import Gain, expected_loss, gain, held_out_loss
from adhesion_jax.discovery.model.program import effect_places, whiten
from adhesion_jax.discovery.search.catalogue import Entry
from adhesion_jax.discovery.search.pruning import pruned
from adhesion_jax.discovery.search.screening import Score
from adhesion_jax.discovery.search.state import Accepted, settled
from adhesion_jax.discovery.search.trials import Trial, class_of, ranked
from adhesion_jax.effects import EFFECTS, Covariate
from adhesion_jax.effects.law import with_effects
from adhesion_jax.simulation.simulator import simulate

SIGMA, CORRELATION, SCATTER = 0.007, 0.4, 0.005


def noise_of(weight, sigma=SIGMA, correlation=CORRELATION, scatter=SCATTER):
    return white_noise(weight, sigma)._replace(
        autocorrelation=np.array(correlation), run_scatter=np.array(scatter)
    )


def roots(level, inside, noise):
    """Cholesky factors of the covariance of each run, stated in full."""
    found = []
    for mean, there in zip(level, inside, strict=True):
        place = np.arange(there.sum())
        stationary = float(noise.autocorrelation) ** np.abs(place[:, None] - place)
        both = float(noise.run_scatter) ** 2 * np.outer(mean[there], mean[there])
        found.append(np.linalg.cholesky(float(noise.sigma) ** 2 * stationary + both))
    return found


def white(signal, inside, factors):
    """Of each run, its signal by the inverse of its Cholesky factor."""
    return [
        solve_triangular(factor, run[there], lower=True)
        for run, there, factor in zip(signal, inside, factors, strict=True)
    ]


@pytest.fixture(scope="module")
def hot():
    """A campaign in which temperature and a lag act, some of its runs shorter than others."""
    table = simulate(["temperature", "lag"], seed=1, base="burckhardt", **SIZE).train
    place = table.groupby("run").cumcount()
    lengths = {name: 100 - 7 * (number % 4) for number, name in enumerate(table["run"].unique())}
    return problem_of(table[place < table["run"].map(lengths)])


@pytest.fixture(scope="module")
def setting(hot):
    level = 0.3 + 0.0 * hot.points
    return Setting(hot, noise_of(hot.points), level)


@pytest.mark.parametrize("length", [7, 4])
def test_whitening_is_by_the_inverse_of_the_stated_covariance(length):
    draw = np.random.default_rng(1)
    level, signals = draw.normal(0.3, 0.1, (3, 7)), draw.normal(size=(40, 3, 7))
    inside = np.arange(7) < np.array([7, length, length])[:, None]
    noise = noise_of(inside.astype(float), 0.02, 0.6, 0.3)
    found = np.asarray(whiten(whitening(noise, level), signals))
    factors = roots(level, inside, noise)
    for signal, measured in zip(signals, found, strict=True):
        expected = [(part**2).sum() for part in white(signal, inside, factors)]
        np.testing.assert_allclose((measured**2).sum(1), expected, rtol=1e-11)
    assert (found[:, ~inside] == 0).all()


def test_whitened_noise_is_white():
    # As many runs of noise as the moments need for their errors of 1/sqrt(runs).
    draw, runs = np.random.default_rng(2), 20_000
    level = np.broadcast_to([0.1, 0.3, 0.3, 0.2, 0.25], (runs, 5))
    noise = noise_of(np.ones((runs, 5)), 0.01, 0.5, 0.05)
    factor = roots(level[:1], np.ones((1, 5), bool), noise)[0]
    drawn = draw.standard_normal((runs, 5)) @ factor.T
    found = np.asarray(whiten(whitening(noise, level), drawn[None]))[0]
    np.testing.assert_allclose(found.T @ found / runs, np.eye(5), atol=5 * np.sqrt(2 / runs))


def residual_of(setting, base, effects):
    """The whitened residual of each run and its Jacobian, from the free parameters."""
    problem, data = setting.problem, setting.problem.data
    inside = problem.points > 0
    factors = roots(setting.level, inside, setting.noise)
    conditions = {**data.conditions, **dict(zip(problem.columns, data.columns, strict=False))}
    names = [
        [name for name in effect.PARAMETERS if name not in effect.REFERENCES] for effect in effects
    ]

    @jax.jit
    def adhesion(values):
        curve = with_free_values(BASES[base], values[: len(BASES[base].free)])
        place, worn = len(BASES[base].free), []
        for effect, free in zip(effects, names, strict=True):
            numbers = {**vars(effect), **dict(zip(free, values[place:], strict=False))}
            worn.append(type(effect)(**numbers))
            place += len(free)
        return jax.vmap(lambda slip, given: with_effects(curve, tuple(worn), slip, given))(
            data.slip, conditions
        )

    derivative = jax.jit(jax.jacfwd(adhesion))

    def parts(values):
        return white(np.asarray(adhesion(values)) - data.adhesion, inside, factors)

    def jacobian(values):
        change = np.moveaxis(np.asarray(derivative(values)), -1, 0)
        return np.stack([np.concatenate(white(one, inside, factors)) for one in change], axis=1)

    return parts, jacobian


def box(base, effects):
    described = [BASES[base].PARAMETERS[name] for name in BASES[base].free]
    for effect in effects:
        described += [p for name, p in effect.PARAMETERS.items() if name not in effect.REFERENCES]
    return np.array([(one.lower, one.upper) for one in described]).T


def scipys(setting, base, effects, start):
    """The loss at scipy's minimum."""
    parts, jacobian = residual_of(setting, base, effects)
    found = least_squares(
        lambda values: np.concatenate(parts(values)),
        np.clip(start, *(box(base, effects) + np.array([[1e-12], [-1e-12]]))),
        jac=jacobian,
        bounds=box(base, effects),
        x_scale="jac",
        ftol=1e-12,
        xtol=1e-12,
        gtol=1e-12,
        max_nfev=200,
    )
    return found.cost, found.x


@pytest.mark.parametrize("base", lanes([n for n in BASES if n != "level"], always=2, thorough=2))
def test_the_fit_of_a_curve_is_the_minimum_that_scipy_finds(base, setting):
    fitted = first_fits(fits_alone(setting, [base]))[base]
    own = fitted.setting
    cost, _ = scipys(own, base, (), fitted.base_values)
    assert fitted.loss.sum() == pytest.approx(cost, rel=1e-6)
    # And no minimum that is worse than that from typical values, a tenth aside.
    other, _ = scipys(own, base, (), 1.1 * np.asarray(fitted.base_values))
    assert fitted.loss.sum() <= other * (1 + 1e-6)
    # The noise in which it is the minimum is its own: one more turn gains no tenth.
    again = fit_model(own_noise(fitted), base, fitted.base_values.tolist(), ())
    assert fitted.total - 0.1 < again.total


def warm(setting):
    reference = float(np.median(setting.problem.flat["temperature_C"]))
    return EFFECTS["temperature"](k=1e-3, reference=reference)


@pytest.fixture(scope="module")
def fitted(setting):
    """Burckhardt's curve with two effects, one of which acts in time."""
    start = (warm(setting), EFFECTS["lag"](time_constant=0.2))
    return fit_model(setting, "burckhardt", (0.3, 60.0, 0.3), start)


def free_of(fitted):
    return fitted.values[list(fitted.places)]


def test_the_fit_with_effects_is_the_minimum_that_scipy_finds(setting, fitted):
    start = free_of(fitted) * np.array([1.05, 0.9, 1.2, 0.8, 1.3])
    cost, values = scipys(setting, "burckhardt", fitted.effects, start)
    assert fitted.loss.sum() == pytest.approx(cost, rel=1e-6)
    # To a hundredth of a standard error.
    error = np.sqrt(np.diag(np.linalg.inv(fitted.hessian.sum(0))))
    np.testing.assert_allclose((free_of(fitted) - values) / error, 0.0, atol=0.01)


def test_a_fit_that_meets_a_bound_is_the_minimum_inside_it(setting):
    data = setting.problem.data
    rising = np.asarray(data.adhesion) * (1 + 8 * np.abs(data.slip))
    problem = setting.problem._replace(data=data._replace(adhesion=rising))
    own, start = setting._replace(problem=problem), (0.3, 60.0, 0.3)
    effects = (warm(own),)
    fitted = fit_model(own, "burckhardt", start, effects)
    low, high = box("burckhardt", effects)
    assert np.any((free_of(fitted) == low) | (free_of(fitted) == high))
    cost, _ = scipys(own, "burckhardt", effects, np.array([*start, 1e-3]))
    assert fitted.loss.sum() == pytest.approx(cost, rel=1e-6)


def test_loss_gradient_and_hessian_are_those_of_each_run(setting, fitted):
    parts, _ = residual_of(setting, "burckhardt", fitted.effects)
    at = free_of(fitted)
    here = parts(at)
    expected = [0.5 * (run**2).sum() for run in here]
    np.testing.assert_allclose(fitted.loss, expected, rtol=1e-9)
    factors = roots(setting.level, setting.problem.points > 0, setting.noise)
    logs = [np.log(np.diag(factor)).sum() for factor in factors]
    np.testing.assert_allclose(fitted.determinant, logs, rtol=1e-9)
    assert fitted.total == pytest.approx(sum(expected) + sum(logs), rel=1e-9)
    moves = np.diag(1e-5 * np.maximum(np.abs(at), 1e-4))
    slopes = [
        [(up - down) / (2 * move.sum()) for up, down in zip(parts(at + move), parts(at - move),
                                                            strict=True)]
        for move in moves
    ]  # fmt: skip
    for run, residual in enumerate(here):
        jacobian = np.stack([slope[run] for slope in slopes], axis=1)
        size = np.linalg.norm(jacobian, axis=0)
        np.testing.assert_allclose(
            fitted.gradient[run] / size, jacobian.T @ residual / size, atol=1e-4
        )
        np.testing.assert_allclose(
            fitted.hessian[run] / np.outer(size, size),
            jacobian.T @ jacobian / np.outer(size, size),
            atol=1e-5,
        )


def test_what_is_masked_changes_nothing(hot, setting):
    outside = hot.points == 0
    assert outside.any()
    data = hot.data._replace(
        adhesion=np.where(outside, 1e3, hot.data.adhesion),
        slip=np.where(outside, 0.5, hot.data.slip),
    )
    level = np.where(outside, 77.0, setting.level)
    start = (warm(setting),)
    before = fit_model(setting, "burckhardt", (0.3, 60.0, 0.3), start)
    changed = Setting(hot._replace(data=data), setting.noise, level)
    after = fit_model(changed, "burckhardt", (0.3, 60.0, 0.3), start)
    np.testing.assert_allclose(after.loss, before.loss, rtol=1e-12)
    np.testing.assert_allclose(free_of(after), free_of(before), rtol=1e-9)


def without_run(setting, run):
    weight = setting.problem.points * (np.arange(len(setting.problem.points)) != run)[:, None]
    return Setting(setting.problem, setting.noise._replace(weight=weight), setting.level)


def test_a_run_without_weight_is_no_run(setting):
    fitted = fit_model(without_run(setting, 3), "burckhardt", (0.3, 60.0, 0.3), ())
    assert fitted.loss[3] == 0
    assert (fitted.hessian[3] == 0).all()
    assert (held_out_loss(fitted)[3]) == 0


def test_the_held_out_loss_is_that_of_refits_without_the_run(setting, fitted):
    parts, _ = residual_of(setting, "burckhardt", fitted.effects)
    expected = []
    for run in range(len(fitted.loss)):
        values = fitted.base_values.tolist()
        less = fit_model(without_run(setting, run), "burckhardt", values, fitted.effects)
        expected.append(0.5 * (parts(free_of(less))[run] ** 2).sum())
    # What a run loses by being left out is small beside its loss: a twentieth of that is right.
    lost = np.array(expected) - fitted.loss
    assert (lost > 0).all()
    found = held_out_loss(fitted)
    np.testing.assert_allclose(found - fitted.loss, lost, rtol=0.05, atol=0.02)
    assert found.sum() == pytest.approx(sum(expected), rel=1e-3)


def in_blocks(fitted):
    setting = fitted.setting
    return fitted._replace(setting=setting._replace(problem=setting.problem._replace(blocks=True)))


def test_the_loss_without_an_effect_is_that_of_its_quadratic(hot, fitted):
    """By least squares on the linear model in which the effect's strength is held at nothing."""
    gone = fitted.effects[0]
    (name,) = gone.STRENGTHS
    place = fitted.places.index(effect_places(0, gone)[name])
    inside = hot.points > 0
    jacobian, residual = fitted.jacobian[:, inside].T, fitted.residual[inside]
    moved = residual - jacobian[:, place] * fitted.values[fitted.places[place]]
    others = np.delete(jacobian, place, axis=1)
    left = moved - others @ np.linalg.lstsq(others, moved, rcond=None)[0]
    expected = 0.5 * (left @ left - residual @ residual)
    assert loss_without(fitted, [0]) == pytest.approx(expected, rel=1e-4)
    assert expected > 1


def test_points_of_blocks_are_predicted_without_themselves(hot, fitted):
    """By least squares on the linear model that lacks the point."""
    fitted = in_blocks(fitted)
    inside = hot.points > 0
    jacobian, residual = fitted.jacobian[:, inside].T, fitted.residual[inside]
    expected = np.zeros(hot.points.shape)
    alone = []
    for point in range(residual.size):
        others = np.arange(residual.size) != point
        move = np.linalg.lstsq(jacobian[others], -residual[others], rcond=None)[0]
        alone.append(residual[point] + jacobian[point] @ move)
    expected[inside] = 0.5 * np.square(alone)
    found = expected_loss(fitted) - fitted.determinant
    np.testing.assert_allclose(found, expected.sum(axis=1), rtol=1e-5)
    assert (found > fitted.loss).all()


def test_the_error_of_a_gain_between_blocks_is_the_scatter_of_noise(fitted):
    draw = np.random.default_rng(3)
    change = 0.2 * draw.standard_normal(fitted.residual.shape)
    still = in_blocks(fitted)._replace(jacobian=np.zeros_like(fitted.jacobian))

    def drawn():
        noise = draw.standard_normal(change.shape)
        return gain(still._replace(residual=noise + change), still._replace(residual=noise))

    gains = [drawn() for _ in range(800)]
    assert gains[0].error == pytest.approx(np.std([one.total for one in gains]), rel=4 / 40)


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("runs", [10, 28])
def test_a_gain_is_as_sure_as_it_says_though_few_runs_gain_most(runs, sign):
    """Of campaigns without a gain one in twenty is above 1.645, whichever way the runs are skew."""
    draw = np.random.default_rng(7)
    gains = sign * (draw.exponential(size=(4000, runs)) - 1)
    error = np.sqrt(runs) * gains.std(axis=1, ddof=1)
    skewness = stats.skew(gains, axis=1) / np.sqrt(runs)
    given = zip(gains.sum(axis=1), error, skewness, strict=True)
    sure = np.mean([Gain(*one, freedom=runs - 1).deviate > 1.645 for one in given])
    student = np.mean(stats.norm.isf(stats.t.sf(gains.sum(axis=1) / error, runs - 1)) > 1.645)
    # Hall's transformation takes away the term of order 1/sqrt(runs), not all that there is.
    assert abs(sure - 0.05) < 0.7 * abs(student - 0.05)
    assert sure == pytest.approx(0.05, abs=0.12 / np.sqrt(runs))


def test_without_an_error_a_gain_is_sure_and_without_an_end_to_it_it_is_not():
    assert Gain(1.0, 0.0).deviate == np.inf
    assert Gain(0.0, 0.0).deviate == 0.0
    assert Gain(5.0, np.inf).deviate == 0.0
    assert Gain(3.0, 1.5).deviate == pytest.approx(2.0)


def test_a_column_that_its_cause_makes_needless_gives_it_its_name(hot, setting, fitted):
    reference = float(np.median(hot.flat["temperature_C"]))
    column = Covariate(-0.001, reference, 10.0, column="temperature_C")
    lag = EFFECTS["lag"](time_constant=0.2)
    name = "covariate:temperature_C"
    accepted = (
        Accepted("lag", ("lag",), "in time", False, ("slip_ratio",), (lag,), 0.001, 100.0),
        Accepted(name, (name,), "temperature", True, ("temperature_C",), (column, warm(setting)),
                 0.001, 100.0),
    )  # fmt: skip
    state = settled(first_fits(fits_alone(setting, ["burckhardt"])), accepted, ())
    assert len(state.fitted.effects) == 3
    left = pruned(state)
    assert [effect.name for effect in left.accepted] == ["lag", "temperature"]
    assert left.accepted[1].members == ("temperature", name)
    assert not left.accepted[1].generic
    assert squares(left.fitted) == pytest.approx(squares(fitted), rel=0.01)


def test_noise_is_recovered_within_its_sampling_error():
    draw, runs, points = np.random.default_rng(4), 600, 100
    level = 0.3 + 0.1 * draw.random((runs, points))
    inside = np.arange(points) < np.where(np.arange(runs) % 3, points, 60)[:, None]
    noise = noise_of(inside.astype(float), 0.01, 0.5, 0.03)
    residual = np.zeros((runs, points))
    for run, factor in enumerate(roots(level, inside, noise)):
        residual[run, inside[run]] = factor @ draw.standard_normal(inside[run].sum())
    residual[~inside] = 1e3
    start = white_noise(inside.astype(float), 0.02)
    found = estimated(start, residual, level, True, True)
    # Three standard errors: of a variance sqrt(2/n (1 + r^2)/(1 - r^2)), of r sqrt((1 - r^2)/n),
    # of the spread of the runs 1/sqrt(2 runs).
    count = inside.sum()
    assert float(found.sigma) == pytest.approx(
        0.01, rel=3 * np.sqrt(1.25 / 0.75 / 2 / count) + 0.01
    )
    assert float(found.autocorrelation) == pytest.approx(0.5, abs=3 * np.sqrt(0.75 / count))
    assert float(found.run_scatter) == pytest.approx(0.03, rel=3 / np.sqrt(2 * runs))
    still = estimated(start, np.where(inside, 0.0, 1.0), level, True, True)
    assert float(still.run_scatter) == 0


def test_a_class_changes_the_prediction_alike(fitted):
    """Two causes that gain as much are one class only if they explain the same."""
    draw = np.random.default_rng(8)
    runs = len(fitted.loss)
    first, second = draw.standard_normal((2, *fitted.residual.shape))
    now = fitted.residual

    def trial(name, change, gain):
        entry = Entry(name, (EFFECTS["curve"](k=0.1),), ("curvature_per_m",), False, name)
        score = Score(entry, entry.starts[0], 9.0, 0.0005, 3.0)
        losses = 100 - gain + 0.01 * draw.standard_normal(runs)
        changed = fitted._replace(
            residual=now + change, adhesion=fitted.adhesion + change, loss=losses
        )
        return Trial(score, changed, float(expected_loss(changed).sum()))

    before = trial("now", 0 * first, 0.0)
    best = trial("best", first, 5.0)
    alike = trial("alike", 0.8 * first + 0.6 * second, 4.999)
    other = trial("other", 0.3 * first + second, 4.999)
    worse = trial("worse", first, 4.0)
    assert class_of([other, worse, alike, best], best, before) == ("best", "alike")


def test_decisions_of_a_ranking_go_by_the_form_of_an_entry(fitted):
    """Equal copies of scores and trials get the same rows as the scores and trials themselves."""

    def score(name, p):
        entry = Entry(name, (EFFECTS["curve"](k=0.1),), ("curvature_per_m",), False, name)
        return Score(entry, entry.starts[0], 9.0, p, 3.0)

    by_name = {"best": 0.001, "alike": 0.001, "other": 0.002, "idle": 0.01, "far": 0.5}
    scores = [score(name, p) for name, p in by_name.items()]
    trials = [Trial(one._replace(), fitted, 1.0) for one in scores[:3]]
    now = Trial(scores[0], fitted, 2.0)

    def decisions(chosen, accepted):
        rows = ranked(2, scores, trials, now, chosen, ("best", "alike"), accepted)
        assert [row.round for row in rows] == [2] * 5
        return [row.decision for row in rows]

    rest = ["in the class of best", "explains less", "less telling", "not significant"]
    chosen = trials[0]._replace(fitted=fitted._replace())
    assert decisions(chosen, True) == ["accepted", *rest]
    assert decisions(chosen, False) == ["does not lower the held-out error", *rest]
    # A pair that was not scored with the others has no row.
    assert decisions(None, True) == ["in the class of best", *rest]
