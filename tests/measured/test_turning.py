"""The slip of a peak, by the probability that adhesion falls at each slip; mixtures of curves."""

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import stdtrit
from scipy.stats import lognorm, t

import adhesion_jax as aj
from adhesion_jax.measured.answer import _mixture, turned

SLIP = np.geomspace(1e-4, 1.0, 400)


def test_of_one_curve_it_is_the_quantile_of_its_peak():
    found = turned(SLIP, lognorm.cdf(SLIP, 0.1, scale=0.03), 0.03)
    truth = lognorm.ppf([0.5, 0.025, 0.975], 0.1, scale=0.03)
    np.testing.assert_allclose(found, truth, rtol=2e-3)


@pytest.mark.parametrize("middle", [0.02, 0.032, 0.05])
def test_of_two_curves_it_is_that_of_the_mixture(middle):
    def share_below(slip):
        return 0.7 * lognorm.cdf(slip, 0.05, scale=0.03) + 0.3 * lognorm.cdf(slip, 0.1, scale=0.035)

    found = turned(SLIP, share_below(SLIP), middle)
    truth = [brentq(lambda s, p=p: share_below(s) - p, 0.01, 0.1) for p in (0.5, 0.025, 0.975)]
    np.testing.assert_allclose(found, truth, rtol=3e-3)


def test_of_a_level_stretch_it_is_the_whole_stretch():
    found = turned(SLIP, np.clip((SLIP - 0.02) / 0.04, 0.0, 1.0), 0.04)
    assert found.low == pytest.approx(0.021, rel=0.02)
    assert found.high == pytest.approx(0.059, rel=0.02)


def test_a_second_turn_far_from_the_peak_is_not_its_interval():
    falls = lognorm.cdf(SLIP, 0.05, scale=0.03) * (1 - lognorm.cdf(SLIP, 0.05, scale=0.2))
    found = turned(SLIP, falls + lognorm.cdf(SLIP, 0.05, scale=0.5), 0.03)
    np.testing.assert_allclose(found, lognorm.ppf([0.5, 0.025, 0.975], 0.05, scale=0.03), rtol=3e-3)


def test_an_end_that_is_not_seen_is_that_of_the_slips():
    found = turned(SLIP, lognorm.cdf(SLIP, 1.0, scale=0.5), 0.5)
    assert found.high == 1.0
    assert found.low == pytest.approx(lognorm.ppf(0.025, 1.0, scale=0.5), rel=2e-3)


def test_of_a_sharp_peak_it_is_the_interval_of_the_delta_method():
    draw, way = np.random.default_rng(2), np.linspace(0.004, 0.15, 100)
    slip = np.tile(np.concatenate([way, way[::-1]]), 12)
    run = np.repeat(np.arange(12), 200)
    table = {
        "time_s": 0.1 * np.arange(slip.size) + 30.0 * run,
        "run": run,
        "slip_ratio": slip,
        "adhesion": -0.32 * np.expm1(-60 * slip) - 0.35 * slip + draw.normal(0, 0.003, slip.size),
    }
    found = aj.identify(table, "burckhardt", slip_noise=0.0)
    fit = found.fits["burckhardt"]
    (error,), (degrees,) = fit.errors(fit.peak.by_slip[None])
    half = float(stdtrit(degrees, 0.975) * error)
    low, high = found.slip_opt_interval
    assert 0.5 * (high - low) == pytest.approx(half, rel=0.03)
    assert found.slip_opt == pytest.approx(fit.peak.slip, rel=1e-3)


def test_the_interval_of_curves_is_that_of_their_mixture_on_the_logarithm():
    found = _mixture([(0.3, 0.015, 6.0, 0.7), (0.4, 0.01, 11.0, 0.3)])

    def share_below(level):
        first, second = np.log(level / 0.3) / 0.05, np.log(level / 0.4) / 0.025
        return 0.7 * t.cdf(first, 6) + 0.3 * t.cdf(second, 11)

    truth = [brentq(lambda m, p=p: share_below(m) - p, 0.1, 0.9) for p in (0.5, 0.025, 0.975)]
    np.testing.assert_allclose(found, truth, rtol=1e-9)
