import dataclasses
import itertools
import subprocess
import sys
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from lanes import lanes
from scipy import stats

from adhesion_jax.campaign.keys import noise_keys
from adhesion_jax.curves import free_values
from adhesion_jax.errors import InputError
from adhesion_jax.metrics.information import (
    cramer_rao_bound,
    quantities,
    quantity_names,
    true_quantities,
)
from adhesion_jax.scenarios import Options, build
from adhesion_jax.scenarios.course import Followed
from adhesion_jax.scenarios.rail_process import of_many
from adhesion_jax.scenarios.rails import HE2018, KIENCKE_RAILS, QIAN2024, RAILS

SIZES = {
    "single": (1, 500),
    "he2018-1": (20, 500),
    "he2018-blocks": (12, 500),
    "qian2024": (3, 250),
    "qian2024-switch": (100, 10),
    "drift": (100, 10),
    "coloured": (1, 500),
    "mismatch": (1, 500),
    "mismatch-kiencke": (1, 500),
}
SLIP_MAX = dict.fromkeys(SIZES, 0.2) | {"he2018-1": 0.5}

#: The slope of fang2018-slope is another kind of question, and so are its tests; a law of a user's
#: own has its tests with laws, and what is composed with `stream` those of its parts.
NAMES = [*SIZES]
WHITE = [name for name in NAMES if name != "coloured"]

#: Streams, in which every sample has a slip of its own, and those followed at every sample.
RANDOM_SLIP = {"qian2024", "qian2024-switch", "drift"}
BY_SAMPLE = {"qian2024-switch", "drift"}


def clean_adhesion(scenario, record):
    """The adhesion without noise, [blocks, points]; of a stream each sample has its curve."""
    if isinstance(scenario.course, Followed):
        shape, curve = record.slip.shape[-2:], scenario.rail.curve
        p1, p2 = (np.reshape(p, shape) for p in (curve.p1, curve.p2))
        return 40 * record.slip / (1 + p1 * record.slip + p2 * record.slip**2)
    return scenario.rail.adhesion(record.slip, {})


@jax.jit
def draw(scenario, key):
    return scenario.draw(key)


def noise_of(scenario, key):
    """What is left of a run when the truth is taken away, [blocks, points]."""
    record = draw(scenario, key)
    return np.asarray(record.adhesion - clean_adhesion(scenario, record))


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES)
def test_a_run_has_the_blocks_and_points_that_are_promised(name):
    scenario = build(name)
    record = scenario.draw(jax.random.key(0))
    shape = SIZES[name]
    assert record.slip.shape == record.adhesion.shape == record.mask.shape == shape
    assert record.mask.dtype == bool
    assert record.slip.dtype == record.adhesion.dtype == jnp.float64
    assert len(scenario.rails) == shape[0]
    assert scenario.noise.sigma == 0.01
    if name in RANDOM_SLIP:
        draw = jax.jit(jax.vmap(scenario.draw))
        slip = np.ravel(draw(jax.random.split(jax.random.key(0), 20)).slip[:, -1])
        assert stats.kstest(slip, "uniform", (0, SLIP_MAX[name])).pvalue > 1e-3
    else:
        expected = np.broadcast_to(np.linspace(0, SLIP_MAX[name], shape[1]), shape)
        np.testing.assert_allclose(record.slip, expected, atol=1e-15)
    assert scenario.known.by_sample == (name in BY_SAMPLE)
    if name.startswith("mismatch"):  # rails and box of its own
        return
    rails, known = (KIENCKE_RAILS, QIAN2024) if name in RANDOM_SLIP else (RAILS, HE2018)
    if name != "drift":
        truth = true_quantities(of_many([rails[rail] for rail in scenario.rails], (-1,)), known)
        for quantity, values in scenario.quantities().items():
            np.testing.assert_array_equal(values, truth[quantity])
    told = dataclasses.replace(scenario.known, by_sample=False, asked=known.asked)
    assert eqx.tree_equal(told, known)


