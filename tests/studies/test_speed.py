"""What is timed computes the same as its peer, and the rates are what they are said to be."""

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from matplotlib.image import imread
from scipy.optimize import least_squares

from adhesion_jax.campaign.job import Config, build_scenario
from adhesion_jax.campaign.tiles import TILE
from adhesion_jax.identifiers import IDENTIFIERS, Estimate
from adhesion_jax.records import Record
from adhesion_jax.scenarios import Options
from adhesion_jax.scenarios.rails import KIENCKE_RAILS
from experiments.speed import blocks, gpu, jobs, plants, recursions, scaling
from experiments.speed.__main__ import main
from experiments.speed.blocks import search_of_all_points
from experiments.speed.report import told
from experiments.speed.scaling import Batch, drawn
from experiments.speed.turns import Timed, rates

SAMPLES, RUNS, STREAMS = 120, 6, 2000


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    found = plants.compiled(tmp_path_factory.mktemp("loops"))
    if isinstance(found, str):
        pytest.skip(found)
    return found


def test_rates_are_medians_and_ratios_those_of_one_turn():
    # The machine of turn 2 is three times as slow, for all alike.
    def work(rate):
        return lambda turn: (10.0, 10.0 / rate * (3.0 if turn == 2 else 1.0))

    entries = {
        "peer": Timed(work(2.0)),
        "fast": Timed(work(8.0), "a remark", 1.5),
        "missing": Timed(None, "Not timed: it is not there."),
    }
    seen = []
    table = rates("part", "units", "peer", entries, 3, seen.append).set_index("name")
    assert seen == ["peer", "fast"] * 4
    assert table.loc["fast", "rate"] == pytest.approx(8.0)
    assert table.loc["fast", "lowest"] == pytest.approx(8.0 / 3)
    ratio = table.loc["fast", ["ratio_lowest", "ratio", "ratio_highest"]]
    assert ratio.tolist() == pytest.approx([4.0] * 3)
    assert np.isnan(table.loc["missing", "rate"])
    text = told(table.reset_index())
    assert "4 times peer (4 to 4)" in text
    assert "Not timed: it is not there." in text


def test_quick_work_is_done_again_until_the_clock_tells_it():
    taken = []

    def work(turn):
        # The first time after other work is slow.
        taken.append(turn)
        return 1.0, 0.03 if taken.count(turn) == 1 else 0.001

    table = rates("part", "units", "", {"quick": Timed(work)}, 1, lambda _: None)
    assert taken.count(1) == 171
    assert table["rate"][0] == pytest.approx(171 / 0.2, rel=1e-3)


