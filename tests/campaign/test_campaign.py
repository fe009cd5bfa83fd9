"""The campaign: seeds, tiles, metrics, tables."""

import dataclasses
import errno
import functools
import operator
import pickle
import tracemalloc
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from scipy.stats import t as student_t

from adhesion_jax.campaign import tiles
from adhesion_jax.campaign.job import Config, Job, build_scenario, choose_identifiers
from adhesion_jax.campaign.keys import noise_keys, solver_keys
from adhesion_jax.campaign.monte_carlo import run_campaign
from adhesion_jax.campaign.shard import content
from adhesion_jax.errors import InputError
from adhesion_jax.files import staged
from adhesion_jax.identifiers import ABLATIONS, Estimate, Identifier
from adhesion_jax.identifiers.ml_exact import ExactMaximumLikelihood
from adhesion_jax.metrics.accuracy import Outcome, Truth, run_statistics, table_rows
from adhesion_jax.metrics.information import cramer_rao_bound, quantities, quantity_names
from adhesion_jax.metrics.moments import Moments
from adhesion_jax.scenarios import SCENARIOS, Options
from adhesion_jax.scenarios.catalogue import single
from adhesion_jax.scenarios.noise import Noise
from adhesion_jax.scenarios.rails import HE2018, RAILS


def collect(config, workers=1):
    frames, words = [], []
    campaign = run_campaign(config, frames.append, words.append, workers)
    assert len(words) == -(-config.runs // tiles.TILE)
    return campaign, pd.concat(frames, ignore_index=True)


def without_times(table):
    return table.drop(columns=[name for name in table if "seconds" in name])


# Percentages of the truth for sigma .01, as tabulated by an independent NumPy prototype.
BOUNDS = {
    "dry": (0.29, 0.63, 4.13, 0.088, 0.56),
    "common": (1.8, 2.4, 32.8, 0.276, 5.4),
    "wet": (10.2, 9.6, 73.5, 1.43, 13.4),
}


@pytest.mark.parametrize("rail", BOUNDS)
def test_cramer_rao_bound_agrees_with_tabulated_values(rail):
    slip, every = jnp.linspace(0, 0.2, 500), jnp.ones(500, dtype=bool)
    bound = jax.jit(lambda: cramer_rao_bound(RAILS[rail], slip, every, {}, 0.01, HE2018))()
    share = 100 * np.asarray(bound) / np.asarray(quantities(RAILS[rail], HE2018))
    assert share == pytest.approx(np.array(BOUNDS[rail]), rel=0.025)


def test_cramer_rao_bound_from_the_analytic_sensitivities():
    c1, c2, c3 = 0.8287, 45.45, 0.4
    slip = np.linspace(0, 0.2, 300)
    decay = np.exp(-c2 * slip)
    jacobian = np.stack([1 - decay, c1 * slip * decay, -slip], axis=1)
    covariance = 0.02**2 * np.linalg.inv(jacobian.T @ jacobian)
    peak = np.log(c1 * c2 / c3) / c2
    of_peak = np.array([1 - np.exp(-c2 * peak), c1 * peak * np.exp(-c2 * peak), -peak])
    of_slip = np.array([1 / (c1 * c2), (1 / c2 - peak) / c2, -1 / (c2 * c3)])
    gradient = np.vstack([np.eye(3), of_peak, of_slip])
    expected = np.sqrt(np.diag(gradient @ covariance @ gradient.T))
    every = jnp.ones(300, dtype=bool)
    bound = jax.jit(lambda slip: cramer_rao_bound(RAILS["dry"], slip, every, {}, 0.02, HE2018))(
        jnp.asarray(slip)
    )
    assert np.asarray(bound) == pytest.approx(expected, rel=1e-9)


def test_moments_in_parts_are_moments_of_the_whole():
    draws = np.random.default_rng(0).normal(3, 2, (700, 4))
    parts = [Moments.of({"x": part}) for part in np.split(draws, [128, 256, 600])]
    whole = functools.reduce(functools.partial(jax.tree.map, operator.add), parts)
    assert whole.runs == 700
    assert whole.mean("x") == pytest.approx(draws.mean(axis=0), rel=1e-12)
    expected = draws.std(axis=0, ddof=1) / np.sqrt(700)
    assert whole.standard_error("x") == pytest.approx(expected, rel=1e-9)
    assert np.isnan(Moments.of({"x": draws[:1]}).standard_error("x")).all()


SECONDS = Moments.of({"seconds": np.array([1e-3])})


def hand_made():
    """Two runs of four blocks whose metrics can be worked out by hand."""
    truth_values = np.array([[1.0, 0.5]] * 2 + [[2.0, 0.25]] * 2)
    values = np.repeat(truth_values[None], 2, axis=0).copy()
    values[:, :, 0] += np.array([[0.1, -0.1, 0.2, 0.0], [0.3, 0.1, 0.0, 0.0]])
    values[:, :, 1] *= 1 + np.array([[0, 0, 0.05, 0.01], [0, 0, 0.04, 0.05]])
    outcome = Outcome(
        values=values,
        standard_errors=np.full(values.shape, 0.1),
        robust=np.full(values.shape, 0.15),
        on_box=np.array([[1, 0, 0, 0], [0, 0, 0, 0]], dtype=bool),
        unusable=np.array([[0, 1, 0, 0], [0, 0, 0, 0]], dtype=bool),
        objective=np.array([[1.0, 1, 1, 1], [1, 1.002, 1, 1]]),
        optimum=np.ones((2, 4)),
        optimum_on_box=np.array([[1, 0, 0, 0], [0, 0, 0, 0]], dtype=bool),
        evaluations=np.full((2, 4), 7.0),
        delay=np.array([[0, 1], [0, 2]]),
    )
    truth = Truth(
        names=("c1", "mu_max"),
        values=truth_values,
        bound=np.full((2, 4, 2), 0.1),
        sigma=0.04,
        quantile=np.full(4, 1.96),
    )
    return outcome, truth


def test_metrics_of_a_case_done_by_hand():
    outcome, truth = hand_made()
    statistics = run_statistics(outcome, truth, (0, 1), None)
    table = pd.DataFrame(table_rows(Moments.of(statistics), truth, (0, 1), SECONDS))
    row = table.set_index("quantity").loc["c1"]
    assert row["bias"] == pytest.approx((0.1 - 0.1 + 0.3 + 0.1) / 4)
    assert row["rmse"] == pytest.approx(np.sqrt((0.01 + 0.01 + 0.09 + 0.01) / 4))
    assert row["coverage95"] == pytest.approx(3 / 4)  # 0.3 is beyond 1.96 * 0.1
    assert row["coverage95_robust"] == pytest.approx(3 / 4)  # and beyond 0.15
    assert row["at_bound_share"] == pytest.approx(1 / 4)
    assert np.isnan(row["rmse_over_crlb"])  # too many runs on the box
    # One block unusable, one with a gap of 0.002 > sigma^2 = 0.0016.
    assert row["failure_share"] == pytest.approx(2 / 4)
    assert np.isnan(row["delay_steps"])
    assert row["bias_se"] == pytest.approx(0.1)  # the means of the two runs are 0 and 0.2
    assert row["evaluations"] == 7


def test_efficiency_is_given_where_the_box_is_not_touched():
    outcome, truth = hand_made()
    statistics = run_statistics(outcome, truth, (2, 3), None)
    table = pd.DataFrame(table_rows(Moments.of(statistics), truth, (2, 3), SECONDS))
    row = table.set_index("quantity").loc["c1"]
    assert row["rmse_over_crlb"] == pytest.approx(np.sqrt(0.04 / 4) / 0.1)


def test_the_delay_is_that_of_the_stretch_of_the_row():
    outcome, truth = hand_made()
    assert run_statistics(outcome, truth, (3,), 1)["delay"].tolist() == [1.0, 2.0]


def test_a_gap_that_is_not_a_number_is_a_failure():
    outcome, truth = hand_made()
    broken = outcome._replace(objective=np.full((2, 4), np.nan))
    assert run_statistics(broken, truth, (0,), None)["failed"].tolist() == [1.0, 1.0]


class NanWhereHigh(ExactMaximumLikelihood):
    """It says NaN with the status of a good estimate."""

    FITS_LAST_RECORD: ClassVar[bool] = False

    def estimate(self, state):
        found = super().estimate(state)
        mu_max = found.values["mu_max"]
        lost = jnp.where(mu_max > 0.78, jnp.nan, mu_max)
        return found._replace(values={**found.values, "mu_max": lost})


def test_an_estimate_that_is_not_a_number_is_a_failure_whatever_its_status():
    config = Config("single", ("mine",), Options(points=40), 64)
    rows = []
    campaign = run_campaign(config, rows.append, lambda _: None, 1, {"mine": NanWhereHigh()})
    lost = pd.concat(rows)["mu_max"].isna().mean()
    assert 0.1 < lost < 0.9
    assert campaign.tables["summary"]["failure_share"].iloc[0] == pytest.approx(lost)


def test_keys_depend_on_seed_scenario_run_and_for_solvers_on_the_name():
    runs = jnp.arange(3)

    def data(keys):
        return np.asarray(jax.random.key_data(keys))

    base = data(noise_keys(1, "single", runs))
    assert (base == data(noise_keys(1, "single", jnp.arange(9)))[:3]).all()
    for other in (
        noise_keys(2, "single", runs),
        noise_keys(1, "he2018-1", runs),
        solver_keys(1, "single", "ml-de", runs),
    ):
        assert (base != data(other)).any(axis=-1).all()
    first, second = (data(solver_keys(1, "single", name, runs)) for name in ("ml-de", "ml-exact"))
    assert (first != second).any(axis=-1).all()


SMALL = Config(
    scenario="he2018-blocks",
    identifiers=("ml-exact", "ml-de-he2018", "lm-jaxopt"),
    options=Options(points=60, blocks=6),
    runs=150,
    seed=3,
)


@pytest.fixture(scope="module")
def small():
    return collect(SMALL)


@pytest.mark.thorough
def test_same_numbers_whatever_the_number_of_workers():
    config = dataclasses.replace(SMALL, runs=300)  # three shards, which is enough for two workers
    campaign, estimates = collect(config)
    parallel, parallel_estimates = collect(config, workers=2)
    pd.testing.assert_frame_equal(estimates, parallel_estimates, check_exact=True)
    for name, table in campaign.tables.items():
        pd.testing.assert_frame_equal(
            without_times(table), without_times(parallel.tables[name]), check_exact=True
        )


@pytest.mark.thorough
def test_a_run_does_not_depend_on_how_many_there_are_nor_on_the_other_methods(small):
    few = dataclasses.replace(SMALL, runs=5, identifiers=("ml-de-he2018",))
    _, estimates = collect(few)
    _, many = small
    chosen = many[(many["run"] < 5) & (many["identifier"] == "ml-de-he2018")]
    pd.testing.assert_frame_equal(estimates, chosen.reset_index(drop=True), check_exact=True)


@pytest.mark.long
def test_the_time_to_compile_is_told_of_small_jobs_too(small):
    """Their programs are compiled before the first shard."""
    assert all(seconds > 0 for seconds in small[0].compile_seconds.values())


@pytest.mark.long
def test_the_tables_say_what_the_estimates_say(small):
    campaign, estimates = small
    assert len(estimates) == 150 * 6 * 3
    summary = campaign.tables["summary"]
    assert list(campaign.tables) == ["summary", "switches", "tracking"]
    truth = dict(
        zip(quantity_names(RAILS["wet"]), np.asarray(quantities(RAILS["wet"], HE2018)), strict=True)
    )
    # The first block after a switch (4) stands in the other table.
    chosen = estimates[(estimates["identifier"] == "ml-exact") & (estimates["block"] == 5)]
    row = summary.query("identifier == 'ml-exact' and rail == 'wet'").set_index("quantity")
    for quantity, true in truth.items():
        error = chosen[quantity] - true
        assert row.loc[quantity, "bias"] == pytest.approx(error.mean(), rel=1e-9)
        assert row.loc[quantity, "rmse"] == pytest.approx(np.sqrt((error**2).mean()), rel=1e-9)
        assert row.loc[quantity, "runs"] == 150
    switches = campaign.tables["switches"]
    assert switches["rail"].unique().tolist() == ["common", "wet"]
    at_switch = estimates[(estimates["identifier"] == "lm-jaxopt") & (estimates["block"] == 4)]
    row = switches.query("identifier == 'lm-jaxopt' and rail == 'wet' and quantity == 'c2'")
    assert row["bias"].item() == pytest.approx((at_switch["c2"] - 15.0).mean(), rel=1e-9)


class Still(Identifier):
    """Answers the curve it was told to begin with, whatever it is shown."""

    FITS_LAST_RECORD: ClassVar[bool] = False
    RESETS: ClassVar[bool] = False

    def accepts(self, known):
        return None

    def init(self, known, key):
        return quantities(known.curve, known)

    def update(self, state, record):
        return state

    def estimate(self, state):
        names = quantity_names(RAILS["dry"])
        none, unit = jnp.zeros((), dtype=int), jnp.eye(len(names))
        values = dict(zip(names, state, strict=True))
        no, nothing = jnp.zeros((), dtype=bool), jnp.zeros(())
        return Estimate(values, unit, none, nothing, no, jnp.asarray(jnp.nan), none, none)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "blocks", "bytes_a_run"),
    [
        # Nothing of a run is kept: what grows is what jax remembers of its calls, 35 bytes a run.
        # A row of estimates would be about 200.
        ("single", 1, 60),
        ("he2018-blocks", 6, 60),
    ],
)
def test_memory_of_a_campaign_is_that_of_its_tiles(scenario, blocks, bytes_a_run):
    options = Options(points=20, blocks=6) if blocks > 1 else Options(points=20)

    def peak(number):
        """Largest memory of a campaign of so many tiles, whose rows are given away."""
        given = []
        config = Config(scenario, ("still",), options, runs=number * tiles.TILE)
        tracemalloc.start()
        try:
            run_campaign(
                config, lambda rows: given.append(len(rows)), lambda _: None, 1, {"still": Still()}
            )
            most = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert sum(given) == number * tiles.TILE * blocks
        return most

    peak(2)  # which compiles
    # The largest shards of both have two tiles. What else a process does meanwhile adds to a peak.
    few, many = (min(peak(number) for _ in range(3)) for number in (20, 48))
    assert many - few < 28 * tiles.TILE * bytes_a_run


