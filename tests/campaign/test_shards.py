"""Shards: what they hold, that their order does not matter, and what is left of a killed job."""

import dataclasses
import subprocess
import sys

import jax
import numpy as np
import pandas as pd
import pytest

from adhesion_jax.campaign import store
from adhesion_jax.campaign.job import Config, Job
from adhesion_jax.campaign.monte_carlo import added, campaign_of, frame_of, run_campaign
from adhesion_jax.campaign.shard import content, scales
from adhesion_jax.campaign.store import notes, noting
from adhesion_jax.errors import InputError
from adhesion_jax.identifiers import IDENTIFIERS
from adhesion_jax.library.montecarlo import MONTECARLO_FILES
from adhesion_jax.library.shards import opened_for
from adhesion_jax.library.status import status
from adhesion_jax.metrics.counts import WIDTH
from adhesion_jax.scenarios import Options

#: Three shards, of which the last has a part of its tile.
SMALL = Config("he2018-blocks", ("ml-exact",), Options(points=40, blocks=6), 300, seed=2)


#: A worker process computes and stores a shard, and says whether it has imported pandas.
WORKER = """
import sys
from pathlib import Path
from adhesion_jax import runtime
runtime.start()
from adhesion_jax.campaign.job import Config
from adhesion_jax.campaign.job import Job
from adhesion_jax.campaign.shard import content
from adhesion_jax.campaign.store import stored
stored(content, Job.of(Config("single", ("ml-exact",), runs=128)), 0, Path(sys.argv[1]))
print("pandas" in sys.modules)
"""


@pytest.mark.long
def test_a_shard_is_computed_and_stored_without_pandas(tmp_path):
    """Its import would be a fifth of the start of a worker process."""
    command = (sys.executable, "-c", WORKER, str(tmp_path))
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]
    assert [*tmp_path.glob("*.npz")]


def test_shards_have_all_runs_once_and_grow():
    job = Job.of(SMALL)
    tiles = [job.tiles_of(number) for number in range(120)]
    assert [of[0] for of in tiles] == [0, *(of[-1] + 1 for of in tiles[:-1])]
    sizes = [len(of) for of in tiles]
    assert sizes[0] == 1
    assert max(sizes) == sizes[-1] == 32
    assert sizes == sorted(sizes)
    for runs in (1, 128, 129, 5000, 10**6):
        job = Job.of(dataclasses.replace(SMALL, runs=runs))
        parts = [job.runs_of(number) for number in range(job.shards)]
        assert sum(parts) == runs
        assert min(parts) > 0


def test_runs_of_many_blocks_are_in_smaller_shards():
    sizes = {name: Job.of(Config(name)).most_tiles for name in ("single", "he2018-blocks", "drift")}
    assert sizes == {"single": 32, "he2018-blocks": 32, "drift": 4}
    longer = Job.of(Config("he2018-blocks", options=Options(blocks=300)))
    assert longer.most_tiles == 1
    # It is the scenario alone that decides, so that a job has the shards of a longer one.
    few, many = (Job.of(Config("drift", runs=runs)) for runs in (10, 10**6))
    assert [few.tiles_of(n) for n in range(60)] == [many.tiles_of(n) for n in range(60)]


@pytest.fixture(scope="module")
def small():
    """A job, its shards, its campaign and its rows."""
    job = Job.of(SMALL)
    shards = [content(job, number) for number in range(job.shards)]
    rows = []
    campaign = run_campaign(SMALL, rows.append, lambda _: None, 1)
    return job, shards, campaign, pd.concat(rows, ignore_index=True)


def equal(one, other):
    return jax.tree.all(jax.tree.map(lambda a, b: np.array_equal(a, b, equal_nan=True), one, other))


def timeless(arrays):
    """Without what depends on the clock, or is added by the store."""
    added = ("runs", "checksum of the rows")
    return {key: x for key, x in arrays.items() if "seconds" not in key and key not in added}