@pytest.mark.parametrize("name", NAMES)
def test_every_point_is_fresh_once(name):
    """Blocks that overlap hold a point again and again; a method that is a stream takes it once."""
    scenario = build(name)
    record = jax.jit(lambda key: scenario.draw(key))(jax.random.key(0))
    mask, fresh = np.asarray(record.mask), np.asarray(record.fresh)
    assert not np.any(fresh & ~mask)
    if name in ("he2018-1", "qian2024"):
        np.testing.assert_array_equal(fresh.sum(axis=0), 1)
        np.testing.assert_array_equal(np.cumsum(fresh, axis=0) > 0, mask)
    else:
        np.testing.assert_array_equal(fresh, mask)


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES)
def test_options_change_what_they_name(name):
    options = Options(sigma=0.1, points=200, slip_max=0.3)
    scenario = build(name, options)
    record = scenario.draw(jax.random.key(0))
    blocks = 2 if name == "qian2024" else SIZES[name][0]  # no checkpoint beyond the last point
    assert record.slip.shape == ((20, 10) if name in BY_SAMPLE else (blocks, 200))
    assert float(np.max(record.slip)) == pytest.approx(0.3, rel=0.05 if name in RANDOM_SLIP else 0)
    assert scenario.noise.sigma == 0.1
    noise = noise_of(scenario, jax.random.key(0))
    assert np.std(noise if name in BY_SAMPLE else noise[-1]) == pytest.approx(0.1, rel=0.2)
    silent = build(name, Options(sigma=0.0))
    assert np.max(np.abs(noise_of(silent, jax.random.key(0)))) < 1e-15


@pytest.mark.parametrize(
    ("sigma", "name"), lanes(itertools.product([0.01, 0.1], WHITE), always=5, thorough=4)
)
def test_noise_is_normal_with_the_given_deviation(name, sigma):
    scenario = build(name, Options(sigma=sigma))
    # The last block: of a growing sequence the others hold the same points.
    draw = jax.jit(jax.vmap(scenario.draw))
    record = draw(jax.random.split(jax.random.key(1), 100))
    if name in BY_SAMPLE:
        noise = np.asarray(record.adhesion - clean_adhesion(scenario, record)).ravel() / sigma
    else:
        clean = np.asarray(jax.vmap(lambda slip: scenario.rail.adhesion(slip, {}))(record.slip))
        noise = (np.asarray(record.adhesion) - clean)[:, -1].ravel() / sigma
    assert abs(np.mean(noise)) < 4 / np.sqrt(noise.size)
    assert abs(np.std(noise) - 1) < 4 / np.sqrt(2 * noise.size)
    assert stats.kstest(noise, "norm").pvalue > 1e-3
    by_run = noise.reshape(100, -1)
    limit = 4 / np.sqrt(noise.size)
    assert abs(np.mean(by_run[1:] * by_run[:-1])) < limit
    assert abs(np.mean(by_run[:, 1:] * by_run[:, :-1])) < limit


def test_the_blocks_of_a_run_have_their_own_noise_and_a_growing_sequence_only_one():
    blocks = noise_of(build("he2018-blocks"), jax.random.key(2))
    correlation = np.corrcoef(blocks)[np.triu_indices(12, 1)]
    assert np.max(np.abs(correlation)) < 4.5 / np.sqrt(500)
    growing = noise_of(build("he2018-1"), jax.random.key(2))
    np.testing.assert_array_equal(growing, np.broadcast_to(growing[0], growing.shape))


@pytest.mark.parametrize("name", NAMES)
def test_the_key_decides_the_noise(name):
    scenario = build(name)
    one, again, other = (
        noise_of(scenario, key) for key in map(jax.random.key, (3, 3, 4))
    )  # fmt: skip
    np.testing.assert_array_equal(one, again)
    assert not np.any(one == other)
    pair = np.ravel(one), np.ravel(other)
    blocks_alike = one.shape[0] if name in ("he2018-1", "qian2024") else 1
    assert abs(np.corrcoef(*pair)[0, 1]) < 4.5 / np.sqrt(one.size / blocks_alike)