@pytest.mark.thorough
def test_growing_sequence_has_a_row_for_every_length():
    config = Config("he2018-1", ("ml-exact",), Options(points=200), runs=20)
    campaign, _ = collect(config)
    checkpoints = campaign.tables["checkpoints"]
    assert checkpoints["k"].unique().tolist() == list(range(10, 201, 10))
    peak = checkpoints[checkpoints["quantity"] == "mu_max"]
    assert (np.diff(peak["crlb"]) < 0).all()  # more points, smaller bound
    last = checkpoints[checkpoints["k"] == 200].drop(columns="k").reset_index(drop=True)
    pd.testing.assert_frame_equal(last, campaign.tables["summary"], check_exact=True)


@pytest.fixture(scope="module")
def many():
    return collect(Config("single", ("ml-exact",), runs=2048))


def test_ml_exact_reaches_the_bound_and_its_intervals_cover(many):
    campaign, _ = many
    summary = campaign.tables["summary"].set_index("quantity")
    ratio, error = summary["rmse_over_crlb"], summary["rmse_over_crlb_se"]
    assert (np.abs(ratio - 1) < 4 * error).all()
    assert error.to_numpy() == pytest.approx(1 / np.sqrt(2 * 2048), rel=0.15)
    assert (np.abs(summary["coverage95"] - 0.95) < 4 * summary["coverage95_se"]).all()
    assert (np.abs(summary["bias"]) < 4 * summary["bias_se"]).all()


