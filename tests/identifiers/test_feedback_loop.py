"""Online methods in a loop whose next slip depends on what they have identified so far."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lanes import lanes

from adhesion_jax.identifiers import IDENTIFIERS
from adhesion_jax.records import Record
from adhesion_jax.scenarios import build
from adhesion_jax.scenarios.rails import KIENCKE_RAILS, RAILS

RUNS, SPEED, SAMPLING = 4, 20.0, 0.01

BY_SAMPLE = {"kiencke": "qian2024-switch", "slope": "fang2018-slope"}
KNOWN = {kind: build(name).known for kind, name in BY_SAMPLE.items()}
ONLINE = [
    (name, kind)
    for name, method in reversed(IDENTIFIERS.items())
    for kind, known in KNOWN.items()
    if method.accepts(known) is None
]


#: What has a peak and no parameters of the curve that it is told: these are NaN.
WITHOUT_PARAMETERS = {"bayes-departure": ("p1", "p2")}


def slip_asked(values, slip, step):
    """At the peak that was found, or up the slope; probed by a slow and a fast wave."""
    probe = 0.02 * jnp.sin(0.9 * step) + 0.02 * jnp.sin(0.13 * step)
    aim = values["slip_opt"] if "slip_opt" in values else slip + 0.02 * values["slope"]
    return jnp.clip(aim + probe, 0.01, 0.2)


def step_of(name, kind):
    """One turn of the loop: measure at the slip, identify, ask for the next slip."""
    method, rail = IDENTIFIERS[name], (KIENCKE_RAILS if kind == "kiencke" else RAILS)["dry"]

    def turn(carry, now):
        state, slip = carry
        step, noise = now
        adhesion, one = rail(slip, {}) + noise, jnp.ones(1, dtype=bool)
        columns = {"slip_velocity_mps": SPEED * slip[None], "time_s": SAMPLING * step[None]}
        state = method.update(state, Record(slip[None], adhesion[None], one, one, columns))
        values = method.estimate(state).values
        return (state, slip_asked(values, slip, step)), (slip, values)

    return turn


def start_of(name, kind):
    return IDENTIFIERS[name].init(KNOWN[kind], jax.random.key(0)), jnp.asarray(0.05)


def noise_of(samples):
    return 0.01 * jax.random.normal(jax.random.key(1), (RUNS, samples))


@functools.cache
def looped(name, kind, samples):
    """Jitted, over the runs: the slips and what was identified, [runs, samples]."""

    def one_run(noise):
        steps = (jnp.arange(samples, dtype=float), noise)
        return jax.lax.scan(step_of(name, kind), start_of(name, kind), steps)[1]

    return jax.jit(jax.vmap(one_run))(noise_of(samples))


@pytest.mark.parametrize(("name", "kind"), lanes(ONLINE, always=1, thorough=2))
def test_a_loop_over_many_runs_is_that_of_each_run_step_by_step(name, kind):
    samples, run = 5, 2
    slips, values = looped(name, kind, samples)
    turn, carry = step_of(name, kind), start_of(name, kind)
    for step, noise in enumerate(noise_of(samples)[run]):  # neither jitted nor vmapped
        carry, (slip, found) = turn(carry, (jnp.asarray(float(step)), noise))
        assert float(slip) == pytest.approx(float(slips[run, step]), rel=1e-7)
        for quantity, value in found.items():
            expected = float(values[quantity][run, step])
            nan_ok = quantity in WITHOUT_PARAMETERS.get(name, ())
            assert float(value) == pytest.approx(expected, rel=1e-6, abs=1e-12, nan_ok=nan_ok)


@pytest.mark.parametrize(("name", "kind"), lanes(ONLINE, always=2, thorough=3))
def test_the_loop_stays_finite_and_finds_the_peak(name, kind):
    slips, values = looped(name, kind, 600)
    without = WITHOUT_PARAMETERS.get(name, ())
    for quantity, value in values.items():
        assert np.all(np.isnan(value) if quantity in without else np.isfinite(value)), quantity
    slips = np.asarray(slips)
    assert np.all((slips >= 0.01) & (slips <= 0.2))
    # The runs part ways, for each follows its own estimate.
    assert np.mean(np.std(slips[:, 20:], axis=0) > 0) > 0.3
    if kind == "kiencke":
        mu_max = float(KIENCKE_RAILS["dry"].peak({}).adhesion)
        np.testing.assert_allclose(values["mu_max"][:, -1], mu_max, rtol=0.03)
        assert np.mean(slips[:, 300:]) == pytest.approx(0.1, abs=0.02)


def test_a_loop_that_reads_the_optimum_alone_does_not_compute_the_covariance():
    method = IDENTIFIERS["qp-bias-compensated"]
    state, _ = start_of("qp-bias-compensated", "kiencke")

    def work(read):
        compiled = jax.jit(lambda state: read(method.estimate(state))).lower(state).compile()
        return compiled.cost_analysis()["flops"]

    alone = work(lambda estimate: estimate.values["slip_opt"])
    assert work(lambda estimate: (estimate.values["slip_opt"], estimate.covariance)) > 5 * alone