@pytest.mark.parametrize("name", ["qian2024-switch", "coloured"])
def test_a_run_is_the_same_to_the_bit_in_a_batch_of_any_size(name):
    draw = jax.jit(jax.vmap(build(name, Options(outliers=0.1)).draw))
    keys = noise_keys(5, name, jnp.arange(17))
    whole = draw(keys)
    for runs in (slice(0, 1), slice(3, 5), slice(4, 17)):
        for own, among in zip(draw(keys[runs])[:2], whole[:2], strict=True):
            np.testing.assert_array_equal(own, among[runs])


@pytest.mark.parametrize("name", lanes(WHITE, always=2, thorough=2))
def test_outliers_have_ten_times_the_deviation_and_the_share_asked_for(name):
    def drawn(share):
        scenario = build(name, Options(outliers=share))
        last = slice(None) if name in BY_SAMPLE else -1
        return np.stack([noise_of(scenario, jax.random.key(k))[last] for k in range(40)]).ravel()

    clean, spoiled, all_out = drawn(None), drawn(0.1), drawn(1.0)
    np.testing.assert_allclose(all_out, 10 * clean, atol=1e-14)
    is_outlier = np.abs(spoiled - clean) > 1e-14
    np.testing.assert_allclose(spoiled[is_outlier], 10 * clean[is_outlier], atol=1e-14)
    assert abs(is_outlier.mean() - 0.1) < 4 * np.sqrt(0.1 * 0.9 / clean.size)
    # Whether a point is one has nothing to do with its noise.
    assert stats.ks_2samp(clean[is_outlier], clean[~is_outlier]).pvalue > 1e-3


@pytest.mark.parametrize("points", [100, 137, 500])
def test_the_masks_of_a_growing_sequence_are_prefixes_that_grow_to_the_whole(points):
    scenario = build("he2018-1", Options(points=points))
    mask = np.asarray(draw(scenario, jax.random.key(0)).mask)
    seen = mask.sum(axis=1)
    assert mask.shape == (20, points)
    np.testing.assert_array_equal(seen, scenario.course.lengths)
    for row, count in zip(mask, seen, strict=True):
        assert row[:count].all()
        assert not row[count:].any()
    assert seen[-1] == points
    np.testing.assert_allclose(seen, points * np.arange(1, 21) / 20, atol=0.5)
    others = draw(build("he2018-blocks", Options(points=points)), jax.random.key(0)).mask
    assert np.all(others)


@pytest.mark.parametrize(("count", "switches"), [(None, (4, 8)), (150, (50, 100)), (6, (2, 4))])
def test_rails_come_in_order_and_switch_where_they_should(count, switches):
    rails = build("he2018-blocks", Options(blocks=count)).rails
    assert len(rails) == (count or 12)
    assert list(dict.fromkeys(rails)) == ["dry", "common", "wet"]
    assert tuple(b for b in range(1, len(rails)) if rails[b] != rails[b - 1]) == switches


def test_tables_pool_each_rail_without_the_first_block_after_a_switch():
    tables = build("he2018-blocks").tables()
    assert set(tables) == {"summary", "switches"}
    summary = {group.rail: group for group in tables["summary"]}
    assert summary["dry"].blocks == (0, 1, 2, 3)
    assert summary["common"].blocks == (5, 6, 7)
    assert summary["wet"].blocks == (9, 10, 11)
    assert [summary[rail].switched for rail in ("dry", "common", "wet")] == [None, 1, 2]
    assert [g.switched for g in tables["switches"]] == [1, 2]
    assert [(g.rail, g.blocks) for g in tables["switches"]] == [("common", (4,)), ("wet", (8,))]
    assert set(build("single").tables()) == {"summary"}
    growing = build("he2018-1").tables()
    assert [g.blocks for g in growing["summary"]] == [(19,)]
    assert [g.k for g in growing["checkpoints"]] == [25 * (j + 1) for j in range(20)]
    assert [g.blocks for g in growing["checkpoints"]] == [(j,) for j in range(20)]