def test_a_shard_is_the_same_whatever_was_computed_before(small):
    job, shards, campaign, _ = small
    for number in reversed(range(len(shards))):
        again = content(job, number)
        assert equal(timeless(again.arrays), timeless(shards[number].arrays))
        rows = frame_of(again.rows), frame_of(shards[number].rows)
        pd.testing.assert_frame_equal(*rows, check_exact=True)
    tables = campaign_of(job, added(job, [found.arrays for found in shards])).tables
    for name, table in tables.items():
        timed = [column for column in table if "seconds" in column]
        pd.testing.assert_frame_equal(
            table.drop(columns=timed), campaign.tables[name].drop(columns=timed), check_exact=True
        )


def test_bands_are_those_of_all_runs_to_half_a_bin(small):
    job, _, campaign, rows = small
    centre, scale = scales(job.tiles)
    quantities = list(dict.fromkeys(campaign.bands["quantity"]))
    for row in campaign.bands.itertuples():
        of_block = rows[(rows["block"] == row.block) & (rows["identifier"] == row.identifier)]
        assert len(of_block) == SMALL.runs
        true = np.quantile(of_block[row.quantity], [0.05, 0.5, 0.95])
        place = row.block, quantities.index(row.quantity)
        half = 0.5 * WIDTH * np.hypot(scale[place], true - centre[place])
        assert (np.abs(np.array([row.p05, row.median, row.p95]) - true) <= 1.01 * half).all()


def test_the_histogram_is_that_of_the_estimates(small):
    _, _, campaign, rows = small
    wet = campaign.histogram[campaign.histogram["rail"] == "wet"]
    lines = np.append(wet["lower"], wet["upper"].iloc[-1])
    values = rows.loc[rows["block"] == 5, "mu_max"]  # the block of the switch (4) is left out
    counts, found = np.histogram(values, lines)[0], wet["density"] * np.diff(lines) * len(values)
    # A run at most stands beyond a line, for bins are a fortieth as wide.
    assert np.abs(np.cumsum(counts) - np.cumsum(found)).max() < 3
    assert found.sum() == pytest.approx(counts.sum(), abs=1)


def test_rows_are_kept_around_switches_and_at_the_end():
    config = Config("he2018-blocks", options=Options(blocks=24))  # switches at 8 and 16
    few = Job.of(config, every_block=False).kept_blocks
    assert few.tolist() == [*range(7, 13), *range(15, 21), 23]
    assert Job.of(config).kept_blocks.tolist() == [*range(24)]
    single = Job.of(Config("single"), every_block=False)
    assert single.kept_blocks.tolist() == [0]


def written(directory, config, resume=False):
    """The shards that were computed to complete a folder."""
    jobs = [Job.of(config)]
    with store.opened(directory, "montecarlo", jobs, resume) as folder:
        work = store.missing(folder, jobs)
        for unit in work:
            store.stored(content, *unit, folder)
    return [number for _, number in work]


def contents(directory):
    """What the shards of a folder add up to, and their rows."""
    job = Job.recorded(store.recorded(directory)["jobs"][0])
    folder = directory / store.FOLDER
    parts = [timeless(one) for one in store.read_all(folder, job.name, job.shards)]
    assert len(parts) == job.shards
    store.write_rows(directory / "rows.parquet", folder, [job])
    return parts, pd.read_parquet(directory / "rows.parquet")


def same(one, other):
    pd.testing.assert_frame_equal(one[1], other[1], check_exact=True)
    return equal(one[0], other[0])


def test_what_is_stored_is_what_was_computed(small, tmp_path):
    _, shards, _, rows = small
    assert written(tmp_path, SMALL) == [0, 1, 2]
    parts, stored = contents(tmp_path)
    assert equal(parts, [timeless(found.arrays) for found in shards])
    # The order of the columns apart, which is that of several scenarios in one file.
    pd.testing.assert_frame_equal(stored[list(rows)], rows, check_exact=True)
    assert written(tmp_path, SMALL, resume=True) == []
    assert written(tmp_path, SMALL) == [0, 1, 2]  # unless asked to resume, it begins again


