"""The bank of filters: against closed forms, determinants and derivatives, and by Monte Carlo."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from adhesion_jax.campaign.job import Config
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.identifiers import IDENTIFIERS
from adhesion_jax.identifiers.bank_kiencke import (
    Bank,
    bank,
    bank_kiencke,
    correlation,
    peak_of,
    x_of,
)
from adhesion_jax.identifiers.online import Sample
from adhesion_jax.identifiers.pairs import Square, Symmetric, Vector
from adhesion_jax.scenarios import Options, build
from adhesion_jax.scenarios.rails import KIENCKE_RAILS, QIAN2024

A0, YOUNG = 40.0, 40
KNOWN = jax.tree.map(jnp.asarray, QIAN2024)
NEVER = 1e300  # a limit beyond which no innovation lies


def one_member(factor=1.0, slope=0.0):
    return Bank(*np.array([[factor], [slope], [1.0]]), 0.0, NEVER, 0.02, 0.1)


def dry(slip):
    rail = KIENCKE_RAILS["dry"]
    return A0 * slip / (1 + rail.p1 * slip + rail.p2 * slip**2)


def stream(points, seed, sigma=0.01):
    rng = np.random.default_rng(seed)
    slip = rng.uniform(0.0, 0.2, points)
    return slip, dry(slip) + sigma * rng.normal(size=points)


def course(method, slip, adhesion):
    """The recursion after each sample."""

    def step(recursion, sample):
        after = method.step(KNOWN, recursion, Sample(jnp.ones((), bool), *sample, ()))
        return after, after

    start = method.init(KNOWN, jax.random.key(0)).recursion
    return jax.jit(lambda pair: jax.lax.scan(step, start, pair)[1])(
        (jnp.asarray(slip), jnp.asarray(adhesion))
    )


def gradient(x, slip):
    d = 1 + x[0] * slip + x[1] * slip**2
    return A0 * slip / d, -A0 * slip**2 / d**2 * np.array([1.0, slip])


def full(matrix, *place):
    a, b, c = (np.asarray(part)[place] for part in (matrix.a, matrix.b, matrix.c))
    return np.array([[a, b], [b, c]])


@pytest.mark.long
def test_one_member_that_forgets_nothing_is_least_squares_of_the_linearised_model():
    """x = P (P0^-1 x0 + sum h y) and P = (P0^-1 + sum h h')^-1, of all samples at once."""
    slip, adhesion = stream(200, 3)
    after = course(one_member(), slip, adhesion)
    x = np.stack([after.x.a, after.x.b], axis=1)
    memory = np.asarray(jax.vmap(correlation)(after))
    first = YOUNG - 1
    information = np.linalg.inv(full(after.members.of_x, first, 0))
    pull = information @ x[first]
    for k in range(YOUNG, len(slip)):
        now, before = (gradient(x[k - 1], slip[j]) for j in (k, k - 1))
        h = now[1] - memory[k - 1] * before[1]
        error = adhesion[k] - now[0] - memory[k - 1] * (adhesion[k - 1] - before[0])
        information = information + np.outer(h, h)
        pull = pull + h * (error + h @ x[k - 1])
    assert np.max(memory) > 0
    np.testing.assert_allclose(x[-1], np.linalg.solve(information, pull), rtol=1e-9)
    found = full(after.members.of_x, -1, 0)
    np.testing.assert_allclose(found, np.linalg.inv(information), rtol=1e-8)


def test_the_weight_of_a_member_is_its_evidence():
    """The density of all samples, by the determinant of their covariance."""
    factors, points, scale = (1.0, 0.9), 12, 0.01
    method = Bank(np.array(factors), np.zeros(2), np.array([0.3, 0.7]), 0.0, NEVER, 0.02, 0.1)
    rng = np.random.default_rng(5)
    x0, p0 = np.array([30.0, 100.0]), np.array([[0.9, -1.0], [-1.0, 4.0]])
    one = jnp.ones(2)
    start = method._alike(
        KNOWN, Vector(*jnp.asarray(x0)), Symmetric(*jnp.asarray(p0[[0, 0, 1], [0, 1, 1]])),
        jnp.asarray(scale), jnp.asarray(1.0),
    )  # fmt: skip
    h = rng.normal(size=(points, 2))
    y = h @ (x0 + scale * np.linalg.cholesky(p0) @ rng.normal(size=2))
    y = y + scale * rng.normal(size=points)

    @jax.jit
    def updated(members, h, y):
        error = y - h[0] * members.x.a - h[1] * members.x.b
        g = Vector(h[0] * one, h[1] * one)
        return method._updated(KNOWN, members, error, g, jnp.asarray(scale))[0]

    moved = jax.jit(lambda members: method._moved(KNOWN, members, jnp.asarray(scale)))
    members, past = start, []
    for k in range(points):
        if k:
            past.append(members.of_x)
            members = moved(members)
        members = updated(members, h[k], y[k])

    evidence = []
    for i, factor in enumerate(factors):
        at = [p0]
        for p in past:  # x walks by what the factor adds to its covariance
            at.append(at[-1] + (1 / factor - 1) * full(p, i))
        covariance = np.eye(points)
        for j in range(points):
            for k in range(points):
                covariance[j, k] += h[j] @ at[min(j, k)] @ h[k]
        covariance *= scale**2
        error = y - h @ x0
        _, logarithm = np.linalg.slogdet(covariance)
        evidence.append(-0.5 * (logarithm + error @ np.linalg.solve(covariance, error)))
    expected = np.array([0.3, 0.7]) * np.exp(np.array(evidence) - max(evidence))
    np.testing.assert_allclose(members.weight, expected / expected.sum(), rtol=1e-7)


def test_a_member_with_a_trend_moves_by_the_derivatives_of_its_peak():
    method = one_member(0.97, 2e-3)
    rng = np.random.default_rng(2)
    root = rng.normal(size=(4, 4))
    p = root @ root.T
    x, slope = np.array([31.0, 100.0]), np.array([-1e-3, 2e-3])
    as_one = [np.array([value]) for value in (*x, *slope)]
    members = method._alike(
        KNOWN,
        Vector(*jnp.asarray(x)),
        Symmetric(*jnp.asarray([1.0, 0.0, 1.0])),
        jnp.asarray(1.0),
        jnp.asarray(1.0),
    )._replace(
        slope=Vector(*map(jnp.asarray, as_one[2:])),
        of_x=Symmetric(*(jnp.asarray([v]) for v in (p[0, 0], p[0, 1], p[1, 1]))),
        across=Square(*(jnp.asarray([v]) for v in p[:2, 2:].ravel())),
        of_slope=Symmetric(*(jnp.asarray([v]) for v in (p[2, 2], p[2, 3], p[3, 3]))),
    )
    after = jax.jit(lambda members: method._moved(KNOWN, members, jnp.asarray(1.0)))(members)

    @jax.jit
    def moved(state):
        peak, one_over_slip = peak_of(KNOWN, Vector(state[0], state[1]))
        there = x_of(KNOWN, peak + state[2], one_over_slip * jnp.exp(state[3]))
        return jnp.stack([there.a, there.b, state[2], state[3]])

    state = jnp.asarray([*x, *slope])
    f = np.asarray(jax.jit(jax.jacfwd(moved))(state))
    expected = f @ p @ f.T / 0.97
    np.testing.assert_allclose([after.x.a[0], after.x.b[0]], moved(state)[:2], rtol=1e-12)
    np.testing.assert_allclose(full(after.of_x, 0), expected[:2, :2], rtol=1e-9)
    across = np.array([part[0] for part in jax.tree.leaves(after.across)]).reshape(2, 2)
    np.testing.assert_allclose(across, expected[:2, 2:], rtol=1e-9)
    np.testing.assert_allclose(full(after.of_slope, 0), expected[2:, 2:], rtol=1e-9)


def test_members_weigh_one_before_any_data_and_ever_after():
    assert np.sum(bank_kiencke.prior) == pytest.approx(1.0, abs=1e-12)
    after = course(bank_kiencke, *stream(120, 9))
    np.testing.assert_allclose(np.sum(after.members.weight, axis=1), 1.0, rtol=1e-12)


def test_without_excitation_nothing_grows_beyond_the_box():
    method = bank({0.9: 0.5, 1.0: 0.5})
    rng = np.random.default_rng(1)
    slip = np.where(np.arange(9000) < 60, rng.uniform(0.0, 0.2, 9000), 0.08)
    adhesion = dry(slip) + 0.01 * rng.normal(size=9000)
    after = jax.tree.map(lambda leaf: np.asarray(leaf)[-1], course(method, slip, adhesion))
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(after))
    width = np.asarray(KNOWN.upper - KNOWN.lower)
    deviation = after.scale * np.sqrt([after.members.of_x.a, after.members.of_x.c])
    assert np.all(deviation < 2 * width[:, None])
    at_work = A0 * 0.08 / (1 + after.x.a * 0.08 + after.x.b * 0.08**2)
    assert at_work == pytest.approx(dry(0.08), abs=0.005)