@pytest.mark.thorough
@pytest.mark.parametrize("name", NAMES)
def test_what_is_shared_by_all_runs_is_declared(name):
    scenario = build(name, Options(points=100))
    keys = jax.random.split(jax.random.key(5), 3)
    # vmap refuses None for a field that differs between runs.
    batch = jax.vmap(scenario.draw, out_axes=scenario.run_axes)(keys)
    alone = scenario.draw(keys[1])
    shape = alone.slip.shape
    assert batch.mask.shape == batch.fresh.shape == shape
    assert batch.slip.shape == ((3, *shape) if name in RANDOM_SLIP else shape)
    assert batch.adhesion.shape == (3, *shape)
    np.testing.assert_allclose(batch.adhesion[1], alone.adhesion, rtol=1e-13, atol=1e-16)


def test_one_rail_can_be_chosen_where_there_is_one():
    for name, rails in (("single", RAILS), ("he2018-1", RAILS), ("qian2024", KIENCKE_RAILS)):
        assert set(build(name).rails) == {"dry"}
        for rail in ("common", "wet"):
            scenario = build(name, Options(rail=rail))
            assert set(scenario.rails) == {rail}
            assert scenario.rail.curve is rails[rail]


def test_the_rails_by_kiencke_have_the_peaks_of_those_by_burckhardt():
    printed = {"dry": (31.29, 100.0), "common": (122.6, 32.55), "wet": (282.7, 21.85)}
    for name, rail in KIENCKE_RAILS.items():
        ours, theirs = rail.peak({}), RAILS[name].peak({})
        assert float(ours.slip) == pytest.approx(float(theirs.slip), rel=1e-12)
        assert float(ours.adhesion) == pytest.approx(float(theirs.adhesion), rel=1e-12)
        assert rail.a0 == 40
        assert (rail.p1, rail.p2) == pytest.approx(printed[name], rel=1e-3)
        assert np.all(free_values(rail) > QIAN2024.lower)
        assert np.all(free_values(rail) < QIAN2024.upper)


def test_the_rails_are_those_of_the_paper_and_lie_inside_the_box_like_the_start():
    table = {"dry": (0.8287, 45.45, 0.4), "common": (0.32, 25, 0.1), "wet": (0.165, 15, 0.1)}
    assert {rail: (c.c1, c.c2, c.c3) for rail, c in RAILS.items()} == table
    np.testing.assert_array_equal(free_values(HE2018.curve), [0.5, 30.0, 0.08])
    np.testing.assert_array_equal(HE2018.lower, [0.1, 10.0, 0.05])
    np.testing.assert_array_equal(HE2018.upper, [1.0, 50.0, 0.5])
    for curve in (*RAILS.values(), HE2018.curve):
        assert np.all(free_values(curve) > HE2018.lower)
        assert np.all(free_values(curve) < HE2018.upper)


@pytest.mark.parametrize(
    ("name", "options", "option"),
    [
        ("single", Options(blocks=3), "--blocks"),
        ("single", Options(rail="icy"), "--rail icy"),
        ("he2018-1", Options(blocks=3), "--blocks"),
        ("he2018-1", Options(rail="icy"), "--rail icy"),
        ("he2018-1", Options(points=40), "--points 40"),
        ("he2018-blocks", Options(rail="dry"), "--rail"),
        ("he2018-blocks", Options(blocks=5), "--blocks 5"),
        ("qian2024", Options(blocks=5), "--blocks"),
        ("qian2024", Options(rail="icy"), "--rail icy"),
        ("qian2024", Options(points=29), "--points 29"),
        ("qian2024-switch", Options(rail="dry"), "--rail"),
        ("stream", Options(then="icy"), "--then icy"),
        ("stream", Options(truth="cubic"), "--truth cubic"),
        ("single", Options(told="exponential"), "--told exponential"),
        ("qian2024-switch", Options(blocks=5), "--blocks"),
        ("qian2024-switch", Options(points=110), "--points 110"),
        ("qian2024-switch", Options(points=80), "--points 80"),
        ("drift", Options(rail="icy"), "--rail icy"),
    ],
)
def test_options_that_do_not_fit_are_refused_by_name(name, options, option):
    with pytest.raises(InputError, match=option) as refused:
        build(name, options)
    sentence = str(refused.value)
    assert sentence.endswith(".")
    assert "\n" not in sentence
    if option == "--rail icy":
        assert "dry, common, wet" in sentence