def test_a_planted_error_of_a_tenth_of_a_per_cent_in_mu_max_is_seen(many):
    """The criteria above fail where every mu_max is that much too high."""
    campaign, rows = many
    truth = campaign.tables["summary"].set_index("quantity").loc["mu_max", "truth"]
    peaks = rows["mu_max"].to_numpy()[:, None, None]
    scenario = build_scenario(Config("single"))
    plain = np.zeros(peaks.shape[:2])

    def row(values):
        outcome = Outcome(
            values=values,
            standard_errors=rows["mu_max_se"].to_numpy()[:, None, None],
            robust=np.full(peaks.shape, np.nan),
            on_box=plain.astype(bool),
            unusable=plain.astype(bool),
            objective=plain,
            optimum=plain,
            optimum_on_box=plain.astype(bool),
            evaluations=plain,
            delay=plain,
        )
        about = Truth(
            names=("mu_max",),
            values=np.array([[truth]]),
            bound=np.full(peaks.shape, campaign.tables["summary"]["crlb"].iloc[3]),
            sigma=scenario.noise.sigma,
            quantile=student_t.ppf(0.975, np.array([497])),
        )
        moments = Moments.of(run_statistics(outcome, about, (0,), None))
        return pd.DataFrame(table_rows(moments, about, (0,), SECONDS)).iloc[0]

    right, wrong = row(peaks), row(peaks * 1.001)
    assert abs(right["bias"]) < 4 * right["bias_se"]
    assert abs(wrong["bias"]) > 4 * wrong["bias_se"]
    assert abs(right["rmse_over_crlb"] - 1) < 4 * right["rmse_over_crlb_se"]
    assert abs(wrong["rmse_over_crlb"] - 1) > 4 * wrong["rmse_over_crlb_se"]
    assert abs(wrong["coverage95"] - 0.95) > 4 * wrong["coverage95_se"]


