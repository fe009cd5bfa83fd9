"""Kiencke's curve with an unknown initial slope: against scipy, and by Monte Carlo."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lanes import lanes
from scipy.optimize import least_squares

from adhesion_jax.curves.kiencke import Kiencke
from adhesion_jax.identifiers import IDENTIFIERS, Status, identify
from adhesion_jax.records import Known, Record
from adhesion_jax.scenarios.rails import KIENCKE_FREE, KIENCKE_RAILS, QIAN2024

NAME = "kiencke-free"
METHOD = IDENTIFIERS[NAME]
WEIGHT = 0.997


def law(x, slip):
    size = np.abs(slip)
    return x[0] * slip / (1 + x[1] * size + x[2] * size**2)


def parameters_of(rail):
    return [float(getattr(KIENCKE_RAILS[rail], name)) for name in ("a0", "p1", "p2")]


def runs(rail, count, points, sigma=0.01, seed=0):
    rng = np.random.default_rng(seed)
    slip = rng.uniform(0.0, 0.2, (count, points))
    return slip, law(parameters_of(rail), slip) + sigma * rng.normal(size=slip.shape)


def found(slip, adhesion, known=KIENCKE_FREE, method=METHOD):
    """The estimates after one record of all the samples of each run."""

    def of_run(slip, adhesion):
        every = jnp.ones(slip.shape, dtype=bool)
        record = Record(slip, adhesion, every, every, {})
        record = jax.tree.map(lambda column: column[None], record)
        return identify(method, known, record, jax.random.key(0))

    estimate = jax.jit(jax.vmap(of_run))(jnp.asarray(slip), jnp.asarray(adhesion))
    return jax.tree.map(lambda leaf: np.asarray(leaf)[:, 0], estimate)


def values_of(estimate):
    return np.stack([*estimate.values.values()], axis=-1)


def deviations_of(estimate):
    return np.sqrt(np.diagonal(estimate.covariance, axis1=-2, axis2=-1))


@pytest.mark.parametrize("rail", lanes(KIENCKE_RAILS, always=1, long=len(KIENCKE_RAILS)))
def test_it_finds_the_weighted_least_squares_of_scipy_and_their_errors(rail):
    slip, adhesion = runs(rail, 4, 500, 0.003, seed=1)
    estimate = found(slip, adhesion)
    assert np.all(estimate.status == Status.TRUSTED)
    weight = WEIGHT ** np.arange(499, -1, -1)
    for i in range(4):
        best = least_squares(
            lambda x, i=i: np.sqrt(weight) * (law(x, slip[i]) - adhesion[i]),
            [40.0, 100.0, 50.0],
            bounds=(KIENCKE_FREE.lower, KIENCKE_FREE.upper),
            x_scale="jac",
            xtol=1e-14,
            ftol=1e-14,
        )
        slope = best.jac / np.sqrt(weight)[:, None]
        h, g = slope.T @ (weight[:, None] * slope), slope.T @ (weight[:, None] ** 2 * slope)
        bread = np.linalg.inv(h)
        variance = 2 * best.cost / (weight.sum() - np.trace(bread @ g))
        deviation = np.sqrt(variance * np.diagonal(bread @ g @ bread))
        # What slips within an interval tell, a few hundredths of all, moves it by a tenth or two.
        assert np.all(np.abs(values_of(estimate)[i, :3] - best.x) < 0.3 * deviation)
        np.testing.assert_allclose(deviations_of(estimate)[i, :3], deviation, rtol=0.03)


@pytest.mark.long
def test_no_estimate_on_its_way_is_told_as_trusted():
    """Without noise whatever is trusted is the truth, after 4 samples, 10 and 40."""
    truth = parameters_of("dry")
    away, trusted = {}, {}
    for points in (4, 10, 40):
        estimate = found(*runs("dry", 2048, points, 0.0, seed=7))
        off = np.max(np.abs(values_of(estimate)[:, :3] / truth - 1), axis=1) > 1e-3
        told = estimate.status == Status.TRUSTED
        away[points], trusted[points] = np.sum(off), np.mean(told)
        assert not np.any(off & told)
    assert away[10] > 100
    assert trusted[10] > 0.85
    assert trusted[40] == 1


@pytest.mark.long
def test_it_is_at_the_bound_of_the_samples_that_it_remembers_and_knows_it():
    for rail in ("dry", "common"):
        slip, adhesion = runs(rail, 256, 600, seed=2)
        estimate = found(slip, adhesion)
        curve = KIENCKE_RAILS[rail]
        a0, p1, p2 = 40.0, float(curve.p1), float(curve.p2)
        d = 1 + p1 * slip + p2 * slip**2
        g = np.stack([slip / d, -a0 * slip**2 / d**2, -a0 * slip**3 / d**2], axis=-1)
        weight = WEIGHT ** np.arange(599, -1, -1)
        h = np.mean(np.einsum("rni,rnj,n->rij", g, g, weight), axis=0)
        meat = np.mean(np.einsum("rni,rnj,n->rij", g, g, weight**2), axis=0)
        total, bread = p1 + 2 * np.sqrt(p2), np.linalg.inv(h)
        slope = np.array([1.0, -a0 / total, -a0 / total / np.sqrt(p2)]) / total
        bound = 0.01 * np.sqrt(slope @ bread @ meat @ bread @ slope)
        error = estimate.values["mu_max"] - a0 / total
        # 256 runs: a standard error of .044 of the RMSE and of .014 of the coverage.
        assert np.sqrt(np.mean(error**2)) == pytest.approx(bound, rel=0.16)
        assert abs(np.mean(error)) < 4 * bound / np.sqrt(256)
        for quantity, true in (("mu_max", a0 / total), ("slip_opt", p2**-0.5)):
            place = [*estimate.values].index(quantity)
            inside = np.abs(estimate.values[quantity] - true) < (
                1.96 * deviations_of(estimate)[:, place]
            )
            assert 0.95 - 4 * 0.014 < np.mean(inside) < 0.95 + 4 * 0.014


@pytest.mark.long
def test_a_slope_that_is_told_wrong_misleads_riv_and_not_this_one():
    """On a rail with half the slope that is told."""
    rng = np.random.default_rng(3)
    slip = rng.uniform(0.0, 0.2, (32, 1000))
    truth = np.array([20.0, 20.0 / 0.3 - 2 / 0.1, 100.0])
    adhesion = law(truth, slip) + 0.01 * rng.normal(size=slip.shape)
    stream = dataclasses.replace(QIAN2024, by_sample=True)
    errors = {
        name: np.mean(found(slip, adhesion, known, IDENTIFIERS[name]).values["mu_max"]) / 0.3 - 1
        for name, known in (("riv", stream), (NAME, KIENCKE_FREE))
    }
    assert abs(errors["riv"]) > 0.02
    assert abs(errors[NAME]) < 0.002


def test_the_linear_form_has_no_footing_where_the_slope_is_unknown():
    """Least squares of mu = a0 l - p1 l mu - p2 l^2 mu on the wet rail, as the docstring says."""
    slip, adhesion = runs("wet", 16, 4000)
    peak = 40.0 / (KIENCKE_RAILS["wet"].p1 + 2 * np.sqrt(KIENCKE_RAILS["wet"].p2))
    errors = []
    for s, mu in zip(slip, adhesion, strict=True):
        x = np.linalg.lstsq(np.stack([s, -s * mu, -(s**2) * mu], axis=1), mu, rcond=None)[0]
        x[2] = max(x[2], 1.0)  # that of a peak at slip 1
        errors.append(x[0] / (x[1] + 2 * np.sqrt(x[2])) / peak - 1)
    assert np.mean(errors) == pytest.approx(0.85, abs=0.05)


@pytest.mark.thorough
def test_braking_standstill_and_samples_that_are_no_numbers_change_nothing():
    slip, adhesion = runs("common", 2, 200, seed=5)
    expected = values_of(found(slip, adhesion))
    sign = np.where(np.arange(200) % 3 == 0, -1.0, 1.0)
    np.testing.assert_allclose(values_of(found(sign * slip, sign * adhesion)), expected, rtol=1e-9)
    at = np.arange(10, 200, 10)
    for one, other in ((0.0, 0.05), (np.nan, 0.1), (0.1, np.inf)):
        more = np.insert(slip, at, one, axis=1), np.insert(adhesion, at, other, axis=1)
        np.testing.assert_allclose(values_of(found(*more)), expected, rtol=1e-12)
    counted = np.insert(adhesion, at, np.nan, axis=1)
    np.testing.assert_array_equal(found(np.insert(slip, at, 0.1, axis=1), counted).skipped, 19)


@pytest.mark.long
def test_slip_may_be_a_velocity():
    curve = Kiencke(a0=3.0, p1=5.0, p2=30.0, free=("a0", "p1", "p2"))
    known = Known(curve, [0.2, -0.2, 0.01], [100.0, 1000.0, 1e4], slip_limit=10.0)
    truth = np.array([6.0, 8.0, 1 / 0.15**2])
    slip = np.random.default_rng(6).uniform(0.0, 0.5, (1, 400))
    estimate = found(slip, law(truth, slip), known)
    assert estimate.values["slip_opt"][0] == pytest.approx(0.15, rel=1e-3)
    assert estimate.values["mu_max"][0] == pytest.approx(6 / (8 + 2 / 0.15), rel=1e-4)


def test_it_declines_a_curve_of_which_a_parameter_is_known():
    assert METHOD.accepts(KIENCKE_FREE) is None
    assert METHOD.accepts(dataclasses.replace(KIENCKE_FREE, by_sample=True)) is None
    assert "a0, p1 and p2 unknown" in METHOD.accepts(QIAN2024)