def test_a_switching_stream_is_on_dry_then_on_common_rail():
    scenario = build("qian2024-switch", Options(sigma=0.0))
    record = scenario.draw(jax.random.key(3))
    slip, adhesion = np.ravel(record.slip), np.ravel(record.adhesion)
    for rail, part in (("dry", slice(500)), ("common", slice(500, 1000))):
        expected = KIENCKE_RAILS[rail](jnp.asarray(slip[part]), {})
        np.testing.assert_allclose(adhesion[part], expected, rtol=1e-12)
    tables = scenario.tables()
    assert [(g.rail, g.blocks) for g in tables["summary"]] == [("dry", (49,)), ("common", (99,))]
    steady = [(g.rail, g.blocks) for g in tables["steady"]]
    assert steady == [("dry", tuple(range(25, 50))), ("common", tuple(range(75, 100)))]
    k = [g.k for g in tables["checkpoints"]]
    assert {50, 500, 510, 550, 1000} <= set(k)
    assert k == sorted(set(k))


@pytest.mark.thorough
def test_the_bound_of_a_stream_is_that_of_the_data_since_the_switch():
    scenario = build("qian2024-switch")
    record = scenario.draw(jax.random.key(4))
    bound = np.asarray(jax.jit(lambda record: scenario.bound(record))(record))
    slip = np.ravel(record.slip)
    np.testing.assert_array_equal(scenario.support(), np.tile(np.arange(10, 501, 10), 2))
    for block, rail, part in (
        (9, "dry", slice(100)),
        (49, "dry", slice(500)),
        (50, "common", slice(500, 510)),
        (99, "common", slice(500, 1000)),
    ):
        part = jnp.asarray(slip[part])
        every = jnp.ones(part.shape, dtype=bool)
        alone = cramer_rao_bound(KIENCKE_RAILS[rail], part, every, {}, 0.01, QIAN2024)
        np.testing.assert_allclose(bound[block], alone, rtol=1e-9)
    # Tabulated by an independent prototype, in per cent of mu_max.
    truth = scenario.quantities()["mu_max"]
    keys = jax.random.split(jax.random.key(0), 40)
    many = jax.jit(jax.vmap(lambda key: scenario.bound(scenario.draw(key))))(keys)
    share = 100 * np.sqrt(np.mean(np.square(many), axis=0))[:, 2] / truth
    assert share[[49, 99]] == pytest.approx([0.0705, 0.256], rel=0.02)


def test_a_drifting_rail_loses_its_share_of_adhesion_and_keeps_its_slope_and_slip():
    scenario = build("drift", Options(rail="common"))
    first, last = (jax.tree.map(lambda x: x[k], scenario.rail.curve) for k in (0, -1))  # noqa: B023
    values = dict(zip(quantity_names(first), quantities(first, QIAN2024), strict=True))
    assert values["mu_max"] == pytest.approx(float(RAILS["common"].peak({}).adhesion), rel=1e-12)
    end = scenario.quantities()
    assert end["mu_max"][-1] / values["mu_max"] == pytest.approx(0.83, rel=1e-12)
    np.testing.assert_allclose(end["slip_opt"], values["slip_opt"], rtol=1e-12)
    assert last.a0 == first.a0


@pytest.mark.long
def test_no_job_loads_the_discovery():
    words = "import sys, adhesion_jax.library.montecarlo; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", words],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
        check=True,
        timeout=120,
    )
    assert "adhesion_jax.scenarios.catalogue" in done.stdout
    assert "adhesion_jax.discovery" not in done.stdout
