"""Online methods while nothing new is told: standstill, constant slip, one sample again and again.

`python tests/identifiers/test_online_at_standstill.py` prints the table of
docs/online_at_standstill.md.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from adhesion_jax.identifiers import IDENTIFIERS
from adhesion_jax.records import Record
from adhesion_jax.scenarios import build
from adhesion_jax.scenarios.rails import KIENCKE_RAILS, QIAN2024

RUNS, SIGMA, SPEED, SAMPLING = 256, 0.01, 20.0, 0.01

#: Samples before, during and after the disturbance.
BEFORE, DURING, AFTER = 200, 300, 300
TOTAL = BEFORE + DURING + AFTER
MIDDLE = slice(BEFORE, BEFORE + DURING)

#: What stands in the middle; of a gap nothing does, and the others are held against it.
DISTURBANCES = (
    *("gap", "standstill", "constant slip", "repeated sample"),
    *("outlier", "impossible", "not finite"),
)

#: One sample of these adhesions, of which the first is ten times the largest.
SINGLE = {"outlier": 5.0, "impossible": 1e6, "not finite": np.nan}

SLOPE = build("fang2018-slope")
TRUTH = KIENCKE_RAILS["dry"]
MU_MAX = float(TRUTH.peak({}).adhesion)

#: Many samples in few programs: what tests leave out elsewhere is worth its time here.
optimised = functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 2})

#: Published methods, which stay as they are printed. The others are this project's own.
PRINTED = ("qp-qian2024-1", "qp-qian2024-2", "rls-kiencke", "rls-kiencke-variable", "rls-slope")
OWN = ("qp-bias-compensated", "riv", "bank-kiencke", "ekf", "ukf", "imm-rails", "particle")
MARKS = {"riv": (), "rls-kiencke": pytest.mark.long}

#: Where the RMSE is more than a tenth larger, or infinite: those of docs/online_at_standstill.md.
WORSE = {
    ("qp-bias-compensated", "outlier"),  # it forgets as Algorithm 2 does
    ("qp-qian2024-1", "repeated sample"),
    ("qp-qian2024-2", "outlier"),
    ("rls-kiencke", "repeated sample"),
    ("rls-kiencke", "outlier"),
}


def disturbed(slip, law, noise, disturbance, rng):
    """Slip, adhesion and what is fresh, [runs, samples]; outside the middle always the same."""
    slip, fresh = slip.copy(), np.ones(slip.shape, dtype=bool)
    if disturbance == "standstill":
        slip[:, MIDDLE] = 0.0
    elif disturbance == "constant slip":
        slip[:, MIDDLE] = rng.uniform(0.0, 0.2, (RUNS, 1))
    adhesion = law(slip) + noise
    if disturbance == "repeated sample":
        slip[:, MIDDLE], adhesion[:, MIDDLE] = slip[:, [BEFORE - 1]], adhesion[:, [BEFORE - 1]]
    elif disturbance in ("gap", *SINGLE):
        fresh[:, MIDDLE] = False
        if disturbance != "gap":
            fresh[:, BEFORE] = True
            adhesion[:, BEFORE] = SINGLE[disturbance]
    return slip, adhesion, fresh


def streams(name):
    """The records of all disturbances, [disturbances, runs, samples, 1], and the last truth."""
    rng = np.random.default_rng(0)
    noise = SIGMA * rng.normal(size=(RUNS, TOTAL))
    if name == "rls-slope":
        # The course goes on after the disturbance where it was before.
        time = SAMPLING * np.arange(BEFORE + AFTER)
        course = np.r_[:BEFORE, np.full(DURING, BEFORE - 1), BEFORE : BEFORE + AFTER]
        slip = np.asarray(SLOPE.excitation.slip(jnp.asarray(time)))[course]
        true = float(jax.grad(lambda slip: SLOPE.rail.curve(slip, {}))(slip[-1])) / SPEED
        slip = slip + 0.005 / SPEED * rng.normal(size=(RUNS, TOTAL))
        law = SLOPE.rail.curve
    else:
        slip, true, law = rng.uniform(0.0, 0.2, (RUNS, TOTAL)), MU_MAX, TRUTH
    columns = [
        disturbed(slip, lambda s: np.asarray(law(jnp.asarray(s), {})), noise, one, rng)
        for one in DISTURBANCES
    ]
    slip, adhesion, fresh = (
        jnp.asarray(np.stack(x))[..., None] for x in zip(*columns, strict=True)
    )
    time = jnp.broadcast_to(SAMPLING * jnp.arange(TOTAL)[:, None], slip.shape)
    conditions = {"slip_velocity_mps": SPEED * slip, "time_s": time}
    return Record(slip, adhesion, fresh, fresh, conditions), true


@functools.cache
def measured(name):
    """By disturbance, and from it on: whether all is finite, resets, RMSE at the end, skipped."""
    method = IDENTIFIERS[name]
    known = SLOPE.known if name == "rls-slope" else QIAN2024

    def one_run(record):
        def step(state, now):
            state = method.update(state, now)
            estimate = method.estimate(state)
            value = next(estimate.values[q] for q in ("mu_max", "slope") if q in estimate.values)
            return state, (value, estimate.reset, estimate.skipped)

        return jax.lax.scan(step, method.init(known, jax.random.key(0)), record)[1]

    record, true = streams(name)
    # Over the runs alone: the disturbances take turns, so that one program serves them all.
    run = optimised(lambda record: jax.lax.map(jax.vmap(one_run), record))
    value, reset, skipped = map(np.asarray, run(record))
    rmse = np.sqrt(np.mean((value[..., -1] - true) ** 2, axis=-1))
    return {
        one: {
            "finite": bool(np.all(np.isfinite(value[i, :, BEFORE:]))),
            "resets": float(np.sum(reset[i, :, BEFORE:]) / RUNS),
            "ratio": float(rmse[i] / rmse[0]),
            "skipped": float(np.sum(skipped[i]) / RUNS),
        }
        for i, one in enumerate(DISTURBANCES)
    }


CASES = [
    pytest.param(name, one, marks=MARKS.get(name, pytest.mark.thorough))
    for name in (*OWN, *PRINTED)
    for one in DISTURBANCES[1:]
]


def test_every_method_that_takes_single_samples_is_among_them():
    by_sample = [build(name).known for name in ("qian2024-switch", "fang2018-slope")]
    online = {n for n, i in IDENTIFIERS.items() if any(i.accepts(k) is None for k in by_sample)}
    # bayes-departure is for a rail that stays and weighs whole curves anew at each sample.
    assert online == {*OWN, *PRINTED, "bayes-departure"}


@pytest.mark.parametrize(("name", "disturbance"), CASES)
def test_samples_that_tell_nothing_new_do_not_harm(name, disturbance):
    """Finite, no more resets than without, and 300 samples later at most a tenth less accurate."""
    found, without = measured(name)[disturbance], measured(name)["gap"]
    if (name, disturbance) in WORSE:
        assert not found["ratio"] <= 1.1  # else it is no exception any more
        return
    assert found["finite"]
    assert found["resets"] <= without["resets"]
    assert found["ratio"] <= 1.1
    assert found["skipped"] == (disturbance in ("impossible", "not finite"))


def test_the_resets_that_are_counted_are_seen_where_there_are_some():
    """The same stream, but another rail after the disturbance: every run of `riv` resets."""
    method = IDENTIFIERS["riv"]
    rng = np.random.default_rng(1)
    slip = rng.uniform(0.0, 0.2, TOTAL)
    after = np.arange(TOTAL) >= BEFORE + DURING
    slip, every = jnp.asarray(slip), jnp.ones((TOTAL, 1), dtype=bool)
    clean = jnp.where(after, KIENCKE_RAILS["common"](slip, {}), TRUTH(slip, {}))
    adhesion = clean + SIGMA * rng.normal(size=TOTAL)
    record = Record(slip[:, None], adhesion[:, None], every, every, {})

    def step(state, now):
        state = method.update(state, now)
        return state, method.estimate(state).reset

    run = jax.jit(lambda: jax.lax.scan(step, method.init(QIAN2024, jax.random.key(0)), record)[1])
    reset = np.flatnonzero(run())
    assert reset.size == 1
    assert BEFORE + DURING <= reset[0] < BEFORE + DURING + 20


def table():
    """The figures of docs/online_at_standstill.md."""
    rows = [f"| method | {' | '.join(DISTURBANCES[1:])} |", "|---" * len(DISTURBANCES) + "|"]
    for name in (*OWN, *PRINTED):
        found = measured(name)
        cells = [f"{found[d]['ratio']:.3g}, {found[d]['resets']:.3g}" for d in DISTURBANCES[1:]]
        rows.append(f"| `{name}` | {' | '.join(cells)} |")
    return "\n".join(rows)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    print(table())
