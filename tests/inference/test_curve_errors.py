"""Standard errors by cosines of the curves of a campaign, against those of a dense linear model."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lanes import lanes
from scipy.special import stdtrit

import adhesion_jax as aj
from adhesion_jax.campaign.tiles import Tiles
from adhesion_jax.curves import free_values
from adhesion_jax.inference.curve_errors import cosine_errors
from adhesion_jax.inference.sandwich import COSINES, Blocks, _sine, by_cosines
from adhesion_jax.metrics.information import quantities
from adhesion_jax.records import OWN_SLIP, SHARED_SLIP, Known, Record
from adhesion_jax.scenarios import Scenario
from adhesion_jax.scenarios.course import Apart
from adhesion_jax.scenarios.excitation import RandomSlips, Sweep
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rail_process import steady
from adhesion_jax.scenarios.rails import HE2018, RAILS, form_of, told_of

#: The least and the largest coverage of the interval of independent noise and the right curve.
WALD = {"coloured": (0.4, 0.6), "single": (0.9, 1.0), "mismatch": (0.0, 0.01)}

POINTS, RUNS = 50, 3  # each point is a part of its own


def dense(known, slip, adhesion):
    """The larger of both orders, from derivatives by differences and a root by eigenvalues."""
    values = np.asarray(free_values(known.curve))

    def told(values):
        curve = aj.Burckhardt(*values)
        return np.asarray(curve(jnp.asarray(slip), {})), np.asarray(quantities(curve, known))

    pairs = [(told(values + step), told(values - step)) for step in np.diag(1e-6 * values)]
    rows, gradient = (
        np.stack(
            [(up[i] - down[i]) / (2e-6 * v) for (up, down), v in zip(pairs, values, strict=True)],
            axis=-1,
        )
        for i in (0, 1)
    )
    sizes, vectors = np.linalg.eigh(rows.T @ rows)
    root = vectors / np.sqrt(sizes)
    score, rows = (rows @ root) * (adhesion - told(values)[0])[:, None], rows @ root
    blocks = Blocks(score, rows[:, :, None] * rows[:, None])
    orders = np.arange(slip.size), np.argsort(slip)
    found = [by_cosines(Blocks(*(x[order] for x in blocks)), gradient @ root) for order in orders]
    return np.sqrt(np.maximum(*found))


@pytest.mark.parametrize("axes", [OWN_SLIP, SHARED_SLIP])
def test_errors_of_many_runs_are_those_of_a_dense_model(axes):
    generator = np.random.default_rng(3)
    known = Known(RAILS["common"], HE2018.lower, HE2018.upper)
    slip = generator.uniform(0.0, 0.3, (RUNS, POINTS))
    adhesion = generator.normal(0.3, 0.05, (RUNS, POINTS))
    every = np.ones(POINTS, dtype=bool)
    shared = axes is SHARED_SLIP
    record = Record(slip[0] if shared else slip, adhesion, every, every, {})
    parameters = np.tile(free_values(known.curve), (RUNS, 1))
    found = jax.jit(lambda *of: cosine_errors(known, of[0], axes, of[1]))(record, parameters)
    for run in range(RUNS):
        expected = dense(known, slip[0 if shared else run], adhesion[run])
        np.testing.assert_allclose(found[run], expected, rtol=1e-6)


@pytest.mark.parametrize(
    "scenario", lanes(["coloured", "single", "mismatch"], always=0, long=1, thorough=2)
)
def test_the_interval_by_cosines_holds_the_peak_in_noise_with_memory_and_of_a_wrong_curve(scenario):
    """That of independent noise and the right curve holds it in half of the runs, and in none."""
    table = aj.montecarlo(scenario, ["ml-exact", "lm"], runs=256).summary
    peaks = table[table["quantity"] == "mu_max"]
    assert (peaks["coverage95_robust"] > 0.95 - 4 * np.sqrt(0.95 * 0.05 / 256)).all()
    assert peaks["coverage95"].between(*WALD[scenario]).all()


@pytest.mark.slow
@pytest.mark.parametrize("truth", ["burckhardt", "kiencke", "exponential", "polach"])
@pytest.mark.parametrize("slips", [RandomSlips(500), Sweep(500)], ids=["random", "sweep"])
@pytest.mark.parametrize("correlation", [0.0, 0.9])
def test_the_interval_by_cosines_holds_the_peak_in_all_cells(truth, slips, correlation):
    """Burckhardt's curve is told; its bias is up to 1.5 % where another one is true."""
    form = form_of(truth)
    process = dataclasses.replace(steady(form.rails, "dry"), conditions=form.conditions)
    told = told_of("burckhardt", truth, "dry")
    noise = Noise(autocorrelation=correlation)
    scenario = Scenario(process, slips, noise, Apart(500), told)
    tiles, covered = Tiles("cells", scenario), []
    for tile in range(4):
        records = tiles.draw(1, tile)
        values = tiles.identify(1, tile, "ml-exact", aj.IDENTIFIERS["ml-exact"], records)
        found = values.estimate.values
        parameters = np.stack([found[name] for name in told.curve.free], axis=-1)
        errors = np.asarray(tiles.cosine_errors((records, parameters)))[:, 0, -2]
        off = np.abs(found["mu_max"][:, 0] - scenario.quantities()["mu_max"][0])
        covered.append(off <= stdtrit(COSINES, 0.975) * errors)
    assert np.mean(covered) > 0.95 - 4 * np.sqrt(0.95 * 0.05 / 512)


@pytest.mark.long
def test_a_method_that_does_not_fit_the_last_block_has_no_such_interval():
    table = aj.montecarlo("single", ["ml-pooled"], runs=2).summary
    assert table["coverage95_robust"].isna().all()


def test_the_series_of_the_cosines_is_that_of_the_sine():
    angles = np.linspace(-np.pi / 2, np.pi / 2, 10_001)
    np.testing.assert_allclose(_sine(angles), np.sin(angles), rtol=0, atol=5e-16)