def test_every_identifier_but_the_ablations_runs_unless_named():
    config = Config("single")
    names = choose_identifiers(config, build_scenario(config))
    assert names == (
        *("ml-exact", "ml-pooled", "ml-de", "ml-de-he2018", "ml-de-robust"),
        *("lm", "lm-jaxopt", "gn-optimistix"),
    )
    assert not set(ABLATIONS) & set(names)
    config = Config("qian2024")
    names = choose_identifiers(config, build_scenario(config))
    assert {"ls-kiencke", "qp-qian2024-1", "rls-kiencke", "lm"} <= set(names)
    assert not any(name.startswith("ml") for name in names)


@pytest.mark.parametrize(
    ("config", "words"),
    [
        (Config("nowhere"), ("--scenario nowhere", "single")),
        (Config("single", ("ml-exact", "guess")), ("--identifiers guess", "ml-exact")),
    ],
)
def test_unknown_names_are_answered_with_the_known_ones(config, words):
    with pytest.raises(InputError) as refusal:
        choose_identifiers(config, build_scenario(config))
    assert all(word in str(refusal.value) for word in words)


def test_staged_files_appear_together_or_not_at_all(tmp_path):
    (tmp_path / "kept.txt").write_text("other")
    (tmp_path / "table.csv").write_text("old")
    (tmp_path / "once.csv").write_text("of an earlier job")

    def fail():
        with staged(tmp_path, ("table.csv", "once.csv")) as stage:
            (stage / "table.csv").write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert (tmp_path / "table.csv").read_text() == "old"
    assert (tmp_path / "once.csv").read_text() == "of an earlier job"
    with staged(tmp_path, ("table.csv", "once.csv")) as stage:
        (stage / "table.csv").write_text("new")
    assert (tmp_path / "table.csv").read_text() == "new"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept.txt", "table.csv"]