@pytest.mark.parametrize("damage", ["cut", "flipped", "gone", "empty"])
@pytest.mark.parametrize("kind", ["npz", pytest.param("parquet", marks=pytest.mark.long)])
def test_a_damaged_shard_is_computed_again(tmp_path, damage, kind):
    config = dataclasses.replace(SMALL, runs=200)
    written(tmp_path, config)
    before = contents(tmp_path)
    path = tmp_path / store.FOLDER / f"he2018-blocks-00001.{kind}"
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    if damage == "gone":
        path.unlink()
    else:
        left = {"cut": content[: len(content) // 3], "flipped": content, "empty": b""}
        path.write_bytes(left[damage])
    assert written(tmp_path, config, resume=True) == [1]
    assert same(contents(tmp_path), before)


def test_runs_that_are_added_make_the_longer_job(tmp_path):
    (tmp_path / "long").mkdir()
    written(tmp_path / "long", SMALL)
    (tmp_path / "short").mkdir()
    written(tmp_path / "short", dataclasses.replace(SMALL, runs=200))
    jobs = [Job.of(SMALL)]
    with store.opened(tmp_path / "short", "montecarlo", jobs, resume=True, extend=100) as folder:
        work = store.missing(folder, jobs)
        assert [number for _, number in work] == [1, 2]  # the first was whole
        for unit in work:
            store.stored(content, *unit, folder)
    assert same(contents(tmp_path / "short"), contents(tmp_path / "long"))


@pytest.mark.parametrize(
    ("other", "words"),
    [
        ({"seed": 3}, "--seed is 2 there and 3 here"),
        ({"runs": 200}, "--runs is 300 there and 200 here"),
        (
            {"scenario": "single", "options": Options(points=40)},
            "what is computed is he2018-blocks",
        ),
        ({"options": Options(points=41, blocks=6)}, "--points is 40 there and 41 here"),
        ({"identifiers": ("ml-exact", "ml-de")}, "--identifiers is ml-exact there and ml-exact,ml"),
    ],
)
def test_another_job_is_not_resumed_and_the_difference_is_named(tmp_path, other, words):
    with store.opened(tmp_path, "montecarlo", [Job.of(SMALL)], resume=False) as folder:
        (folder / "he2018-blocks-00000.npz").write_bytes(b"stands for a shard")
    with (
        pytest.raises(InputError, match=words),
        store.opened(
            tmp_path, "montecarlo", [Job.of(dataclasses.replace(SMALL, **other))], resume=True
        ),
    ):
        pass
    assert (tmp_path / store.FOLDER / "he2018-blocks-00000.npz").exists()


def test_a_job_of_another_source_is_not_resumed(tmp_path, monkeypatch):
    with store.opened(tmp_path, "montecarlo", [Job.of(SMALL)], resume=False) as folder:
        (folder / "he2018-blocks-00000.npz").write_bytes(b"stands for a shard")
    monkeypatch.setattr("adhesion_jax.keeping.of_package", lambda: "other")
    with (
        pytest.raises(InputError, match="source of adhesion-jax is another one"),
        store.opened(tmp_path, "montecarlo", [Job.of(SMALL)], resume=True),
    ):
        pass


def test_what_is_known_of_a_job_is_told(tmp_path):
    with pytest.raises(InputError, match="holds no job"):
        status(tmp_path)
    jobs = [Job.of(SMALL)]
    with store.opened(tmp_path, "montecarlo", jobs, resume=False) as folder:
        store.stored(content, jobs[0], 1, folder)  # any shard will do
        told = status(tmp_path)
        assert "he2018-blocks: 128 of 300 runs are finished (43%)" in told
        assert "summary: mu_max over 128 runs" in told
        assert "a job is computing" in told
    other = tmp_path / "other"
    other.mkdir()
    with store.opened(other, "of an experiment", jobs, resume=False) as folder:
        store.stored(content, jobs[0], 1, folder)
    told = status(other)
    assert "he2018-blocks: 128 of 300 runs are finished (43%)\n\nno job is computing" in told
    assert "no job is computing in this folder; the same command" in status(tmp_path)


def test_a_job_with_methods_of_the_users_own_is_told(tmp_path, monkeypatch):
    own = {**IDENTIFIERS, "mine": IDENTIFIERS["ml-exact"]}
    job = Job.of(dataclasses.replace(SMALL, identifiers=("mine",)), own)
    with store.opened(tmp_path, "montecarlo", [job], resume=False) as folder:
        store.stored(content, job, 0, folder)
    monkeypatch.setattr("adhesion_jax.keeping.of_outside", lambda: "not read here")
    told = status(tmp_path)
    assert "128 of 300 runs" in told
    assert "mine" in told.split("summary")[1]


def test_of_a_job_of_another_version_only_its_progress_is_told(tmp_path, monkeypatch):
    written(tmp_path, SMALL)
    monkeypatch.setattr("adhesion_jax.keeping.of_package", lambda: "other")
    told = status(tmp_path)
    assert "300 of 300 runs are finished" in told
    assert "tables cannot be told here: the source of adhesion-jax is another one" in told
    assert "summary" not in told


def test_notes_tell_what_goes_on_and_pass_with_the_shard(tmp_path):
    with noting(tmp_path, "a-1") as tell, noting(tmp_path, "b-2") as other:
        tell(0, "one")
        other(7, "other words")
        assert notes(tmp_path) == [(0, "one"), (7, "other words")]
        tell(5, "two")
        tell(6, "two")  # too soon for the same words
        assert notes(tmp_path)[0] == (5, "two")
        (tmp_path / ".partial-note-c").write_text("half")
        assert len(notes(tmp_path)) == 2
    (tmp_path / ".partial-note-c").unlink()
    assert list(tmp_path.iterdir()) == []
    with noting(tmp_path / "gone", "a") as tell:  # a note that cannot be written is left out
        tell(1, "one")


def test_a_shard_tells_its_runs_tile_by_tile():
    job, told = Job.of(dataclasses.replace(SMALL, runs=5000)), []
    number = next(n for n in range(99) if len(job.tiles_of(n)) == 2)
    content(job, number, lambda runs, words: told.append((runs, words)))
    words = ("noise of he2018-blocks", "ml-exact on he2018-blocks")
    assert told == [(runs, one) for runs in (0, 128) for one in words]


def test_a_folder_in_the_place_of_a_result_is_refused_before_anything_is_removed(tmp_path):
    written(tmp_path, SMALL)
    (tmp_path / "summary.csv").mkdir()
    with (
        pytest.raises(InputError, match=r"has a folder summary\.csv"),
        opened_for("montecarlo", [Job.of(SMALL)], tmp_path, MONTECARLO_FILES, resume=False),
    ):
        pass
    assert len([*(tmp_path / store.FOLDER).glob("*.npz")]) == 3


def test_two_jobs_do_not_write_to_one_folder(tmp_path):
    with (
        store.opened(tmp_path, "montecarlo", [Job.of(SMALL)], resume=False),
        pytest.raises(InputError, match="is being written to by another job"),
        store.opened(tmp_path, "montecarlo", [Job.of(SMALL)], resume=False),
    ):
        pass
    assert list(tmp_path.iterdir()) == []  # a job without a shard leaves nothing


def test_a_folder_without_shards_is_begun_afresh(tmp_path):
    with store.opened(tmp_path, "montecarlo", [Job.of(SMALL)], resume=True) as folder:
        assert len(store.missing(folder, [Job.of(SMALL)])) == 3


def refused(directory, words):
    with (
        pytest.raises(InputError, match=words),
        store.opened(directory, "montecarlo", [Job.of(SMALL)], resume=True),
    ):
        pass


def test_what_a_folder_cannot_say_is_not_removed_by_a_job_that_resumes(tmp_path):
    written(tmp_path, SMALL)
    (tmp_path / store.FOLDER / "job.json").write_text("{}")
    refused(tmp_path, "job.json there does not say of which job; .* leave --resume out")
    assert len([*(tmp_path / store.FOLDER).glob("*.npz")]) == 3


def test_more_shards_than_a_record_may_tell_are_refused_before_any_is_removed(
    tmp_path, monkeypatch
):
    written(tmp_path, SMALL)
    monkeypatch.setattr(store, "_MOST_SHARDS", 2)
    refused(tmp_path, "--runs 300 of he2018-blocks are 3 shards, and a folder holds 2; ask for")
    assert len([*(tmp_path / store.FOLDER).glob("*.npz")]) == 3
