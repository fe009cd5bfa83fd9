"""A method in a plain loop of Python: numbers in, numbers out, whatever jax is set to."""

import math
import subprocess
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from identifier_cases import scenario_of
from lanes import lanes

import adhesion_jax as aj
from adhesion_jax.campaign.keys import solver_keys
from adhesion_jax.campaign.tiles import Tiles
from adhesion_jax.identifiers import IDENTIFIERS

STREAM = "qian2024-switch"
ONLINE = [
    name for name, one in IDENTIFIERS.items() if one.accepts(scenario_of(STREAM).known) is None
]

#: Those that compile quickly.
MARKS = dict.fromkeys(("rls-kiencke-variable", "riv"), pytest.mark.long)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=MARKS.get(name, pytest.mark.thorough)) for name in ONLINE],
)
def test_a_loop_has_the_numbers_of_a_campaign(name, monkeypatch):
    scenario = scenario_of(STREAM)
    tiles = Tiles(STREAM, scenario)
    drawn = tiles.draw(0, 0)
    found = tiles.identify(0, 0, name, IDENTIFIERS[name], drawn).estimate
    # A loop has one key, a campaign one for each run, by which particles are drawn.
    (key,) = solver_keys(0, STREAM, name, jnp.arange(1))
    monkeypatch.setattr(jax.random, "key", lambda _: key)
    online = aj.online(name, known=scenario.known)
    peak = [*found.values].index("mu_max")
    for block in range(scenario.rails.index("common") + 3):  # beyond the switch
        resets = []
        for slip, adhesion in zip(
            *map(np.asarray, (drawn.slip[0, block], drawn.adhesion[0, block])), strict=True
        ):
            now = online.update(slip, adhesion)
            resets.append(now.reset)
        expected = {name: value[0, block] for name, value in found.values.items()}
        error = np.sqrt(found.covariance[0, block, peak, peak])
        np.testing.assert_allclose(now.mu_max, expected["mu_max"], rtol=1e-12)
        np.testing.assert_allclose(now.slip_opt, expected["slip_opt"], rtol=1e-12)
        np.testing.assert_allclose(now.mu_max_se, error, rtol=1e-9)
        assert now.status == found.status[0, block]
        assert any(resets) == found.reset[0, block]


LOOP = """
import jax, jax.numpy as jnp
import adhesion_jax as aj

online = aj.online("riv", a0=40.0)
for slip, adhesion in [(0.01, 0.24), (0.02, 0.38), (0.04, 0.52), (float("nan"), 0.5)]:
    now = online.update(slip, adhesion)
assert all(type(x) is float for x in now[:4]), now
assert type(now.reset) is bool
assert now.status.sentence.endswith(".")
assert jnp.ones(1).dtype == jnp.float32
assert not jax.config.jax_enable_x64
for sample in [("much", 0.2), (None, 0.2), ([1.0, 2.0], 0.2)]:
    try:
        online.update(*sample)
    except aj.InputError as refusal:
        assert "A sample is two numbers" in str(refusal)
    else:
        raise AssertionError(sample)
assert online.update(float("inf"), 0.5).mu_max == now.mu_max
print(now.mu_max.hex())
"""


@pytest.mark.long
def test_a_program_in_single_precision_stays_so_and_has_the_same_numbers():
    ended = subprocess.run(
        [sys.executable, "-c", LOOP], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
    online = aj.online("riv", a0=40.0)
    for slip, adhesion in [(0.01, 0.24), (0.02, 0.38), (0.04, 0.52)]:
        now = online.update(slip, adhesion)
    assert float.fromhex(ended.stdout.strip()) == pytest.approx(now.mu_max, rel=1e-12)


def test_two_loops_do_not_disturb_each_other():
    samples = [(0.02, 0.38), (0.04, 0.5), (0.06, 0.5)]
    one, other, alone = (aj.online("rls-kiencke", a0=40.0) for _ in range(3))
    expected = [alone.update(*sample) for sample in samples]
    for sample, now in zip(samples, expected, strict=True):
        other.update(0.05, 0.2)
        assert one.update(*sample)[:4] == now[:4]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("unknown", 40.0), "no identifier unknown"),
        ((["riv", "rls-kiencke"], 40.0), "one method"),
        (("ml-exact", 40.0), "ml-exact cannot follow samples: it takes whole blocks"),
        (("rls-slope", 40.0), "rls-slope cannot follow samples"),
        (("riv", -1.0), "a0 is -1.0"),
        (("riv", math.nan), "a0 is nan"),
        (("riv",), "either a0"),
        (("riv", 40.0, scenario_of(STREAM).known), "either a0"),
    ],
)
def test_what_cannot_follow_samples_is_refused_in_a_sentence(given, words):
    with pytest.raises(aj.InputError, match=words):
        aj.online(*given)


