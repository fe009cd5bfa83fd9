"""Identifiers under the plain transformations of jax."""

import functools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from identifier_cases import FORMS, scenario_of
from lanes import lanes

from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import IDENTIFIERS, Status, identify

STREAMS = 3

#: The first of these scenarios that a method takes.
HOMES = ("qian2024-switch", "fang2018-slope", "qian2024", "single", "stream-slope")

#: Those that may be differentiated backwards; in the others a loop ends where it has converged.
ONE_PASS = ("rls-kiencke", "rls-kiencke-variable", "qp-qian2024-1", "qp-bias-compensated")


def home_of(identifier):
    scenarios = (scenario_of(name) for name in HOMES)
    return next(s for s in scenarios if identifier.accepts(s.known) is None)


@functools.cache
def records(identifier, streams=STREAMS, steps=2, samples=2):
    """[streams, steps, points] of the first samples of a run each, or its blocks."""
    scenario = home_of(identifier)
    draw = jax.jit(jax.vmap(lambda key: scenario.draw(key)))
    drawn = draw(jax.random.split(jax.random.key(0), streams))
    points = (
        samples * steps if scenario.known.by_sample else steps * (drawn.mask.shape[-1] // steps)
    )
    return scenario.known, jax.tree.map(
        lambda x: x[:, 0, :points].reshape(streams, steps, -1), drawn
    )


def part(whole, *place):
    return jax.tree.map(lambda x: x[place], whole)


def same(one, other):
    """The status, and the values of a solver that converged: in a batch sums round differently."""
    assert one.status == other.status
    if one.status >= Status.NOT_CONVERGED:
        return
    for name, value in one.values.items():
        np.testing.assert_allclose(value, other.values[name], rtol=1e-6)


@pytest.mark.parametrize("name", lanes(FORMS, always=1, thorough=2, long=1))
def test_methods_are_compiled_once_and_mapped_over_streams(name):
    identifier = IDENTIFIERS[name]
    known, taken = records(identifier)
    keys = jax.random.split(jax.random.key(7), STREAMS)

    update, estimate = jax.jit(identifier.update), jax.jit(identifier.estimate)
    alone = []
    for stream in range(STREAMS):
        state = identifier.init(known, keys[stream])
        for step in range(2):
            state = update(state, part(taken, stream, step))
        alone.append(estimate(state))
    assert update._cache_size() == estimate._cache_size() == 1

    states = jax.vmap(identifier.init, (None, 0))(known, keys)
    mapped = jax.jit(jax.vmap(identifier.update))
    for step in range(2):
        states = mapped(states, jax.tree.map(lambda x: x[:, step], taken))  # noqa: B023
    together = jax.jit(jax.vmap(identifier.estimate))(states)
    for stream in range(STREAMS):
        same(alone[stream], part(together, stream))
    assert np.isfinite(together.values.get("mu_max", together.values.get("slope"))).all()


@pytest.mark.parametrize("name", lanes(ONE_PASS, always=0, long=1, thorough=2))
def test_estimates_are_differentiated_by_the_samples(name):
    """By finite differences for the first ten samples; after these, both ways give the same."""
    identifier = IDENTIFIERS[name]
    scenario = home_of(identifier)
    drawn = scenario.draw(jax.random.split(jax.random.key(0), 1)[0])
    first, second = part(drawn, 0), part(drawn, 1)

    def begun():
        return identifier.init(scenario.known, jax.random.key(0))

    def peak(state, record, adhesion):
        state = identifier.update(state, record._replace(adhesion=adhesion))
        return identifier.estimate(state).values["mu_max"]

    @jax.jit
    def early(adhesion):
        return peak(begun(), first, adhesion)

    steps = 1e-6 * jnp.eye(first.adhesion.size)
    ends = jax.vmap(early)(first.adhesion + steps), jax.vmap(early)(first.adhesion - steps)
    differences = (ends[0] - ends[1]) / 2e-6
    for derivative in (jax.grad, jax.jacfwd):
        found = jax.jit(derivative(early))(first.adhesion)
        np.testing.assert_allclose(found, differences, rtol=1e-3, atol=1e-6)

    # Before the second sample only a weak prior determines a quadratic program: there rounding
    # grows 10^10 times, and what becomes of it differs from processor to processor.
    @jax.jit
    def later(adhesion):
        return peak(identifier.update(begun(), first), second, adhesion)

    backward, forward = (jax.jit(d(later))(second.adhesion) for d in (jax.grad, jax.jacfwd))
    assert np.all(np.abs(backward) > 0)
    np.testing.assert_allclose(forward, backward, rtol=1e-10)


@pytest.mark.thorough
def test_settings_that_are_arrays_may_be_compiled_in_too():
    identifier = jax.tree.map(jnp.asarray, IDENTIFIERS["riv"])
    known, taken = records(identifier, 1)
    state = identifier.init(known, jax.random.key(0))
    ones = [jax.jit(i.update)(state, part(taken, 0, 0)) for i in (identifier, IDENTIFIERS["riv"])]
    same(*map(identifier.estimate, ones))
    other = jax.tree.map(lambda x: 2 * x, identifier)
    assert hash(identifier) == hash(jax.tree.map(jnp.asarray, IDENTIFIERS["riv"]))
    assert identifier != other


@pytest.mark.parametrize("name", ["riv", "ml-exact", "ml-pooled"])
def test_single_precision_is_refused_in_a_sentence(name):
    known, _ = records(IDENTIFIERS[name], 1)
    with jax.enable_x64(False), pytest.raises(InputError, match="needs double precision"):
        IDENTIFIERS[name].init(known, jax.random.key(0))


@pytest.mark.parametrize("name", lanes(IDENTIFIERS, always=3, thorough=len(IDENTIFIERS)))
def test_an_identifier_is_translated_for_a_gpu_without_one(name):
    identifier = IDENTIFIERS[name]
    known, blocks = records(identifier)
    keys = jax.random.split(jax.random.key(1), STREAMS)
    many = jax.vmap(lambda record, key: identify(identifier, known, record, key))
    text = jax.jit(many).trace(blocks, keys).lower(lowering_platforms=("cuda",)).as_text()
    # Beside plain operations there are at most factorisations of a library of the GPU.
    assert all(call.startswith("cusolver_") for call in re.findall(r"custom_call @(\w+)", text))
    assert "xla_cpu" not in text
