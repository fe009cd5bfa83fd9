"""What the prior makes of a term of which the data tell little or nothing."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from discovery_campaigns import SIZE, factor_spreads, setting_of
from scipy import linalg

from adhesion_jax.discovery.model.fitting import fit_model
from adhesion_jax.effects import KINDS
from experiments.campaigns.simulator import simulate


@pytest.fixture(scope="module")
def cold():
    """Runs above the median temperature stay below the peak: of their fall nothing is known."""
    table = simulate(seed=1, base="burckhardt", **SIZE).train
    warm = table["temperature_C"] > table["temperature_C"].median()
    setting = setting_of(table[~(warm & (table["slip_ratio"].abs() > 0.01))])
    column = setting.problem.flat["temperature_C"]
    scale = column.mean(), column.std()
    start = KINDS["spline"](*[0.02] * 5, *scale, column="temperature_C", acts_on="fall")
    return fit_model(setting, "burckhardt", (0.3, 60.0, 0.3), (start,)), start


def heights(spline, strengths):
    """The function of a spline at its six knots."""
    names = [f"k{place}" for place in range(1, 6)]
    changed = dataclasses.replace(spline, **dict(zip(names, strengths, strict=True)))
    shares = jnp.linspace(0.0, 1.0, 6)
    at = spline.mean + spline.spread * 3**0.5 / jnp.pi * jnp.log(shares / (1 - shares))
    return np.asarray(changed.log_factor({"temperature_C": at}))


@pytest.mark.thorough
def test_a_fit_with_a_term_is_the_maximum_of_its_posterior(cold):
    """With N(0, 1.5^2) for the function at each knot, and N(0, .3^2) for its second differences.

    The factors of the departure have spreads of their own; the sums are over all points.
    """
    fitted, start = cold
    free = fitted.values[list(fitted.places)]
    basis = np.stack([heights(start, unit) for unit in np.eye(5)], axis=1)
    bends = factor_spreads(fitted.setting.problem)
    bowed = basis[:-2] - 2 * basis[1:-1] + basis[2:]
    of_spline = basis.T @ basis / 1.5**2 + bowed.T @ bowed / 0.3**2
    precision = linalg.block_diag(np.zeros((3, 3)), np.diag(bends**-2), of_spline)
    jacobian = fitted.jacobian.reshape(fitted.jacobian.shape[0], -1)
    slope = jacobian @ fitted.residual.ravel() + precision @ free
    hessian = jacobian @ jacobian.T + precision
    half = 0.5 * (fitted.residual**2).sum() + 0.5 * free @ precision @ free
    assert fitted.loss.sum() == pytest.approx(half, rel=1e-9)
    np.testing.assert_allclose(fitted.hessian.sum(0), hessian, rtol=1e-8, atol=1e-6)
    size = np.sqrt(np.diag(hessian))
    np.testing.assert_allclose(fitted.gradient.sum(0) / size, slope / size, atol=1e-6)
    # A further step would gain next to nothing of the log likelihood.
    assert 0.5 * slope @ np.linalg.solve(hessian, slope) < 0.05


@pytest.mark.thorough
def test_where_nothing_is_known_of_a_function_it_stays_near_none(cold):
    fitted, start = cold
    assert np.abs(heights(start, fitted.values[list(fitted.places)][-5:])).max() < 2 * 1.5