@pytest.fixture(scope="module")
def streams():
    """Slip and adhesion [SAMPLES, STREAMS] with a switch of the rail.

    The slip is small in the first stream and large in the last one; with a small one p2 is so
    uncertain that the best x is often on the edge of the box.
    """
    random = np.random.default_rng(4)
    slip = random.uniform(0.0, np.geomspace(0.01, 0.2, STREAMS), (SAMPLES, STREAMS))
    wet, dry = (np.asarray(KIENCKE_RAILS[name](jnp.asarray(slip), {})) for name in ("wet", "dry"))
    clean = np.where(np.arange(SAMPLES)[:, None] < SAMPLES // 2, wet, dry)
    return slip, clean + random.normal(0.0, 0.01, slip.shape)


def after(name, known, slip, adhesion):
    """The state of the identifier after these streams."""
    every = jnp.ones(len(slip), dtype=bool)
    method = IDENTIFIERS[name]
    state = method.init(known, jax.random.key(0))

    def update(slip, adhesion):
        return method.update(state, Record(slip, adhesion, every, every, {}))

    return jax.jit(jax.vmap(update, in_axes=1))(jnp.asarray(slip), jnp.asarray(adhesion))


@pytest.fixture(scope="module")
def known():
    return build_scenario(Config("qian2024", options=Options(points=SAMPLES))).known


@pytest.mark.parametrize("name", recursions.RECURSIONS)
def test_recursive_least_squares_in_numpy_is_the_identifier(name, known, streams):
    state = after(name, known, *streams)
    *sums, _ = jax.tree.leaves(state.recursion)
    found = recursions.RECURSIONS[name](*streams)
    np.testing.assert_allclose(found, [*sums, state.objective], rtol=1e-5)


# After a few samples, where the statistic begins; soon after the switch, where the variance of the
# noise is at its largest; and at the end.
@pytest.mark.long
@pytest.mark.parametrize("samples", [8, SAMPLES // 2 + 5, SAMPLES])
@pytest.mark.parametrize("name", recursions.PROGRAMS)
def test_a_quadratic_program_in_numpy_is_the_identifier(name, samples, known, streams):
    first = [stream[:samples] for stream in streams]
    state = after(name, known, *first)
    recursion, box = state.recursion, (np.asarray(known.lower), np.asarray(known.upper))
    found = np.array(recursions.PROGRAMS[name](*first, box))
    noise = recursion.noise if name == "qp-bias-compensated" else ()
    numbers = jax.tree.leaves((recursion.x, recursion.normal, noise))
    np.testing.assert_allclose(found, [*numbers, state.objective], rtol=1e-5)
    on_edge = np.any(np.isin(found[:2].T, box), axis=1)
    assert 0 < on_edge.sum() < STREAMS


def test_a_plant_moves_alike_in_jax_and_in_c(library, monkeypatch):
    monkeypatch.setattr(plants, "RUNS", 100)
    begun = plants.start()
    state = plants.in_jax(begun)()
    expected = state.motor_speed[:, 0], state.train_speed, state.torque[:, 0]
    assert not np.allclose(state.motor_speed[:, 0], begun.motor_speed, rtol=1e-4)
    for own, its in zip(expected, plants.in_c(begun, library)(), strict=True):
        np.testing.assert_allclose(its, own, rtol=1e-9, atol=1e-12)


@pytest.mark.long
def test_the_search_over_all_points_finds_the_optimum():
    config = Config("single", options=Options(points=60))
    scenario = build_scenario(config)
    keys = jax.random.split(jax.random.key(3), RUNS)
    records = jax.jit(jax.vmap(scenario.draw, out_axes=scenario.run_axes))(keys)
    slip, blocks = records.slip[0], records.adhesion[:, 0]
    lower, upper = jnp.asarray(scenario.known.lower), jnp.asarray(scenario.known.upper)
    search = search_of_all_points(slip, (lower, upper), RUNS, 40, 300)
    found = np.asarray(search(keys, blocks))

    def left(x, slip, adhesion):
        return x[0] * (1 - np.exp(-x[1] * slip)) - x[2] * slip - adhesion

    for x, adhesion in zip(found, np.asarray(blocks), strict=True):
        best = least_squares(
            left, x, bounds=(lower, upper), args=(np.asarray(slip), adhesion), xtol=1e-14,
            x_scale=upper - lower,
        )  # fmt: skip
        assert np.sum(left(x, slip, adhesion) ** 2) <= 2 * best.cost * (1 + 1e-6)


@pytest.mark.thorough
def test_a_gpu_is_measured_beside_a_core_on_the_same_runs(monkeypatch):
    # The CPU stands for one.
    chosen = [case for case in gpu.CASES if case.method in ("ml-exact", "rls-kiencke")]
    monkeypatch.setattr(gpu, "CASES", chosen)
    monkeypatch.setattr(gpu, "RUN_COUNTS", (TILE, TILE + 50))
    monkeypatch.setattr(gpu, "POINTS", 100)
    table = gpu.measured_on(jax.devices()[0], 1, 3).set_index(["part", "name"])
    kind = jax.devices()[0].device_kind
    assert [*table.index] == [
        (f"GPU: {case.method}", name)
        for case in chosen
        for name in (gpu.PEER, f"{kind}, 128 runs", f"{kind}, 178 runs")
    ]
    assert (table["rate"] > 0).all()
    assert (table["ratio"].xs(gpu.PEER, level="name") == 1).all()
    differ = table["remark"].str.extract(r"differs from that of the core by (\S+) at most")[0]
    assert differ.isna().sum() == len(chosen)
    assert (differ.dropna().astype(float) < 1e-10).all()
    assert "GPU: lm: identifications per second by the clock" in told(
        table.reset_index().assign(part="GPU: lm", unit="identifications")
    )


@pytest.mark.parametrize("case", gpu.CASES, ids=lambda case: case.method)
def test_what_is_counted_on_a_gpu_is_what_a_run_holds(case, monkeypatch):
    def batch(_, config, __):
        estimate = Estimate({"mu_max": jnp.zeros(config.runs)}, *7 * [jnp.zeros(config.runs)])
        return Batch(lambda: estimate, 0.1)

    seen = []
    monkeypatch.setattr(gpu, "batch_on", batch)
    monkeypatch.setattr(gpu, "timed", lambda _, amount, __: seen.append(amount))
    gpu._entries(case, jax.devices()[0], 0)
    options = Options(points=gpu.POINTS)
    (fresh,) = drawn(Config(case.scenario, options=options, runs=1)).fresh[None]
    each = len(fresh) if case.unit == "identifications" else int(np.sum(fresh))
    assert seen == [each * runs for runs in (TILE, *gpu.RUN_COUNTS)]


@pytest.mark.parametrize(
    ("found", "expected", "words"),
    [
        ([0.5, np.nan, 0.3, 9.0], [0.5, np.nan, 0.5], "differs from that of the core by 0.2 at"),
        ([0.5, 0.5, 0.5], [np.nan, np.nan, 0.5], "2 of 3 runs lack an adhesion maximum on one"),
        ([np.nan] * 3, [np.nan] * 3, "differs from that of the core by 0 at most"),
        ([[0.5, 0.5]] * 3, [[0.5, 0.5], [np.nan] * 2, [0.5, 0.4]], "1 of 3 runs lack"),
    ],
)
def test_a_run_without_a_result_on_one_of_two_processors_is_told(
    monkeypatch, found, expected, words
):
    monkeypatch.setattr(gpu, "TILE", 3)
    both = (
        Estimate({"mu_max": jnp.array(values)}, *7 * [jnp.zeros(3)]) for values in (found, expected)
    )
    assert words in gpu._difference(*both)


@pytest.mark.long
def test_without_a_gpu_one_row_says_so(monkeypatch):
    monkeypatch.setenv("JAX_PLATFORMS", "cpu")
    table = gpu.table(1, 0)
    assert table["remark"].tolist() == ["Not timed: jax finds no GPU."]
    assert told(table).splitlines()[1].split(maxsplit=1) == ["GPU", table["remark"][0]]


@pytest.mark.long
def test_a_gpu_that_fails_is_told_and_the_rest_is_timed(monkeypatch):
    monkeypatch.setenv("JAX_PLATFORMS", "no_such_platform")
    (remark,) = gpu.table(1, 0)["remark"]
    assert remark.startswith("Not timed: the GPU cannot be used (")
    monkeypatch.undo()

    def full(_, config, __):
        if config.runs > TILE:
            raise jax.errors.JaxRuntimeError("RESOURCE_EXHAUSTED: out of memory\nof the GPU")
        return Batch(lambda: Estimate({"mu_max": jnp.zeros(TILE)}, *7 * [jnp.zeros(TILE)]), 0.1)

    monkeypatch.setattr(gpu, "batch_on", full)
    table = gpu.measured_on(jax.devices()[0], 1, 0).set_index("name")
    large = table["remark"][table.index.str.contains("32,768")]
    assert len(large) == len(gpu.CASES)
    assert set(large) == {"Not timed: the GPU cannot be used (RESOURCE_EXHAUSTED: out of memory)."}
    assert (table["rate"][table.index == gpu.PEER] > 0).all()


@pytest.mark.clock
def test_speed_is_told_beside_its_peers(tmp_path, monkeypatch):
    chosen = ("ml-exact", "lm", "lm-jaxopt")
    monkeypatch.setattr(blocks, "IDENTIFIERS", {name: IDENTIFIERS[name] for name in chosen})
    monkeypatch.setattr(recursions, "RUNS", 2000)
    for name in ("RUN_COUNTS", "POINT_COUNTS", "MEMBER_COUNTS"):
        monkeypatch.setattr(scaling, name, (10, 50))
    monkeypatch.setattr(jobs, "MANY", 1024)
    done = CliRunner().invoke(main, ["--repeats", "2", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    table = pd.read_csv(tmp_path / "speed.csv").set_index(["part", "name"])
    timed = table[table["rate"].notna()]
    assert table.loc[table["rate"].isna(), "remark"].str.startswith("Not timed: ").all()
    many = timed[timed["lowest"].notna()]
    assert (many["lowest"] <= many["rate"]).all()
    assert (many["rate"] <= many["highest"]).all()
    ratio = table["ratio"].loc["blocks"]
    assert ratio["scipy-de"] == 1
    assert ratio["ml-exact"] > 2000
    assert ratio["de-all-points"] > 20
    assert ratio["lm"] > 1500
    assert ratio["lm"] > 3 * ratio["lm-jaxopt"]
    for name in recursions.RECURSIONS:
        assert table["ratio"].loc[f"recursion: {name}", name] > 1
    for name in recursions.PROGRAMS:
        assert table["ratio"].loc[f"quadratic program: {name}", name] > 1
    for name in ("speed.png", "speed_scaling.png"):
        assert imread(tmp_path / name).std() > 0