def test_a_folder_with_the_name_of_a_file_is_refused_before_any_work(tmp_path):
    (tmp_path / "table.csv").mkdir()
    with (
        pytest.raises(InputError, match="folder table"),
        staged(tmp_path, ("table.csv", "figure.png")) as stage,
    ):
        (stage / "figure.png").write_text("not reached")
    assert [path.name for path in tmp_path.iterdir()] == ["table.csv"]


def test_a_full_disk_is_answered_in_a_sentence(tmp_path):
    with pytest.raises(InputError, match="No space left"), staged(tmp_path, ("table.csv",)):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.thorough
def test_a_method_that_pools_blocks_is_held_against_the_bound_of_its_pool():
    """That of all the points of the pool, by brute force; the others against one block."""
    config = Config("he2018-blocks", ("ml-exact", "ml-pooled"), Options(blocks=6, points=60), 100)
    summary, switches = (
        collect(config)[0].tables[name].set_index(["identifier", "rail", "quantity"])
        for name in ("summary", "switches")
    )
    slip = jnp.linspace(0, 0.2, 60)

    def bound(rail, blocks):
        every = jnp.ones(60 * blocks, dtype=bool)
        found = cramer_rao_bound(RAILS[rail], jnp.tile(slip, blocks), every, {}, 0.01, HE2018)
        return dict(zip(quantity_names(RAILS[rail]), np.asarray(found), strict=True))

    for quantity in ("c1", "mu_max", "slip_opt"):
        one, two = bound("dry", 1)[quantity], bound("dry", 2)[quantity]
        both = np.sqrt((one**2 + two**2) / 2)  # the first and the second block of the run
        assert summary.loc["ml-exact", "dry", quantity]["crlb"] == pytest.approx(one)
        assert summary.loc["ml-pooled", "dry", quantity]["crlb"] == pytest.approx(both)
        # On the other rails the block after the switch stands in a table of its own.
        assert switches.loc["ml-pooled", "wet", quantity]["crlb"] == pytest.approx(
            bound("wet", 1)[quantity]
        )
        assert summary.loc["ml-pooled", "wet", quantity]["crlb"] == pytest.approx(
            bound("wet", 2)[quantity]
        )


@pytest.mark.long
def test_two_scenarios_of_one_name_live_in_one_session(monkeypatch):
    """A job keeps the scenario that it was given, whatever has its name meanwhile."""
    jobs = []
    for sigma in (0.01, 0.02):
        monkeypatch.setitem(SCENARIOS, "mine", functools.partial(single, noise=Noise(sigma)))
        jobs.append(Job.of(Config("mine", ("ml-exact",), runs=8)))
    first, second = jobs
    clean = np.asarray(RAILS["dry"](first.scenario.excitation.slips(), {}))
    noise = [np.asarray(job.tiles.draw(0, 0).adhesion) - clean for job in jobs]
    np.testing.assert_allclose(noise[1], 2 * noise[0], atol=1e-14)
    before, other, again = (content(job, 0).rows.to_pandas() for job in (first, second, first))
    pd.testing.assert_frame_equal(before, again, check_exact=True)
    assert not np.any(before["mu_max"] == other["mu_max"])
    # Programs belong to the content of a scenario: a copy, as a worker is given one, shares them.
    assert pickle.loads(pickle.dumps(second)).tiles is second.tiles is not first.tiles
    settings = [job.record["depends on"]["settings of the scenario"] for job in jobs]
    assert settings[0] != settings[1]