@functools.cache
def tables(scenario, options=Options()):
    config = Config(scenario, ("bank-kiencke",), options, runs=256, seed=4)
    return run_campaign(config, lambda _: None, lambda _: None, workers=1).tables


def peaks(table):
    return table[table["quantity"] == "mu_max"].set_index("rail")


@pytest.mark.thorough
def test_it_follows_a_rail_that_drifts_with_an_interval_that_holds_the_truth():
    summary = peaks(tables("drift")["summary"]).loc["dry"]
    assert summary["rmse"] / summary["truth"] < 0.0035
    assert summary["coverage95"] > 0.90


@pytest.mark.long
def test_it_is_near_the_bound_where_the_rail_stays_and_soon_after_it_has_changed():
    found = tables("qian2024-switch")
    ratio = peaks(found["summary"])["rmse_over_crlb"]
    assert np.all(ratio < 1.20)
    assert np.all(ratio > 0.9)
    assert np.all(peaks(found["summary"])["coverage95"] > 0.92)
    tracking = found["tracking"].set_index("rail").loc["common"]
    assert tracking["delay_median"] <= 8


def test_it_is_registered_and_wants_kienckes_curve():
    assert IDENTIFIERS["bank-kiencke"] is bank_kiencke
    assert bank_kiencke.accepts(build("qian2024-switch").known) is None
    assert "Kiencke" in bank_kiencke.accepts(build("single").known)