#: Those without a decomposition of LAPACK.
AS_ONE = [name for name in ONLINE if name != "bayes-departure"]


@pytest.mark.parametrize("name", lanes(AS_ONE, always=2, thorough=len(AS_ONE)))
def test_a_step_is_one_function_of_the_processor(name):
    entry = entry_of(aj.online(name, a0=40.0))
    pieces = [line for line in entry if " parameter(" not in line and " get-tuple" not in line]
    assert len(pieces) <= 3, entry  # a call, its results as a tuple, and the brace
    assert " call(" in "".join(pieces)


def entry_of(online):
    """What the program of a step does, a line each."""
    return online._step.as_text().partition("\nENTRY")[2].strip().splitlines()[1:]


class Sorting(type(IDENTIFIERS["riv"])):
    """riv with a sort, which no function of the processor has as a part."""

    def update(self, state, record):
        size = jnp.sort(jnp.tile(jnp.abs(record.slip), 3))[:1]
        return super().update(state, record._replace(slip=jnp.sign(record.slip) * size))


@pytest.mark.long
def test_a_step_that_cannot_be_one_function_has_the_same_numbers():
    riv = IDENTIFIERS["riv"]
    sorting = aj.online({"mine": Sorting(riv.huber, riv.gain, riv.prior)}, a0=40.0)
    assert len(entry_of(sorting)) > 100
    online = aj.online("riv", a0=40.0)
    for slip, adhesion in [(0.01, 0.24), (0.02, 0.38), (-0.04, -0.52), (0.06, 0.51)]:
        assert sorting.update(slip, adhesion)[:4] == pytest.approx(
            online.update(slip, adhesion)[:4], rel=1e-11, nan_ok=True
        )


@pytest.mark.clock
@pytest.mark.parametrize("name", ["riv", "rls-kiencke", "qp-qian2024-1", "bank-kiencke"])
def test_a_sample_takes_five_times_as_long_as_a_program_without_work_at_most(name):
    """A ratio, since processors differ: it is 45 microseconds where a sample of riv takes 25."""
    online, generator = aj.online(name, a0=40.0), np.random.default_rng(0)
    slips = generator.uniform(0.0, 0.2, 2000).tolist()
    curve = [40 * s / (1 + 31 * s + 100 * s**2) + 0.01 * generator.normal() for s in slips]
    idle = without_work()
    best = {online.update: math.inf, idle: math.inf}
    for _ in range(5):
        for update in best:  # by turns, for a processor has slow moments
            began = time.perf_counter()
            for slip, adhesion in zip(slips, curve, strict=True):
                update(slip, adhesion)
            best[update] = min(best[update], time.perf_counter() - began)
    assert best[online.update] < 5 * best[idle]


def without_work():
    """What takes a sample and gives six numbers, as `update` does, by a program of two lines."""
    with jax.enable_x64(True):
        state = jnp.zeros(100)
        lowered = jax.jit(lambda both: (both[0] + both[1][0], both[0][:6])).lower
        program = lowered([state, np.zeros(2)]).compile()

    def update(slip, adhesion):
        with jax.enable_x64(True):
            _, told = program([state, np.array((float(slip), float(adhesion)))])
        return np.asarray(told).tolist()

    return update
